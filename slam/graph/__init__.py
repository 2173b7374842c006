"""Pose graph: submaps, constraints between them, loop closure and optimised poses."""
