"""Sub-cell surfaces: for each map cell, mean and spread of the points seen in it, and their mean normal.

A wall cell of 0.05 m says only to 0.05 m where its wall is; the mean of the points that fell into it says it to a
millimetre. Normals point to where the robot stood, which keeps apart the two sides of a thin wall. For the
hull, what counts is how far a rough or sharp surface sticks out: the mean moved along the normal by the spread of
the points. All is summed over all observations, without forgetting: old surfaces stand fast and hold the map against
drift.
Reference: the cell statistics of the normal distributions transform, Biber and Strasser, IROS 2003.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from slam.grid import GridFrame

#: Means of less weight, or of normals that disagree more than this, are not surfaces to match against.
MIN_WEIGHT = 0.5
MIN_AGREEMENT = 0.8


class SurfaceGrid:
    """Points and normals, cell by cell, of a grid that may grow."""

    def __init__(self, frame: GridFrame):
        self.frame = frame
        # Sums over the points of a cell: weight, offset from its centre (x, y) [m], normal (x, y), squares of the
        # offset (xx, xy, yy).
        self.sums = np.zeros((*frame.shape, 8), np.float32)
        # What follows from them: mean offset, mean normal, and 1 where they make a surface to match against.
        self._planes = np.zeros((*frame.shape, 5), np.float32)
        self.front_m = np.zeros((*frame.shape, 2), np.float32)
        """Where the surface of each cell begins, from the centre of the cell (x, y) [m]; 0 where none is known."""

    def grow(self, frame: GridFrame, left: int, below: int) -> None:
        """Move to a larger frame of the same lattice, with `left` columns and `below` rows before the old."""
        ny, nx = self.frame.shape
        for name in ("sums", "_planes", "front_m"):
            old = getattr(self, name)
            new = np.zeros((*frame.shape, old.shape[2]), np.float32)
            new[below : below + ny, left : left + nx] = old
            setattr(self, name, new)
        self.frame = frame

    def add(
        self,
        points: Float[np.ndarray, "n 2"],
        normals: Float[np.ndarray, "n 2"],
        weights: Float[np.ndarray, " n"],
    ) -> None:
        """Enter points (x, y) [m] with unit normals; a weight of 1 counts as one observation."""
        iy, ix = self.frame.index(points)
        inside = self.frame.inside(iy, ix)
        iy, ix, points, normals, weights = (a[inside] for a in (iy, ix, points, normals, weights))
        offset = points - self.frame.to_points(np.column_stack([ix, iy]) + 0.5)
        squares = np.column_stack([offset[:, 0] ** 2, offset[:, 0] * offset[:, 1], offset[:, 1] ** 2])
        terms = np.column_stack([np.ones(len(points)), offset, normals, squares]) * weights[:, None]
        cell = iy * self.frame.shape[1] + ix
        np.add.at(self.sums.reshape(-1, 8), cell, terms.astype(np.float32))
        self._summarise(np.unique(cell))

    def _summarise(self, cell: Int[np.ndarray, " n"]) -> None:
        sums = self.sums.reshape(-1, 8)[cell].astype(float)
        weight = np.maximum(sums[:, :1], 1e-6)
        mean = sums[:, 1:3] / weight
        facing = np.hypot(sums[:, 3], sums[:, 4])
        unit = sums[:, 3:5] / np.maximum(facing, 1e-6)[:, None]
        usable = (sums[:, 0] >= MIN_WEIGHT) & (facing >= MIN_AGREEMENT * sums[:, 0])
        self._planes.reshape(-1, 5)[cell] = np.column_stack([mean, unit, usable])
        xx, xy, yy = (sums[:, 5:] / weight).T
        along = unit[:, 0] ** 2 * xx + 2 * unit[:, 0] * unit[:, 1] * xy + unit[:, 1] ** 2 * yy
        spread = np.sqrt(np.maximum(along - (unit * mean).sum(axis=1) ** 2, 0))
        half = 0.5 * self.frame.resolution_m
        self.front_m.reshape(-1, 2)[cell] = np.clip(mean + unit * spread[:, None], -half, half)

    def clear(self, rows: slice, columns: slice, mask: Bool[np.ndarray, "ny nx"]) -> None:
        """Forget the surfaces of the cells of a window where `mask` holds."""
        for array in (self.sums, self._planes, self.front_m):
            array[rows, columns][mask] = 0.0

    def nearest(
        self,
        points: Float[np.ndarray, "n 2"],
        normals: Float[np.ndarray, "n 2"],
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
        """For each point, the surface that faces the same way and lies nearest, among 3 x 3 cells.

        Args:
            points: Points (x, y) [m].
            normals: Their unit normals.

        Returns:
            Mean point [m] and unit normal of the surface found, and whether one was found.
        """
        ny, nx = self.frame.shape
        local = self.frame.to_cells(points)
        own = np.floor(local).astype(np.intp)
        ix = own[:, 0, None] + _NEIGHBOURS[:, 0]
        iy = own[:, 1, None] + _NEIGHBOURS[:, 1]
        inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
        planes = self._planes.reshape(-1, 5)[np.where(inside, iy * nx + ix, 0)]
        unit = planes[..., 2:4]
        facing = unit[..., 0] * normals[:, 0, None] + unit[..., 1] * normals[:, 1, None]
        usable = inside & (planes[..., 4] > 0) & (facing > 0.7)
        # From the point to the mean, in the float32 of small numbers: offsets within the neighbourhood only.
        cell = self.frame.resolution_m
        dx = planes[..., 0] + (ix + 0.5 - local[:, 0, None]) * cell
        dy = planes[..., 1] + (iy + 0.5 - local[:, 1, None]) * cell
        best = np.argmin(np.where(usable, dx * dx + dy * dy, np.inf), axis=1)
        rows = np.arange(len(points))
        gap = np.column_stack([dx[rows, best], dy[rows, best]])
        return points + gap, unit[rows, best].astype(float), usable[rows, best]


_NEIGHBOURS: Int[np.ndarray, "9 2"] = np.array([(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
