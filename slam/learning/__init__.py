"""Learning: training of mapper, pose and the choice among frontiers."""
