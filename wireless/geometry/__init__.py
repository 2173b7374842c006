"""Geometry: facets and edges of meshes, floor plans, what sees what, images."""
