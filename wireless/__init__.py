"""Radio in buildings: materials of walls, what they do to a wave, and the paths between points.

Knows nothing of robots: a mesh and points come in, radio quantities go out.
"""
