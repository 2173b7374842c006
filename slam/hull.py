"""The hull of a robot from above: a disk around the middle of its axle, or a convex polygon.

A disk is the same at every heading, so the distances of a map decide where it fits. Of a polygon the heading counts as
well. Paths are planned for the disk of half its width, which passes where the robot does when it drives straight ahead;
the controller then chooses headings with which the polygon itself stays clear, and turns where there is room to turn.
Left out: hulls that are not convex.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

#: Corners of a hull around the middle of the axle: x ahead, y to the left [m].
Outline = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Hull:
    """Outline of the robot that must not touch obstacles."""

    radius_m: float
    """Radius of the disk; of a polygon half its width [m]."""
    outline_m: Outline = ()
    """Corners of the polygon, convex and counter-clockwise; empty for a disk."""

    @cached_property
    def corners(self) -> Float[np.ndarray, "n 2"]:
        """Corners of the polygon [m]; none of a disk."""
        return np.array(self.outline_m, float).reshape(-1, 2)

    @cached_property
    def turning_m(self) -> float:
        """Radius of the circle in which it turns on the spot [m]."""
        return float(np.hypot(*self.corners.T).max(initial=self.radius_m))

    @cached_property
    def inner_m(self) -> float:
        """Radius of the largest disk around the middle of the axle that it covers [m]."""
        return float(self._depth(np.zeros(2))) if self.outline_m else self.radius_m

    def covers(self, points: Float[np.ndarray, "*batch 2"], margin_m: float) -> Bool[np.ndarray, "*batch"]:
        """Which points of its own frame lie inside of the polygon by a margin [m]."""
        return np.asarray(self._depth(points) > margin_m)

    def _depth(self, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch"]:
        """Distance of points inside of the polygon from its nearest side [m]; negative outside."""
        start = self.corners
        along = np.roll(start, -1, axis=0) - start
        x, y = np.moveaxis(start - points[..., None, :], -1, 0)
        return np.asarray(((x * along[:, 1] - y * along[:, 0]) / np.hypot(*along.T)).min(axis=-1))

    @property
    def ahead_m(self) -> float:
        """How far it reaches to the front [m]."""
        return float(self.corners[:, 0].max()) if self.outline_m else self.radius_m

    @property
    def behind_m(self) -> float:
        """How far it reaches to the back [m]."""
        return float(-self.corners[:, 0].min()) if self.outline_m else self.radius_m
