"""Radio in buildings: materials of walls and what they do to a wave.

Knows nothing of robots: a mesh and points come in, radio quantities go out.
"""
