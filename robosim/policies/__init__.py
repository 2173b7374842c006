"""Goal policies, which choose where the robot drives, and the belief over the target's position."""
