"""Rectangles and convex polygons [m], painted onto the cells of a building that stands at an angle to the grid.

A cell belongs to a polygon if its centre does, so that the raster shifts neither side of a wall. Polygons are in the
building's own frame, which is turned by a yaw against the axes of the grid and so of `map`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

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
        """Corners of the rectangle."""
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


Window = tuple[slice, slice]
"""Rows and columns of a canvas."""


class Canvas:
    """Cells of a plan under construction, all of them solid at first."""

    def __init__(self, bounds: Rect, yaw: float, resolution_m: float, margin_m: float = 0.35) -> None:
        """An empty canvas for a building, turned by a yaw from the grid's x axis, with a solid rim around it."""
        c, s = np.cos(yaw), np.sin(yaw)
        self._turn = np.array([[c, -s], [s, c]])
        corners = bounds.grown(margin_m).polygon() @ self._turn.T
        self._low = corners.min(axis=0)
        self.resolution_m = resolution_m
        nx, ny = np.ceil((corners.max(axis=0) - self._low) / resolution_m).astype(int)
        cells = np.stack(np.meshgrid(np.arange(nx) + 0.5, np.arange(ny) + 0.5), axis=-1)
        centres = (cells * resolution_m + self._low) @ self._turn
        self._x, self._y = np.ascontiguousarray(centres[..., 0]), np.ascontiguousarray(centres[..., 1])
        self.free: Bool[np.ndarray, "ny nx"] = np.zeros((ny, nx), bool)

    def window(self, points: Float[np.ndarray, "n 2"], margin_m: float = 0.0) -> Window:
        """Rows and columns that hold all cells with a centre within the hull of some points."""
        cells = (points @ self._turn.T - self._low) / self.resolution_m
        margin = margin_m / self.resolution_m + 1
        x0, y0 = np.maximum(np.floor(cells.min(axis=0) - margin), 0).astype(int).tolist()
        x1, y1 = np.minimum(np.ceil(cells.max(axis=0) + margin), self.free.shape[::-1]).astype(int).tolist()
        return slice(y0, y1), slice(x0, x1)

    def to_map(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Points of the building's own frame in `map` [m], of a plan whose origin is the canvas's corner."""
        return points @ self._turn.T - self._low

    @property
    def yaw(self) -> float:
        """Angle from the grid's x axis to the building's [rad]."""
        return float(np.arctan2(self._turn[1, 0], self._turn[0, 0]))

    def cells(self, polygons: Sequence[Polygon], window: Window) -> Bool[np.ndarray, "h w"]:
        """Cells of a window with their centre in one of some convex polygons."""
        rows, columns = window
        cells = np.zeros((rows.stop - rows.start, columns.stop - columns.start), bool)
        for polygon in polygons:
            own_rows, own_columns = self.window(polygon)
            y0, y1 = max(own_rows.start, rows.start), min(own_rows.stop, rows.stop)
            x0, x1 = max(own_columns.start, columns.start), min(own_columns.stop, columns.stop)
            if y0 < y1 and x0 < x1:
                here = cells[y0 - rows.start : y1 - rows.start, x0 - columns.start : x1 - columns.start]
                here |= self._inside(polygon, (slice(y0, y1), slice(x0, x1)))
        return cells

    def paint(self, polygon: Polygon, *, free: bool) -> None:
        """Make the cells of a convex polygon free or solid."""
        window = self.window(polygon)
        self.free[window][self.cells([polygon], window)] = free

    def _inside(self, polygon: Polygon, window: Window) -> np.ndarray:
        x, y = self._x[window], self._y[window]
        mask = np.ones(x.shape, bool)
        corners = polygon.tolist()
        for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
            mask &= (bx - ax) * y - (by - ay) * x >= (bx - ax) * ay - (by - ay) * ax
        return mask


def fits(free: Bool[np.ndarray, "h w"], radius_cells: float) -> Bool[np.ndarray, "h w"]:
    """Cells from whose centre a disk of some radius touches no cell that is not free.

    A little strict: cells that are not free count as disks around their squares.
    """
    distance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return distance >= radius_cells + np.sqrt(0.5)
