"""Depth images of rectangular rooms in closed form: what a perfect camera would see, from any pose."""

import math
from dataclasses import dataclass

import numpy as np

CAMERA_HEIGHT_M = 1.25


@dataclass(frozen=True, kw_only=True)
class Room:
    """An axis-aligned box of free space, with its floor at z = 0."""

    low_xy: tuple[float, float] = (-3.0, -2.0)
    high_xy: tuple[float, float] = (3.0, 2.0)
    height_m: float = 2.5

    def depth(self, pose, *, size: int = 96, hfov_deg: float = 90.0) -> np.ndarray:
        """Depth along the axis of a level camera above the robot [m], columns from left to right.

        From inside of a box, a ray c + t d leaves it at the least positive t of its six planes. With d = (1 ahead,
        slope left, slope up) in the robot's frame, t is the depth along the axis itself.
        """
        slope = math.tan(math.radians(hfov_deg) / 2) * (1 - (2 * np.arange(size) + 1) / size)
        left, up = np.meshgrid(slope, slope)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        rays = (c - s * left, s + c * left, up)
        start = (pose[0], pose[1], CAMERA_HEIGHT_M)
        low, high = (*self.low_xy, 0.0), (*self.high_xy, self.height_m)
        depth = np.full((size, size), np.inf)
        for ray, at, least, most in zip(rays, start, low, high, strict=True):
            with np.errstate(divide="ignore", invalid="ignore"):
                leaving = np.where(ray > 0, (most - at) / ray, (least - at) / ray)
            depth = np.minimum(depth, np.where(ray == 0, np.inf, leaving))
        return depth.astype(np.float32)

    def wall_distance(self, points) -> np.ndarray:
        """Distance of points inside or near the room to its nearest wall [m]."""
        points = np.asarray(points, float)
        gap = np.concatenate([points - self.low_xy, np.asarray(self.high_xy) - points], axis=-1)
        return np.abs(gap).min(axis=-1)
