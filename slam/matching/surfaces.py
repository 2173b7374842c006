"""Sub-cell surfaces: for each map cell, mean and spread of the points seen in it, and their mean normal.

A wall cell of 0.05 m says only to 0.05 m where its wall is; the mean of the points that fell into it says it to a
millimetre. Normals point to where the robot stood, which keeps apart the two sides of a thin wall. For the
hull, what counts is how far a rough or sharp surface sticks out: the mean moved along the normal by the spread of
the points. All is summed over all observations, without forgetting: old surfaces stand fast and hold the map against
drift.
Reference: the cell statistics of the normal distributions transform, Biber and Strasser, IROS 2003.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from slam.grid import GridFrame

#: Means of less weight, or of normals that disagree more than this, are not surfaces to match against.
MIN_WEIGHT = 0.5
MIN_AGREEMENT = 0.8
#: Cells added at once by `make_room`.
_MORE = 50


class SurfaceGrid:
    """Points and normals, cell by cell, of a grid that may grow; 12 bytes a cell, and 60 more where a surface is."""

    def __init__(self, frame: GridFrame, *, fronts: bool = True):
        """Make a grid without surfaces.

        Args:
            frame: Its cells.
            fronts: Whether `front_m` is kept, two thirds of the memory of an empty cell.
        """
        self.frame, self._fronts = frame, fronts
        self._row = np.full(frame.shape, -1, np.int32)
        # Of the cells that have one, sums over their points: weight, offset from the centre (x, y) [m], normal (x, y),
        # squares of the offset (xx, xy, yy).
        self._sums = np.zeros((0, 8), np.float32)
        # Row and column of each, and what follows from the sums: mean offset, mean normal, and 1 where they make a
        # surface to match against.
        self._planes = np.zeros((0, 5), np.float32)
        self._cell = np.zeros((0, 2), np.int32)
        self._used = 0
        self.front_m = np.zeros((*(frame.shape if fronts else (0, 0)), 2), np.float32)
        """Where the surface of each cell begins, from the centre of the cell (x, y) [m]; 0 where none is known."""

    def grow(self, frame: GridFrame, left: int, below: int) -> None:
        """Move to a larger frame of the same lattice, with `left` columns and `below` rows before the old."""
        ny, nx = self.frame.shape
        row = np.full(frame.shape, -1, np.int32)
        row[below : below + ny, left : left + nx] = self._row
        if self._fronts:
            front = np.zeros((*frame.shape, 2), np.float32)
            front[below : below + ny, left : left + nx] = self.front_m
            self.front_m = front
        self._row, self.frame = row, frame
        self._cell += np.array([below, left], np.int32)

    def make_room(self, points: Float[np.ndarray, "n 2"]) -> None:
        """Grow until points (x, y) [m] lie inside."""
        if len(points):
            cells = self.frame.to_cells(np.array([points.min(axis=0), points.max(axis=0)]))
            ny, nx = self.frame.shape
            over = (-cells[0, 0], cells[1, 0] - nx + 1, -cells[0, 1], cells[1, 1] - ny + 1)
            if max(over) > 0:
                left, right, below, above = (max(0, math.ceil(o / _MORE)) * _MORE for o in over)
                self.grow(self.frame.padded(left, right, below, above), left, below)

    def add(
        self,
        points: Float[np.ndarray, "n 2"],
        normals: Float[np.ndarray, "n 2"],
        weights: Float[np.ndarray, " n"],
    ) -> None:
        """Enter points (x, y) [m] with unit normals, those inside; a weight of 1 counts as one observation."""
        iy, ix = self.frame.index(points)
        inside = self.frame.inside(iy, ix)
        iy, ix, points, normals, weights = (a[inside] for a in (iy, ix, points, normals, weights))
        offset = points - self.frame.to_points(np.column_stack([ix, iy]) + 0.5)
        squares = np.column_stack([offset[:, 0] ** 2, offset[:, 0] * offset[:, 1], offset[:, 1] ** 2])
        terms = np.column_stack([np.ones(len(points)), offset, normals, squares]) * weights[:, None]
        cell, of_cell = np.unique(iy * self.frame.shape[1] + ix, return_inverse=True)
        sums = np.zeros((len(cell), 8))
        np.add.at(sums, of_cell, terms)
        self._sum_up(cell, sums)

    def _sum_up(self, cell: Int[np.ndarray, " n"], sums: Float[np.ndarray, "n 8"]) -> None:
        row = self._row.reshape(-1)[cell]
        new = np.flatnonzero(row < 0)
        row[new] = self._used + np.arange(len(new))
        self._row.reshape(-1)[cell] = row
        self._used += len(new)
        if self._used > len(self._sums):
            more = max(self._used, 2 * len(self._sums), 1024) - len(self._sums)
            self._sums = np.pad(self._sums, ((0, more), (0, 0)))
            self._planes = np.pad(self._planes, ((0, more), (0, 0)))
            self._cell = np.pad(self._cell, ((0, more), (0, 0)))
        self._cell[row[new]] = np.column_stack(np.divmod(cell[new], self.frame.shape[1]))
        self._sums[row] += sums.astype(np.float32)
        self._summarise(cell, row)

    def _summarise(self, cell: Int[np.ndarray, " n"], row: Int[np.ndarray, " n"]) -> None:
        sums = self._sums[row].astype(float)
        weight = np.maximum(sums[:, :1], 1e-6)
        mean = sums[:, 1:3] / weight
        facing = np.hypot(sums[:, 3], sums[:, 4])
        unit = sums[:, 3:5] / np.maximum(facing, 1e-6)[:, None]
        usable = (sums[:, 0] >= MIN_WEIGHT) & (facing >= MIN_AGREEMENT * sums[:, 0])
        self._planes[row] = np.column_stack([mean, unit, usable])
        if not self._fronts:
            return
        xx, xy, yy = (sums[:, 5:] / weight).T
        along = unit[:, 0] ** 2 * xx + 2 * unit[:, 0] * unit[:, 1] * xy + unit[:, 1] ** 2 * yy
        spread = np.sqrt(np.maximum(along - (unit * mean).sum(axis=1) ** 2, 0))
        half = 0.5 * self.frame.resolution_m
        self.front_m.reshape(-1, 2)[cell] = np.clip(mean + unit * spread[:, None], -half, half)

    def clear(self, rows: slice, columns: slice, mask: Bool[np.ndarray, "ny nx"]) -> None:
        """Forget the surfaces of the cells of a window where `mask` holds."""
        row = self._row[rows, columns][mask]
        row = row[row >= 0]
        self._sums[row] = self._planes[row] = 0.0
        if self._fronts:
            self.front_m[rows, columns][mask] = 0.0

    def planes(
        self,
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """All surfaces to match against: mean points [m], unit normals, and weights."""
        usable = np.flatnonzero(self._planes[: self._used, 4] > 0)
        mean = self.frame.to_points(self._cell[usable, ::-1] + 0.5) + self._planes[usable, :2]
        return mean, self._planes[usable, 2:4].astype(float), self._sums[usable, 0].astype(float)

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
        row = self._row.reshape(-1)[np.where(inside, iy * nx + ix, 0)]
        inside &= row >= 0
        planes = self._planes[row] if self._used else np.zeros((*row.shape, 5), np.float32)
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
