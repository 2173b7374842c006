"""Robots: what they are like, how they move (dynamic or kinematic), what they bump into, and their odometry."""
