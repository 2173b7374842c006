"""Data sets: frames of robots that explore, and links of buildings with their paths and estimates."""
