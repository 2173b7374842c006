"""Neighbours: patches that share a corner of a triangle, edges that share an end; and pairs next to those found.

A search by rays misses what is seen through narrow gaps, and nearly all of that is next to what it finds: the next
patch behind the same edge, the next edge over the same patch.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from wireless.geometry.facets import counted
from wireless.geometry.space import Space

#: Corners closer than this are one [m].
_SAME_M = 1e-6


class Neighbours(NamedTuple):
    """Neighbours of each of some things; each is its own neighbour."""

    start: Int[np.ndarray, " n1"]
    """Where the neighbours of each begin, and an end."""
    other: Int[np.ndarray, " m"]
    """Neighbours."""

    def of(self, things: Int[np.ndarray, " k"]) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
        """All neighbours of some things: which of the some, and the neighbour."""
        return gathered(self.start, self.other, things)


def gathered(
    start: Int[np.ndarray, " n1"], member: Int[np.ndarray, " m"], groups: Int[np.ndarray, " k"]
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Members of some groups, of which it is given where each begins: which of the some, and the member."""
    count = start[groups + 1] - start[groups]
    row = np.repeat(np.arange(len(groups)), count)
    return row, member[start[groups[row]] + counted(count)]


def patch_neighbours(space: Space) -> Neighbours:
    """Patches that share a corner of a triangle."""
    n = len(space.patch_facet)
    return _neighbours(
        np.repeat(np.arange(n), 3 * np.diff(space.ground.start)), space.ground.triangle.reshape(-1, 3), n
    )


def edge_neighbours(space: Space) -> Neighbours:
    """Edges that share an end."""
    ends = space.surfaces.edge
    return _neighbours(np.repeat(np.arange(len(ends)), 2), ends.reshape(-1, 3), len(ends))


def with_neighbours(
    pairs: Int[np.ndarray, "n 2"],
    near: tuple[Neighbours, Neighbours],
    possible: Callable[[Int[np.ndarray, "_ 2"]], Int[np.ndarray, "_ 2"]],
) -> Int[np.ndarray, "m 2"]:
    """Pairs, and those with a neighbour in place of the second, and of these with a neighbour in place of the first.

    Args:
        pairs: Pairs that were found.
        near: Neighbours of firsts, and of seconds.
        possible: Which of some pairs, by first and second, can be at all.

    Returns:
        Pairs by first and second; none twice.
    """
    size = max(len(near[1].start), 1)
    key = np.unique(pairs[:, 0] * size + pairs[:, 1])
    for column in (1, 0):
        pairs = np.column_stack(np.divmod(key, size))
        row, other = near[column].of(pairs[:, column])
        more = pairs[row]
        more[:, column] = other
        new = np.setdiff1d(more[:, 0] * size + more[:, 1], key)
        able = possible(np.column_stack(np.divmod(new, size)))
        key = np.union1d(key, able[:, 0] * size + able[:, 1])
    return np.column_stack(np.divmod(key, size))


def _neighbours(owner: Int[np.ndarray, " c"], corner: Float[np.ndarray, "c 3"], n: int) -> Neighbours:
    """Neighbours among n things, from corners and whose each is."""
    _, place = np.unique(np.round(corner / _SAME_M).astype(np.int64), axis=0, return_inverse=True)
    place = place.ravel()
    touches = csr_array((np.ones(len(owner), np.int32), (owner, place)), shape=(n, place.max(initial=0) + 1))
    both = (touches @ touches.T).tocsr()
    return Neighbours(both.indptr.astype(np.int64), both.indices.astype(np.int64))
