"""Cells of a grid that polygons contain the centres of, and cells that the surfaces of a mesh reach into.

Polygons: along a row of centres, each edge that is crossed changes the winding number of all centres to its right, by
one up or down, as the edge goes down or up. Running sums along the rows compute all of them at once. An edge counts in
the rows whose centre y lies from its lower end to just below its upper one, so that no corner is crossed twice and
polygons that share an edge neither overlap nor leave a gap.

Meshes, exact and not sampled: a triangle cut by two horizontal planes is a convex polygon; seen from above it is still
convex, at worst a line. Within one row of cells it then covers one interval of x, so that the cells it touches are the
run from the interval's start to its end. Walls seen on edge, slivers and single points all touch at least one cell.
Walls of buildings often lie exactly on lines of the grid. Such a wall belongs to the cells behind it: its surface is
moved by a hundredth of a cell against its normal, and intervals are shortened by as much at both ends, so that touching
a border does not count.

Reference: Foley et al., "Computer Graphics: Principles and Practice", 2nd ed., 3.6 (scan conversion).
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.index_ranges import index_ranges

#: Pairs of a shape and a row that are worked on at once, to bound the memory.
PAIRS_AT_ONCE = 500_000
#: Most pairs in all (5 s of work), and additional ones for each shape: no building has more.
_MOST_PAIRS, _PAIRS_OF_ONE = 20_000_000, 30


def winding_numbers(
    start: Float[np.ndarray, "n 2"], end: Float[np.ndarray, "n 2"], shape: tuple[int, int]
) -> Int[np.ndarray, "ny nx"]:
    """Winding number of closed polygons around the centre of each cell, counter-clockwise positive.

    `start` and `end` are of the directed edges of all polygons: (x, y) in cells, the centre of cell (iy, ix) being
    (ix + 0.5, iy + 0.5). ValueError if they cross more rows than any building's.
    """
    windings = Windings(shape)
    windings.add(start, end)
    return windings.numbers()


class Windings:
    """Sums up winding numbers of polygons."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """No polygons yet, on a grid of `shape` rows and columns."""
        self.shape = shape
        self._change = np.zeros((shape[0], shape[1] + 1), np.int32)
        self._work = Work()

    def add(self, start: Float[np.ndarray, "n 2"], end: Float[np.ndarray, "n 2"]) -> None:
        """Add edges, which make whole polygons in the end; raises as `winding_numbers` does."""
        height, width = self.shape
        rises = end[:, 1] > start[:, 1]
        low = np.where(rises[:, None], start, end)
        high = np.where(rises[:, None], end, start)
        first = np.clip(np.ceil(low[:, 1] - 0.5), 0, height).astype(np.int64)
        stop = np.clip(np.ceil(high[:, 1] - 0.5), 0, height).astype(np.int64)
        for span in self._work.parts(stop - first):
            edge, row = index_ranges(first[span], stop[span] - first[span])
            (x0, y0), (x1, y1) = low[span][edge].T, high[span][edge].T
            x = x0 + (row + 0.5 - y0) / (y1 - y0) * (x1 - x0)
            column = np.clip(np.ceil(x - 0.5), 0, width).astype(np.int64)
            np.add.at(self._change, (row, column), np.where(rises[span][edge], -1, 1))

    def numbers(self) -> Int[np.ndarray, "ny nx"]:
        """The winding numbers of all that was added."""
        return np.cumsum(self._change[:, :-1], axis=1, dtype=np.int32)


class Work:
    """Budget of pairs of shapes and rows."""

    def __init__(self) -> None:
        """The budget of one building."""
        self._left = _MOST_PAIRS

    def parts(self, counts: Int[np.ndarray, " n"]) -> Iterator[slice]:
        """Stretches whose counts sum up to PAIRS_AT_ONCE at most, or of one item; ValueError for too much work."""
        sums = np.cumsum(counts)
        self._left += _PAIRS_OF_ONE * len(counts) - (int(sums[-1]) if len(sums) else 0)
        if self._left < 0:
            raise ValueError(
                "its walls cross more rows of cells than any building's; a coarser resolution has fewer"
            )
        start, done = 0, 0
        while start < len(counts):
            stop = max(start + 1, int(np.searchsorted(sums, done + PAIRS_AT_ONCE, side="right")))
            yield slice(start, stop)
            start, done = stop, int(sums[stop - 1])


#: How far surfaces are moved to their back, and intervals shortened [cells].
MARGIN = 0.01
#: Triangles that are worked on at once.
AT_ONCE = 100_000


def cells_touched(
    triangles: Float[np.ndarray, "n 3 3"], low: float, high: float, shape: tuple[int, int]
) -> Bool[np.ndarray, "ny nx"]:
    """Cells that a triangle reaches into between two heights, both included.

    x and y are in cells (cell (iy, ix) goes from (ix, iy) to (ix + 1, iy + 1)), z and heights in any unit. Triangles
    are counter-clockwise seen from the front; what lies outside of `shape`, rows and columns, is left out.
    """
    # Runs of cells as +1 where one starts and -1 after its end: summed along a row, the number of runs.
    edges, work = np.zeros((shape[0], shape[1] + 1), np.int32), Work()
    for block in blocks(triangles):
        lower, upper = block.min(axis=1), block.max(axis=1)
        near = (upper >= (0, 0, low)).all(axis=1) & (lower <= (shape[1], shape[0], high)).all(axis=1)
        polygons = cut(block[near], low, high)[:, :, :2] - MARGIN * unit_normals(block[near])[:, None, :2]
        first, last = _whole(polygons[:, :, 1].min(axis=1), polygons[:, :, 1].max(axis=1), shape[0])
        for span in work.parts(last - first + 1):
            polygon, row = index_ranges(first[span], last[span] - first[span] + 1)
            begin, end = _whole(*_x_in_rows(polygons[span][polygon], row), shape[1])
            occupied = end >= begin
            np.add.at(edges, (row[occupied], begin[occupied]), 1)
            np.add.at(edges, (row[occupied], end[occupied] + 1), -1)
    return np.cumsum(edges[:, :-1], axis=1, dtype=np.int32) > 0


def blocks(triangles: Float[np.ndarray, "n 3 3"]) -> Iterator[Float[np.ndarray, "m 3 3"]]:
    """All triangles, some at a time, since intermediate results take ten times their memory."""
    for first in range(0, len(triangles), AT_ONCE):
        yield triangles[first : first + AT_ONCE]


def unit_normals(triangles: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit normals to the front; zero for triangles without area."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def cut(triangles: Float[np.ndarray, "n 3 3"], low: float, high: float) -> Float[np.ndarray, "n 6 3"]:
    """Polygons that two horizontal planes leave of triangles, all of which must reach between the planes.

    The start and end of each of the three edges, cut, are the six corners in order; where an edge is cut away
    whole, the corner before it stands there twice.
    """
    start, end = triangles, np.roll(triangles, -1, axis=1)
    z0, z1 = start[:, :, 2], end[:, :, 2]
    level = z0 == z1
    dz = np.where(level, 1.0, z1 - z0)
    with np.errstate(over="ignore"):  # almost level edges
        at_low, at_high = np.clip((low - z0) / dz, 0, 1), np.clip((high - z0) / dz, 0, 1)
    enter = np.where(level, 0.0, np.minimum(at_low, at_high))
    leave = np.where(level, 1.0, np.maximum(at_low, at_high))
    corners = np.empty((len(triangles), 6, 3))
    corners[:, 0::2] = start + enter[..., None] * (end - start)
    corners[:, 1::2] = start + leave[..., None] * (end - start)
    away = (np.maximum(z0, z1) < low) | (np.minimum(z0, z1) > high)
    for edge in range(3):  # at most one of the three is away
        corners[away[:, edge], 2 * edge : 2 * edge + 2] = corners[away[:, edge], 2 * edge - 1, None]
    return corners


def section(
    triangles: Float[np.ndarray, "n 3 3"], height: float
) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
    """Starts and ends of the lines in which triangles cross a height; neighbours meet in the very same points.

    The back of the surface is on the left: around the inside of closed surfaces they go counter-clockwise.
    """
    above = triangles[:, :, 2] >= height
    crossing = above.any(axis=1) & ~above.all(axis=1)
    start, above = triangles[crossing], above[crossing]
    end, end_above = np.roll(start, -1, axis=1), np.roll(above, -1, axis=1)
    # From below to above, in whichever direction the side runs, so that both triangles on it round alike.
    low, high = np.where(above[..., None], end, start), np.where(above[..., None], start, end)
    rise = np.where(above == end_above, 1.0, high[:, :, 2] - low[:, :, 2])
    points = low[:, :, :2] + ((height - low[:, :, 2]) / rise)[..., None] * (high - low)[:, :, :2]
    each = np.arange(len(points))
    falls, rises = np.argmax(above & ~end_above, axis=1), np.argmax(~above & end_above, axis=1)
    return points[each, falls], points[each, rises]


def _whole(
    low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"], size: int
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """First and last cell of intervals shortened by the margin, 0 to size - 1; last before first outside of it."""
    middle = (low + high) / 2
    first = np.floor(np.minimum(low + MARGIN, middle))
    last = np.floor(np.maximum(high - MARGIN, middle))
    return np.clip(first, 0, size).astype(np.int64), np.clip(last, -1, size - 1).astype(np.int64)


def _x_in_rows(
    polygons: Float[np.ndarray, "n 6 2"], row: Int[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Least and largest x of each polygon within a row of cells that it reaches into."""
    start, end = polygons, np.roll(polygons, -1, axis=1)
    low, high = row[:, None].astype(float), row[:, None] + 1.0
    x0, y0 = start[:, :, 0], start[:, :, 1]
    dx, y1 = end[:, :, 0] - x0, end[:, :, 1]
    level = y0 == y1
    dy = np.where(level, 1.0, y1 - y0)
    with np.errstate(over="ignore", invalid="ignore"):  # almost level edges of other rows
        enter = x0 + (np.clip(y0, low, high) - y0) / dy * dx
        leave = x0 + np.where(level, 1.0, (np.clip(y1, low, high) - y0) / dy) * dx
    away = (np.maximum(y0, y1) < low) | (np.minimum(y0, y1) > high)
    least = np.where(away, np.inf, np.minimum(enter, leave)).min(axis=1)
    largest = np.where(away, -np.inf, np.maximum(enter, leave)).max(axis=1)
    return least, largest
