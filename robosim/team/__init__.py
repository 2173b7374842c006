"""Several robots that search together: what they exchange, and when it arrives."""
