"""Slanted walls one cell thick, as many ROS maps and drawn lines have them: rows of cells that touch at corners.

The outlines of the two sides of such a wall have a corner in common at each step. From one step to the next both sides
are equally long and turn once, the one to the left, the other to the right. Several such pieces in a row, all leading
into the same quadrant or back, are a wall. Fewer are furniture and noise, whose corners touch by chance.
"""

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

#: Least number of pieces between steps, or of edges of cells along one side, of a wall.
_PIECES, _EDGES = 4, 24


def thin_wall_corners(outlines: list[Int[np.ndarray, "_ 2"]]) -> Int[np.ndarray, "m 2"]:
    """Corners at which the two sides of slanted walls one cell thick touch.

    Args:
        outlines: Corners of closed lines along the grid around free cells, which pass a corner twice where two free
            cells touch only there, and so keep to the cell that they came along.
    """
    corners = np.concatenate(outlines)
    _, place, count = np.unique(corners @ (1, 1j), return_inverse=True, return_counts=True)
    starts, ends, steps = [], [], []
    first = 0
    for outline in outlines:
        at = first + np.flatnonzero(count[place[first : first + len(outline)]] > 1)
        # Touching corners in a row with one turn between them.
        after = np.roll(at, -1)
        near = (after - at) % len(outline) == 2
        at, after = at[near], after[near]
        starts.append(place[at])
        ends.append(place[after])
        steps.append(corners[after] - corners[at])
        first += len(outline)
    start, end, step = np.concatenate(starts), np.concatenate(ends), np.concatenate(steps)
    # The other side goes back from the end of a piece to its start.
    both = np.isin(start * len(count) + end, end * len(count) + start)
    found = np.zeros(len(count), bool)
    for rising in (True, False):
        some = both & ((step[:, 0] * step[:, 1] > 0) == rising)
        links = coo_array((np.ones(some.sum()), (start[some], end[some])), shape=(len(count),) * 2)
        _, wall = connected_components(links, directed=False)
        pieces = np.bincount(wall[start[some]], minlength=len(count)) / 2
        edges = np.bincount(wall[start[some]], np.abs(step[some]).sum(axis=1), len(count)) / 2
        long = (pieces >= _PIECES) | (edges >= _EDGES)
        found |= long[wall] & np.isin(np.arange(len(count)), start[some])
    return np.unique(corners[found[place]], axis=0)
