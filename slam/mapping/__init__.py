"""Mapping: depth and odometry in, map and pose out."""
