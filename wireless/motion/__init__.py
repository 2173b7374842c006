"""Links among moving people: blockage of paths, and channels over time."""
