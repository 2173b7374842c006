"""Training of all that is learnt: link states, mapper, pose, explorer, steering."""
