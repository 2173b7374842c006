"""Winding numbers of polygons around the centres of the cells of a grid.

Along a row of centres, each edge that is crossed changes the winding number of all centres to its right: by one up or
down, as the edge goes down or up. Running sums along the rows compute all of them at once. An edge counts in the rows
whose centre y lies from its lower end to just below its upper one, so that no corner is crossed twice and polygons
that share an edge neither overlap nor leave a gap.

Reference: Foley et al., "Computer Graphics: Principles and Practice", 2nd ed., 3.6 (scan conversion).
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

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
        for part in self._work.parts(stop - first):
            edge, row = index_ranges(first[part], stop[part] - first[part])
            (x0, y0), (x1, y1) = low[part][edge].T, high[part][edge].T
            x = x0 + (row + 0.5 - y0) / (y1 - y0) * (x1 - x0)
            column = np.clip(np.ceil(x - 0.5), 0, width).astype(np.int64)
            np.add.at(self._change, (row, column), np.where(rises[part][edge], -1, 1))

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
