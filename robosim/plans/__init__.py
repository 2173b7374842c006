"""Floor plans, and reading and writing them in common formats."""
