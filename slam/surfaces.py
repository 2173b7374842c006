"""Sub-cell surfaces: for each map cell, the mean point and mean normal of what was seen in it.

A wall cell of 0.05 m says only to 0.05 m where its wall is; the mean of the points that fell into it says it to a
millimetre. Normals point to where the robot stood, which keeps apart the two sides of a thin wall. The
mean is over all observations, without forgetting: old surfaces stand fast and hold the map against drift.
Reference: the cell statistics of the normal distributions transform, Biber and Strasser, IROS 2003.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from slam.grid import GridFrame

#: Means of less weight, or of normals that disagree more than this, are not surfaces to match against.
MIN_WEIGHT = 0.5
MIN_AGREEMENT = 0.8


class SurfaceGrid:
    """Mean points and normals, cell by cell, of a grid that may grow."""

    def __init__(self, frame: GridFrame):
        self.frame = frame
        # Sums over the points of a cell: weight, offset from the cell's centre (x, y) [m], normal (x, y).
        self.sums = np.zeros((*frame.shape, 5), np.float32)

    def grow(self, frame: GridFrame, left: int, below: int) -> None:
        """Move to a larger frame of the same lattice.

        Args:
            frame: The larger frame.
            left: Columns added on the left.
            below: Rows added below.
        """
        ny, nx = self.frame.shape
        sums = np.zeros((*frame.shape, 5), np.float32)
        sums[below : below + ny, left : left + nx] = self.sums
        self.frame, self.sums = frame, sums

    def add(
        self,
        points: Float[np.ndarray, "n 2"],
        normals: Float[np.ndarray, "n 2"],
        weights: Float[np.ndarray, "n"],
    ) -> None:
        """Enter points (x, y) [m] with unit normals; a weight of 1 counts as one observation."""
        iy, ix = self.frame.index(points)
        inside = self.frame.inside(iy, ix)
        iy, ix, points, normals, weights = (
            iy[inside],
            ix[inside],
            points[inside],
            normals[inside],
            weights[inside],
        )
        offset = points - self.frame.to_points(np.column_stack([ix, iy]) + 0.5)
        terms = np.column_stack([np.ones(len(points)), offset, normals]) * weights[:, None]
        np.add.at(self.sums.reshape(-1, 5), iy * self.frame.shape[1] + ix, terms.astype(np.float32))

    def offsets(self, rows: slice, columns: slice) -> Float[np.ndarray, "ny nx 2"]:
        """Mean point of each cell of a window, from the centre of the cell [m]; 0 where nothing was seen."""
        sums = self.sums[rows, columns]
        return sums[..., 1:3] / np.maximum(sums[..., :1], 1e-6)

    def clear(self, rows: slice, columns: slice, mask: Bool[np.ndarray, "ny nx"]) -> None:
        """Forget the surfaces of the cells of a window where `mask` holds."""
        self.sums[rows, columns][mask] = 0.0

    def nearest(
        self,
        points: Float[np.ndarray, "n 2"],
        normals: Float[np.ndarray, "n 2"],
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
        """For each point, the surface that faces the same way and lies nearest, among 3 x 3 cells.

        Args:
            points: Points (x, y) [m].
            normals: Their unit normals.

        Returns:
            Mean point [m] and unit normal of the surface found, and whether one was found.
        """
        ny, nx = self.frame.shape
        cells = np.floor(self.frame.to_cells(points)).astype(np.int64)
        cells = cells[:, None, :] + _NEIGHBOURS
        ix, iy = cells[..., 0], cells[..., 1]
        inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
        flat = np.where(inside, iy * nx + ix, 0)
        sums = self.sums.reshape(-1, 5)[flat]
        weight = np.maximum(sums[..., 0], 1e-6)
        length = np.hypot(sums[..., 3], sums[..., 4])
        facing = np.maximum(length, 1e-6)
        unit = sums[..., 3:] / facing[..., None]
        usable = inside & (sums[..., 0] >= MIN_WEIGHT) & (length >= MIN_AGREEMENT * weight)
        usable &= (unit * normals[:, None, :]).sum(axis=-1) > 0.7
        mean = self.frame.to_points(cells + 0.5) + sums[..., 1:3] / weight[..., None]
        gap = ((mean - points[:, None, :]) ** 2).sum(axis=-1)
        best = np.argmin(np.where(usable, gap, np.inf), axis=1)
        rows = np.arange(len(points))
        return mean[rows, best], unit[rows, best].astype(float), usable[rows, best]


_NEIGHBOURS: Int[np.ndarray, "9 2"] = np.array([(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
