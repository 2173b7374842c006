"""How far the nearest obstacle is from any point, to better than a cell.

A distance transform tells for each cell which obstacle cell is nearest. The distance is then taken to the mean surface
point inside that cell, where a mapper knows it, or else to its centre. In a doorway 5 cm wider than the hull this
is the difference between passing and not: whole cells would say 10 to 15 cm where 12.5 cm is true.
Reference: Borgefors, Distance transformations in digital images, CVGIP 34, 1986.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from slam.grid import GridFrame, MapEstimate

#: Clearance reported where no obstacle is known [m].
OPEN_M = 10.0


class Clearance:
    """Distance to the nearest obstacle within a window of the map."""

    def __init__(
        self,
        frame: GridFrame,
        obstacle: Bool[np.ndarray, "ny nx"],
        offset_m: Float32[np.ndarray, "ny nx 2"] | None = None,
    ):
        """Prepare a window.

        Args:
            frame: Where the cells of the window lie.
            obstacle: Obstacle cells.
            offset_m: Surface inside each obstacle cell, from its centre (x, y) [m]; the centre itself if None.
        """
        self.frame = frame
        iy, ix = np.nonzero(obstacle)
        points = frame.to_points(np.column_stack([ix, iy]) + 0.5)
        if offset_m is not None:
            points = points + offset_m[iy, ix]
        # Label k of the transform is the k-th obstacle cell in raster order, label 0 means none.
        self._points = np.vstack([[[1e3, 1e3]], points]).astype(np.float32)
        if len(points):
            kind = cv2.DIST_LABEL_PIXEL
            free = (~obstacle).astype(np.uint8)
            self._label = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=kind)[1]
        else:
            self._label = np.zeros(frame.shape, np.int32)

    @classmethod
    def around(cls, estimate: MapEstimate, rows: slice, columns: slice, frame: GridFrame) -> "Clearance":
        """Clearance in a window of a map estimate (see `GridFrame.window`)."""
        obstacle = (estimate.obstacle_probability[rows, columns] > 0.5) | estimate.blocked[rows, columns]
        offset = None if estimate.surface_offset_m is None else estimate.surface_offset_m[rows, columns]
        return cls(frame, obstacle, offset)

    def at(self, points: Float[np.ndarray, "*batch 2"]) -> Float32[np.ndarray, "*batch"]:
        """Distance [m] from points (x, y) [m] to the nearest obstacle; `OPEN_M` outside of the window."""
        ny, nx = self.frame.shape
        points = np.asarray(points, float)
        cells = (points - self.frame.origin_xy) * (1 / self.frame.resolution_m)
        ix, iy = cells[..., 0], cells[..., 1]
        inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
        flat = np.where(inside, iy, 0).astype(np.intp) * nx + np.where(inside, ix, 0).astype(np.intp)
        nearest = self._points[self._label.ravel()[flat]]
        gap = np.hypot(nearest[..., 0] - points[..., 0], nearest[..., 1] - points[..., 1])
        return np.where(inside, np.minimum(gap, OPEN_M), OPEN_M).astype(np.float32)

    def cells(self, sharp_m: float) -> Float32[np.ndarray, "ny nx"]:
        """Distance [m] from each cell to the nearest obstacle.

        From the centre of the cell, but where that is within half a cell of `sharp_m` from the best of five points of the cell:
        a passage is as wide as its best line, not as its cell centres.

        Args:
            sharp_m: Distance that decides something, the radius of the hull [m].
        """
        ny, nx = self.frame.shape
        cell = self.frame.resolution_m
        nearest = np.take(self._points, self._label, axis=0)
        x = (self.frame.origin_xy[0] + (np.arange(nx) + 0.5) * cell).astype(np.float32)
        y = (self.frame.origin_xy[1] + (np.arange(ny) + 0.5) * cell).astype(np.float32)
        dx, dy = nearest[..., 0] - x, nearest[..., 1] - y[:, None]
        gap = np.sqrt(dx * dx + dy * dy)
        iy, ix = np.nonzero(np.abs(gap - sharp_m) < 0.5 * cell)
        centre = np.column_stack([x[ix], y[iy]]).astype(float)
        best = gap[iy, ix]
        for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            best = np.maximum(best, self.at(centre + np.array([sx, sy]) * 0.25 * cell))
        gap[iy, ix] = best
        return np.minimum(gap, OPEN_M)
