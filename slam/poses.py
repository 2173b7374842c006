"""Planar poses (x, y, yaw) and how they chain.

A pose is a float64 array (3,): x [m], y [m], yaw [rad] in [-pi, pi). A displacement is the pose of the robot after a
move, in the robot's frame before it.
"""

import math
from typing import TypeVar

import numpy as np
from jaxtyping import Float

#: A pose or displacement: x [m], y [m], yaw [rad].
Pose = Float[np.ndarray, "3"]
#: Several of them.
Poses = Float[np.ndarray, "n 3"]
#: The covariance of one [m^2, m rad, rad^2].
Covariance = Float[np.ndarray, "3 3"]


Angle = TypeVar("Angle", float, np.ndarray)


def wrap(angle_rad: Angle) -> Angle:
    """Wrap angles to [-pi, pi)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def compose(pose: Pose, displacement: Pose) -> Pose:
    """Pose reached from `pose` by a displacement in the robot's frame."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy, turn = displacement
    return np.array([pose[0] + c * dx - s * dy, pose[1] + s * dx + c * dy, wrap(pose[2] + turn)])


def moved_ahead(pose: Pose, distance_m: float) -> Pose:
    """A pose as far ahead of another [m], such as that of a sensor."""
    return compose(pose, np.array([distance_m, 0.0, 0.0])) if distance_m else pose


def between(start: Pose, end: Pose) -> Pose:
    """Displacement, in the robot's frame at `start`, that leads from `start` to `end`."""
    c, s = math.cos(start[2]), math.sin(start[2])
    x, y = end[0] - start[0], end[1] - start[1]
    return np.array([c * x + s * y, c * y - s * x, wrap(end[2] - start[2])])


def to_map(pose: Pose, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
    """Points of the robot's frame in `map`."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(points, float) @ np.array([[c, s], [-s, c]]) + pose[:2]


def to_robot(pose: Pose, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
    """Points of `map` in the robot's frame."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return (np.asarray(points, float) - pose[:2]) @ np.array([[c, -s], [s, c]])


def rotation(yaw_rad: float) -> Float[np.ndarray, "3 3"]:
    """Turns displacements of a robot's frame, and by R C R^T their covariances, into the axes of `map`; yaw stays."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
