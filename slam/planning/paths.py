"""Paths over a travel-time field: downhill cell by cell, then pulled taut into few straight legs.

A robot that turns in steps pays for every corner, and a path over cells is a staircase: some per cent too long, and
all corners. A straight leg that costs no more than the field says replaces all the cells it passes.
Reference: string pulling, as in Nash et al., Theta*: any-angle path planning on grids, AAAI 2007.
"""

import math
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from slam.planning.travel_time import TravelTime

#: Numbers of cells that a straight leg is first tried over.
_JUMPS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 2048])


def downhill(field: TravelTime, start: tuple[int, int]) -> Float[np.ndarray, "n 2"]:
    """Centres of the cells (x, y) [m] of steepest descent from a cell (row, column) to the source.

    Empty if the source is unreachable.
    """
    cells = _descent(np.ascontiguousarray(field.cost_m), *start)
    return field.frame.to_points(cells + 0.5) if len(cells) else np.empty((0, 2))


@compiled
def _descent(cost: np.ndarray, iy: int, ix: int) -> np.ndarray:
    """Cells (column, row) of steepest descent from one."""
    ny, nx = cost.shape
    cells = [(ix, iy)]
    if not np.isfinite(cost[iy, ix]):
        return np.empty((0, 2), np.int64)
    for _ in range(ny * nx):
        best, jx, jy = 0.0, ix, iy
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                x, y = ix + dx, iy + dy
                if (dx or dy) and 0 <= x < nx and 0 <= y < ny:
                    fall = (cost[iy, ix] - cost[y, x]) / np.sqrt(float(dx * dx + dy * dy))
                    if fall > best:
                        best, jx, jy = fall, x, y
        if best == 0.0:
            break
        ix, iy = jx, jy
        cells.append((ix, iy))
    return np.array(cells)


def taut(points: Float[np.ndarray, "n 2"], field: TravelTime) -> Float[np.ndarray, "m 2"]:
    """Replace a downhill path over cells by few straight legs.

    Each leg ends at the farthest point to which it costs no more than the field says. The field is discrete, so half a
    cell and some per cent more are allowed.
    """
    cost = field.at(points)
    corners, last = [0], len(points) - 1
    while corners[-1] < last:
        i = corners[-1]
        ends = i + np.append(_JUMPS[last - i > _JUMPS], last - i)
        best = _farthest(points, cost, i, ends, field)
        beyond = min(last, i + 2 * (best - i))
        if beyond - best > 3:
            best = max(best, _farthest(points, cost, i, np.linspace(best, beyond, 8).astype(int), field))
        corners.append(best)
    return points[corners]


def _farthest(
    points: Float[np.ndarray, "n 2"],
    cost: Float[np.ndarray, " n"],
    i: int,
    ends: Int[np.ndarray, " k"],
    field: TravelTime,
) -> int:
    """Farthest of some points to which a straight leg from point i is as good as the downhill path."""
    leg = field.of_legs(points[i], points[ends])
    good = leg <= 1.03 * (cost[i] - cost[ends]) + 0.5 * field.frame.resolution_m
    return int(ends[good][-1]) if good.any() else i + 1


def along(path: Float[np.ndarray, "n 2"], spacing_m: float, most_m: float) -> Float[np.ndarray, "m 2"]:
    """Points along the first `most_m` of a path, at most `spacing_m` apart, its corners included."""
    parts, left = [path[:1]], most_m
    for a, b in pairwise(path):
        leg = math.hypot(b[0] - a[0], b[1] - a[1])
        share = min(1.0, left / leg) if leg > 0 else 1.0
        n = max(1, math.ceil(leg * share / spacing_m))
        parts.append(a + (b - a) * (share * np.arange(1, n + 1) / n)[:, None])
        left -= leg
        if left <= 0:
            break
    return np.concatenate(parts)


def onward(path: Float[np.ndarray, "n 2"], here: Float[np.ndarray, "2"]) -> Float[np.ndarray, "m 2"]:
    """Return the rest of a path for a robot that is on one of its first legs, or near it."""
    if len(path) < 2:
        return np.vstack([here, path[-1:]])
    start, leg = path[:-1], np.diff(path, axis=0)
    share = ((here - start) * leg).sum(axis=1) / np.maximum((leg * leg).sum(axis=1), 1e-12)
    foot = start + np.clip(share, 0, 1)[:, None] * leg
    k = int(np.argmin(np.hypot(*(foot - here).T)[:3]))
    return np.vstack([here, path[k + 1 :]])


def arc_length(path: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Arc length of a path at each of its points [m]."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))


def length(path: Float[np.ndarray, "n 2"]) -> float:
    """Length of a path [m]."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum()) if len(path) > 1 else 0.0
