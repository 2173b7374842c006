"""Rectangles along the axes, polygons, and points along the walls of a room: all in metres, plain geometry."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Polygon = Float[np.ndarray, "_ 2"]
"""Corners (x, y) [m] of a convex polygon, counter-clockwise."""


class Rect(NamedTuple):
    """A rectangle along the axes [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size(self) -> tuple[float, float]:
        """Extent along x and y [m]."""
        return self.x1 - self.x0, self.y1 - self.y0

    @property
    def area(self) -> float:
        """Area [m2]."""
        return self.size[0] * self.size[1]

    def grown(self, margin_m: float) -> "Rect":
        """The rectangle with every side moved outwards."""
        return Rect(self.x0 - margin_m, self.y0 - margin_m, self.x1 + margin_m, self.y1 + margin_m)

    def meets(self, other: "Rect") -> bool:
        """Whether the two have more than a border in common."""
        return self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1

    def polygon(self) -> Polygon:
        """Its corners."""
        x0, y0, x1, y1 = self
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)


def points_along(floor: Rect, side: int, u: np.ndarray, v: np.ndarray) -> Polygon:
    """Points given along a side of a room (u, from its start, counter-clockwise) and outwards (v)."""
    start = floor.polygon()[side]
    along = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][side])
    outward = np.array([along[1], -along[0]])
    points = start + u[:, None] * along + v[:, None] * outward
    return points[::-1].copy()  # outwards is to the right of along, so reversed to be counter-clockwise


def bounding_box(points: Polygon) -> Rect:
    """The smallest rectangle along the axes around some points."""
    return Rect(*points.min(axis=0).tolist(), *points.max(axis=0).tolist())
