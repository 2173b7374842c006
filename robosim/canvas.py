"""Painting convex polygons onto the cells of a building that stands at an angle to the grid.

A cell belongs to a polygon if its centre does, so that neither side of a wall grows by the raster. Polygons
come in the building's own frame, which is turned by a yaw against the grid's (and so the `map`) axes.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

from robosim.layout import Polygon, Rect

Window = tuple[slice, slice]


class Patch(NamedTuple):
    """Some cells of a canvas."""

    window: Window
    """Rows and columns around them."""
    mask: Bool[np.ndarray, "h w"]
    """Which cells of the window they are."""


class Canvas:
    """Cells of a plan under construction, solid at first."""

    def __init__(self, bounds: Rect, yaw: float, resolution_m: float, margin_m: float = 0.35) -> None:
        """Make room for a building.

        Args:
            bounds: What the building occupies in its own frame [m].
            yaw: Angle from the grid's x axis to the building's [rad].
            resolution_m: Side of a cell [m].
            margin_m: Solid rim around the building [m].
        """
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
        x1, y1 = np.ceil(cells.max(axis=0) + margin).astype(int).tolist()
        return slice(y0, y1), slice(x0, x1)

    def patch(self, polygon: Polygon) -> Patch:
        """Cells with their centre in a convex polygon."""
        window = self.window(polygon)
        x, y = self._x[window], self._y[window]
        mask = np.ones(x.shape, bool)
        for (ax, ay), (bx, by) in zip(
            polygon.tolist(), polygon[[*range(1, len(polygon)), 0]].tolist(), strict=True
        ):
            mask &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0
        return Patch(window, mask)

    def paint(self, polygon: Polygon, *, free: bool) -> None:
        """Make the cells of a convex polygon free or solid."""
        window, mask = self.patch(polygon)
        self.free[window][mask] = free


def fits(free: Bool[np.ndarray, "h w"], radius_cells: float) -> Bool[np.ndarray, "h w"]:
    """Cells from whose centre a disk of some radius touches no cell that is not free.

    A little strict: cells that are not free count as disks around their squares.
    """
    distance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return distance >= radius_cells + np.sqrt(0.5)
