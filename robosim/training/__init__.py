"""Training of link-state classifiers, mapper, pose, explorer and search."""
