"""Several robots that search together: what they tell each other, and when it arrives."""
