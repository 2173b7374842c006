"""Electromagnetics: materials, reflection and transmission at walls, diffraction at edges, fields along paths."""
