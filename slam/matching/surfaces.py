"""Sub-cell surfaces: for each map cell, mean and spread of the points seen in it, and their mean normal.

A cell of 0.05 m locates a wall to 0.05 m; the mean of the points in it to a millimetre. Normals point towards the
robot, which separates the two sides of a thin wall. For the hull, the front of a rough or sharp surface counts: the
mean, shifted along the normal by the spread of the points. Sums include all observations, without forgetting: old
surfaces stay and prevent drift of the map.
Reference: the cell statistics of the normal distributions transform, Biber and Strasser, IROS 2003.
"""

import math

import numpy as np
from jaxtyping import Bool, Float

from robosim.support.compiled import compiled
from slam.grid import GridFrame, zeros

#: Means of less weight, or of normals that disagree more than this, are not surfaces to match against.
MIN_WEIGHT = 0.5
MIN_AGREEMENT = 0.8
#: Cells added at once by `make_room`.
_MORE = 50


class SurfaceGrid:
    """Points and normals, cell by cell, of a grid that may grow; 12 bytes a cell, and 60 more where a surface is."""

    def __init__(self, frame: GridFrame, *, fronts: bool = True):
        """Make a grid without surfaces. `fronts` stores `front_m`, two thirds of the memory of an empty cell."""
        self.frame, self._fronts = frame, fronts
        # Row of each cell plus 1, 0 where it has none.
        self._row = zeros(frame.shape, np.int32)
        # Sums over the points of cells with a row: weight, offset from the centre (x, y) [m], normal (x, y),
        # squares of the offset (xx, xy, yy).
        self._sums = np.zeros((0, 8), np.float32)
        # Row and column of each, and what follows from the sums: mean offset, mean normal, and 1 where they make a
        # surface to match against.
        self._planes = np.zeros((0, 5), np.float32)
        self._cell = np.zeros((0, 2), np.int32)
        self._used = 0
        self.front_m = zeros((*(frame.shape if fronts else (0, 0)), 2), np.float32)
        """Where the surface of each cell begins, from the centre of the cell (x, y) [m]; 0 where none is known."""

    def grow(self, frame: GridFrame, left: int, below: int) -> None:
        """Move to a larger frame of the same lattice, with `left` columns and `below` rows before the old."""
        cells = self._cell[: self._used]
        fronts = self.front_m[tuple(cells.T)] if self._fronts else None
        cells += np.array([below, left], np.int32)
        self._row, self.frame = zeros(frame.shape, np.int32), frame
        self._row[tuple(cells.T)] = np.arange(1, self._used + 1, dtype=np.int32)
        if fronts is not None:
            self.front_m = zeros((*frame.shape, 2), np.float32)
            self.front_m[tuple(cells.T)] = fronts

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
        if self._used + len(points) > len(self._sums):
            more = max(self._used + len(points), 2 * len(self._sums), 1024) - len(self._sums)
            self._sums = np.pad(self._sums, ((0, more), (0, 0)))
            self._planes = np.pad(self._planes, ((0, more), (0, 0)))
            self._cell = np.pad(self._cell, ((0, more), (0, 0)))
        (x, y), cell_m = self.frame.origin_xy, self.frame.resolution_m
        self._used = _add(
            np.asarray(points, float),
            np.asarray(normals, float),
            np.asarray(weights, float),
            (x, y, cell_m),
            self._row,
            self._used,
            self._sums,
            self._planes,
            self._cell,
            self.front_m,
        )

    def clear(self, rows: slice, columns: slice, mask: Bool[np.ndarray, "ny nx"]) -> None:
        """Forget the surfaces of the cells of a window where `mask` holds."""
        row = self._row[rows, columns][mask]
        row = row[row > 0] - 1
        self._sums[row] = self._planes[row] = 0.0
        if self._fronts:
            self.front_m[rows, columns][mask] = 0.0

    def paste(self, rows: slice, columns: slice, added: "SurfaceGrid") -> None:
        """Replace a window by the surfaces of a grid over it."""
        window, remains = self._row[rows, columns], np.ones(self._used, bool)
        remains[window[window > 0] - 1] = False
        window[:] = 0
        added._cell += np.array([rows.start, columns.start], np.int32)
        for name in ("_sums", "_planes", "_cell"):
            old, new = getattr(self, name)[: self._used], getattr(added, name)[: added._used]
            setattr(self, name, np.concatenate([old[remains], new]))
        self._used = len(self._cell)
        self._row[self._cell[:, 0], self._cell[:, 1]] = np.arange(1, self._used + 1, dtype=np.int32)
        if self._fronts:
            self.front_m[rows, columns] = added.front_m

    def planes(
        self,
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """All surfaces to match against: mean points [m], unit normals, and weights."""
        usable = np.flatnonzero(self._planes[: self._used, 4] > 0)
        mean = self.frame.to_points(self._cell[usable, ::-1] + 0.5) + self._planes[usable, :2]
        return mean, self._planes[usable, 2:4].astype(float), self._sums[usable, 0].astype(float)

    def arrays(self) -> tuple[tuple[float, float, float], np.ndarray, np.ndarray]:
        """Return the arguments of `nearest_plane`: corner and side of a cell [m], row of each cell plus 1, and rows."""
        return (*self.frame.origin_xy, self.frame.resolution_m), self._row, self._planes


@compiled
def nearest_plane(
    x_m: float,
    y_m: float,
    facing: tuple[float, float],
    surfaces: tuple[tuple[float, float, float], np.ndarray, np.ndarray],
    alike: float,
) -> tuple[int, float, float]:
    """The nearest surface among 3 x 3 cells whose normal differs from a unit vector by no more than an angle (cosine).

    Returns its row in the planes, -1 if there is none, and x, y [m] from the point to its mean.
    """
    (x0, y0, cell_m), row_of, planes = surfaces
    ny, nx = row_of.shape
    x, y = (x_m - x0) / cell_m, (y_m - y0) / cell_m
    nearest, least, to_x, to_y = -1, np.inf, 0.0, 0.0
    # Not a number is near nothing.
    if not (-1 <= x < nx + 1 and -1 <= y < ny + 1):
        return nearest, to_x, to_y
    own_x, own_y = int(np.floor(x)), int(np.floor(y))
    for iy in range(max(own_y - 1, 0), min(own_y + 2, ny)):
        for ix in range(max(own_x - 1, 0), min(own_x + 2, nx)):
            row = row_of[iy, ix] - 1
            if row < 0:
                continue
            plane = planes[row]
            if not plane[4] > 0 or not plane[2] * facing[0] + plane[3] * facing[1] > alike:
                continue
            # From the point to the mean: offsets within the neighbourhood only, small in the planes' float32.
            dx, dy = plane[0] + (ix + 0.5 - x) * cell_m, plane[1] + (iy + 0.5 - y) * cell_m
            if dx * dx + dy * dy < least:
                nearest, least, to_x, to_y = row, dx * dx + dy * dy, dx, dy
    return nearest, to_x, to_y


@compiled
def _add(
    points: np.ndarray,
    normals: np.ndarray,
    weights: np.ndarray,
    grid: tuple[float, float, float],
    row_of: np.ndarray,
    used: int,
    sums: np.ndarray,
    planes: np.ndarray,
    cell_of: np.ndarray,
    front: np.ndarray,
) -> int:
    """Add points to the sums of their cells, and update the surfaces; returns the number of cells in use."""
    x0, y0, cell_m = grid
    ny, nx = row_of.shape
    # Sums of the cells that this call touches, in double precision.
    slot_of = np.full(used + len(points), -1, np.int32)
    touched = np.empty(len(points), np.int32)
    parts = np.zeros((len(points), 8))
    count = 0
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        # Not a number is not inside.
        across, up = np.floor((x - x0) / cell_m), np.floor((y - y0) / cell_m)
        if not (across >= 0 and across < nx and up >= 0 and up < ny):
            continue
        ix, iy = int(across), int(up)
        row = row_of[iy, ix] - 1
        if row < 0:
            row = used
            row_of[iy, ix] = row + 1
            cell_of[row, 0], cell_of[row, 1] = iy, ix
            used += 1
        slot = slot_of[row]
        if slot < 0:
            slot = count
            slot_of[row] = slot
            touched[slot] = row
            count += 1
        dx, dy = x - ((ix + 0.5) * cell_m + x0), y - ((iy + 0.5) * cell_m + y0)
        added, weight = parts[slot], weights[k]
        added[0] += weight
        added[1] += dx * weight
        added[2] += dy * weight
        added[3] += normals[k, 0] * weight
        added[4] += normals[k, 1] * weight
        added[5] += dx * dx * weight
        added[6] += dx * dy * weight
        added[7] += dy * dy * weight
    half = 0.5 * cell_m
    for slot in range(count):
        row = touched[slot]
        total = sums[row]
        for j in range(8):
            total[j] += np.float32(parts[slot, j])
        weight = max(float(total[0]), 1e-6)
        mean_x, mean_y = total[1] / weight, total[2] / weight
        facing = np.hypot(float(total[3]), float(total[4]))
        unit_x, unit_y = total[3] / max(facing, 1e-6), total[4] / max(facing, 1e-6)
        usable = total[0] >= MIN_WEIGHT and facing >= MIN_AGREEMENT * total[0]
        planes[row, 0], planes[row, 1], planes[row, 2], planes[row, 3] = mean_x, mean_y, unit_x, unit_y
        planes[row, 4] = 1.0 if usable else 0.0
        if len(front):
            xx, xy, yy = total[5] / weight, total[6] / weight, total[7] / weight
            along = unit_x * unit_x * xx + 2 * unit_x * unit_y * xy + unit_y * unit_y * yy
            off = unit_x * mean_x + unit_y * mean_y
            spread = np.sqrt(max(along - off * off, 0.0))
            iy, ix = cell_of[row, 0], cell_of[row, 1]
            front[iy, ix, 0] = min(max(mean_x + unit_x * spread, -half), half)
            front[iy, ix, 1] = min(max(mean_y + unit_y * spread, -half), half)
    return used
