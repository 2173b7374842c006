"""Data sets: frames of exploring robots, and links of buildings with true and estimated paths."""
