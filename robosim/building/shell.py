"""Closed shells of triangles: corners at one place become vertices, one for each fan of triangles around it.

Where two parts of a surface touch at a point or along a line, each has vertices of its own there, so that every edge
has exactly two triangles. Around a line with more than two, those belong together that bound the same free space.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

#: Corners whose coordinates differ by less are merged [m].
SAME_M = 1e-8


def make_shell(
    corner: Float[np.ndarray, "n 3 3"],
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "m 3"], Int[np.ndarray, " m"]]:
    """Vertices and faces of triangles [m] that make closed shells, with normals into free space.

    Returns:
        Vertices, faces, and the triangle of each face; triangles with two corners at one place are dropped.
    """
    place = np.unique(np.round(corner.reshape(-1, 3) / SAME_M).astype(np.int64), axis=0, return_inverse=True)[
        1
    ]
    triangle = place.reshape(-1, 3)
    proper = np.flatnonzero((triangle != np.roll(triangle, -1, axis=1)).all(axis=1))
    triangle, corner, place = triangle[proper], corner[proper], triangle[proper].ravel()
    start, end = triangle.ravel(), np.roll(triangle, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((high, low))
    new = np.append(True, (np.diff(low[order]) > 0) | (np.diff(high[order]) > 0))
    first = np.flatnonzero(new)
    count = np.diff(np.append(first, len(order)))
    mate = np.full(len(start), -1)
    pairs = order[first[count == 2][:, None] + np.arange(2)]
    mate[pairs], mate[pairs[:, ::-1]] = pairs[:, ::-1], pairs
    for at, size in zip(first[count != 2], count[count != 2], strict=True):
        _pair(order[at : at + size], corner, start, mate)
    if (mate < 0).any() or (start[mate] != end).any():
        side = int(np.flatnonzero((mate < 0) | (start[mate] != end))[0])
        raise RuntimeError(f"The shell is open at the edge from {corner.reshape(-1, 3)[side]} on.")
    ends = np.arange(len(start)), 3 * (np.arange(len(start)) // 3) + (np.arange(len(start)) + 1) % 3
    # A side starts where its mate ends.
    links = coo_array((np.ones(len(start), bool), (ends[0], ends[1][mate])), shape=(len(start),) * 2)
    n, label = connected_components(links, directed=False)
    vertices = np.empty((n, 3))
    _, one, again = np.unique(place, return_index=True, return_inverse=True)
    vertices[label] = corner.reshape(-1, 3)[one[again]]
    return vertices, label.reshape(-1, 3), proper


def _pair(
    sides: Int[np.ndarray, " k"],
    corner: Float[np.ndarray, "n 3 3"],
    start: Int[np.ndarray, " s"],
    mate: Int[np.ndarray, " s"],
) -> None:
    """Pair the triangle sides on one line, each with the next one around it on the free side of its triangle."""

    def into(side: int) -> Float[np.ndarray, "3"]:
        """Direction into a side's triangle, at right angles to the line."""
        direction = corner[side // 3, (side % 3 + 2) % 3] - corner[side // 3, side % 3]
        direction = direction - (direction @ along) * along
        return direction / np.linalg.norm(direction)

    first = sides[0]
    along = corner[first // 3, (first % 3 + 1) % 3] - corner[first // 3, first % 3]
    along = along / np.linalg.norm(along)
    inward = {int(side): into(int(side)) for side in sides}
    for side in inward:
        forth = along if start[side] == start[first] else -along
        normal = np.cross(forth, inward[side])
        turn = {
            other: np.arctan2(inward[other] @ normal, inward[other] @ inward[side]) % (2 * np.pi)
            for other in inward
            if start[other] != start[side]
        }
        if turn:
            mate[side] = min(turn, key=lambda other: (turn[other], other))
