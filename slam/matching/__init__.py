"""Fitting a scan to surfaces: points, normals, and the pose at which they come to lie on each other."""
