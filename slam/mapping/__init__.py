"""Mapping: map and pose from depth and odometry."""
