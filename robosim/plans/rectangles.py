"""Solids of a plan as few rectangles.

The walls of a plan that was not simplified follow a lattice: axis-aligned, and with walls through the centres of
cells also at 45 degrees, along diagonals of its squares. Each square is then free, solid, or half solid. Solid
squares next to free space are covered greedily by rectangles that grow as far as the solid goes. The half squares
along a slope become one rotated rectangle, half a diagonal thick, if the solid behind them allows; it always does if
walls come from cells.

Units are squares of the lattice throughout. Left out: the fewest possible rectangles.
"""

from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.index_ranges import index_ranges

# Both diagonals cut a square into four quarters, named by the side that they touch.
EAST, NORTH, WEST, SOUTH = range(4)
_CENTROIDS = np.array([[0.75, 0.5], [0.5, 0.75], [0.25, 0.5], [0.5, 0.25]])

#: Rectangles grow by at most this many squares to a side, which bounds the time to find them.
_MAX_GROWTH = 256


def lattice_solids(
    walls: Int[np.ndarray, "n 2 2"], margin: int
) -> tuple[Float[np.ndarray, "_ 5"], list[Float[np.ndarray, "_ 2"]]] | None:
    """Rectangles and triangles on the solid side of walls along a lattice.

    Args:
        walls: Ends of the straight pieces of the boundary of free space, in any order; closed rings.
        margin: Squares of solid to assume around everything.

    Returns:
        Rectangles as centre x, y, half length along and across, yaw of the length; and triangles, counter-clockwise,
        for half squares that a rectangle would not fit behind. None if a square is neither free, solid nor half solid.
    """
    lowest = walls.min(axis=(0, 1)) - margin
    size = walls.max(axis=(0, 1)) - lowest + margin
    solid: Bool[np.ndarray, "ny nx 4"] = ~free_quarters(walls - lowest, (int(size[1]), int(size[0])))
    full, none = np.asarray(solid.all(axis=-1)), ~solid.any(axis=-1)
    halves = {corner: (solid == _half(corner)).all(axis=-1) for corner in product((0, 1), (0, 1))}
    if not np.logical_or.reduce([full, none, *halves.values()]).all():
        return None
    slopes = [_slopes(solid, corner, half) for corner, half in halves.items() if half.any()]
    boxes = np.vstack([_cover(full, _next_to_free(solid)), *(boxes for boxes, _ in slopes)])
    boxes[:, :2] += lowest
    return boxes, [triangle + lowest for _, triangles in slopes for triangle in triangles]


def free_quarters(walls: Int[np.ndarray, "n 2 2"], shape: tuple[int, int]) -> Bool[np.ndarray, "ny nx 4"]:
    """Quarters of (rows, columns) of squares that are free: their centroids see an odd number of walls to the left."""
    walls = walls[walls[:, 0, 1] != walls[:, 1, 1]]
    (x0, y0), (x1, y1) = walls[:, 0].T, walls[:, 1].T
    length = np.abs(y1 - y0)
    wall, row = index_ranges(np.minimum(y0, y1), length)
    slope = ((x1 - x0) / (y1 - y0))[wall]
    free = np.empty((*shape, 4), bool)
    for quarter, (x, y) in enumerate(_CENTROIDS):
        crossing = x0[wall] + slope * (row + y - y0[wall])
        column = np.floor(crossing - x).astype(int) + 1
        crossings = np.bincount(row * shape[1] + column, minlength=shape[0] * shape[1]).reshape(shape)
        free[..., quarter] = np.cumsum(crossings, axis=1) % 2 == 1
    return free


def _next_to_free(solid: Bool[np.ndarray, "ny nx 4"]) -> Bool[np.ndarray, "ny nx"]:
    """Solid squares with a free quarter across one of their sides."""
    free = np.pad(~solid, ((1, 1), (1, 1), (0, 0)))
    is_next = free[1:-1, 2:, WEST] | free[2:, 1:-1, SOUTH] | free[1:-1, :-2, EAST] | free[:-2, 1:-1, NORTH]
    return is_next & solid.all(axis=-1)


