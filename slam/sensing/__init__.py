"""Sensing: from depth images to points, scans and patches ahead of the robot."""
