"""Mapping and moving: RGB-D and odometry in, map, pose, goals and actions out.

Knows nothing of the simulator or of radio: plain arrays come in and go out.
"""
