"""Goal policies: who chooses where the robot goes, and the belief about the target that they share."""
