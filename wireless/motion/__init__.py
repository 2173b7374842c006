"""Links among moving people: blockage of paths, reflections off bodies, and channels over time."""