def _half(corner: tuple[int, int]) -> Bool[np.ndarray, "4"]:
    """Solid quarters of a square whose half at `corner` is solid."""
    x, y = corner
    return np.array([x == 1, y == 1, x == 0, y == 0])


def _cover(solid: Bool[np.ndarray, "ny nx"], wanted: Bool[np.ndarray, "ny nx"]) -> Float[np.ndarray, "_ 5"]:
    """Rectangles inside of the solid that cover all wanted squares, found greedily row by row."""
    todo, found = wanted.copy(), []
    for iy, ix in np.argwhere(wanted).tolist():
        if not todo[iy, ix]:
            continue
        wide = _grow(solid, iy, ix, "xy")
        tall = _grow(solid, iy, ix, "yx")
        best = max(wide, tall, key=lambda box: int(todo[box].sum()))
        todo[best] = False
        found.append((best[1].start, best[0].start, best[1].stop, best[0].stop))
    x0, y0, x1, y1 = np.array(found, float).reshape(-1, 4).T
    return np.column_stack([(x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0) / 2, (y1 - y0) / 2, np.zeros_like(x0)])


def _grow(solid: Bool[np.ndarray, "ny nx"], iy: int, ix: int, order: str) -> tuple[slice, slice]:
    """Largest solid rectangle around a square that is first grown along one axis, then along the other."""
    rows, columns = slice(iy, iy + 1), slice(ix, ix + 1)
    for axis in order:
        if axis == "x":
            strip = np.logical_and.reduce(solid[rows], axis=0)
            columns = slice(ix - _run(strip[ix::-1]) + 1, ix + _run(strip[ix:]))
        else:
            strip = np.logical_and.reduce(solid[:, columns], axis=1)
            rows = slice(iy - _run(strip[iy::-1]) + 1, iy + _run(strip[iy:]))
    return rows, columns


def _run(strip: Bool[np.ndarray, " _"]) -> int:
    """Number of true elements that a strip begins with, up to the growth allowed."""
    strip = strip[:_MAX_GROWTH]
    return len(strip) if strip.all() else int(strip.argmin())


def _slopes(
    solid: Bool[np.ndarray, "ny nx 4"], corner: tuple[int, int], half: Bool[np.ndarray, "ny nx"]
) -> tuple[Float[np.ndarray, "_ 5"], list[Float[np.ndarray, "_ 2"]]]:
    """Rotated rectangles behind the slopes of half squares, solid at a corner only, and triangles if none fits."""
    x, y = corner
    iy, ix = np.nonzero(half)
    # A rectangle also fills the quarters on the far side of the two legs of the half square.
    fits = (
        solid[iy, ix + (1 if x else -1), WEST if x else EAST]
        & solid[iy + (1 if y else -1), ix, SOUTH if y else NORTH]
    )
    ends = np.array([(x, 1 - y), (1 - x, y)])
    alone = np.column_stack([ix, iy])[~fits]
    triangle = np.array([corner, *ends]) if x != y else np.array([corner, *ends[::-1]])
    triangles = [square + triangle.astype(float) for square in alone]

    ix, iy = ix[fits], iy[fits]
    if len(ix) == 0:
        return np.empty((0, 5)), triangles
    climb = -1 if x == y else 1
    line = iy - climb * ix
    by_line = np.lexsort([ix, line])
    ix, iy, line = ix[by_line], iy[by_line], line[by_line]
    first = np.flatnonzero(np.diff(line, prepend=-1 << 30) | (np.diff(ix, prepend=-1 << 30) != 1))
    last = np.append(first[1:], len(ix)) - 1
    left, right = ends[np.argsort(ends[:, 0])]
    start = np.column_stack([ix[first], iy[first]]) + left
    slope = np.column_stack([ix[last], iy[last]]) + right - start
    centre = start + slope / 2 + (np.array(corner) - 0.5) / 2
    n = len(first)
    sizes = np.column_stack(
        [np.hypot(*slope.T) / 2, np.full(n, np.sqrt(2) / 4), np.full(n, climb * np.pi / 4)]
    )
    return np.hstack([centre, sizes]), triangles
