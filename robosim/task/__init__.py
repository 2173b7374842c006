"""Tasks of a robot, coverage of the building, and the record of an episode."""
