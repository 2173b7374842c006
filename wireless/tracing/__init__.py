"""Tracing: from a mesh and points to paths, by an engine for floor plans and one for any triangles."""
