"""2D lidars: planar laser scanners on the robot."""
