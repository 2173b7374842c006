"""Training of link-state classifiers, mapper, pose, explorer, steering and search."""
