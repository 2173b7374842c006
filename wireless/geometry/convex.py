"""Convex polygons in the plane, counter-clockwise, cut by lines."""

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import FlatPolygon
from wireless.geometry.plan import NEAR_M


@compiled
def cut_to_left(
    polygon: FlatPolygon, n: int, ax: float, ay: float, bx: float, by: float, spare: FlatPolygon
) -> int:
    """Cut a polygon of n corners, in place, to what is left of the line from a to b; its new number of corners."""
    m, dx, dy = 0, bx - ax, by - ay
    for k in range(n):
        p, q = polygon[k], polygon[(k + 1) % n]
        here, there = dx * (p[1] - ay) - dy * (p[0] - ax), dx * (q[1] - ay) - dy * (q[0] - ax)
        if here >= 0:
            spare[m, 0], spare[m, 1] = p[0], p[1]
            m += 1
        if (here > 0 and there < 0) or (here < 0 and there > 0):
            f = here / (here - there)
            spare[m, 0], spare[m, 1] = p[0] + f * (q[0] - p[0]), p[1] + f * (q[1] - p[1])
            m += 1
    if m < 3:
        return 0
    polygon[:m] = spare[:m]
    return m


@compiled
def without_doubles(polygon: FlatPolygon, n: int) -> int:
    """Drop corners that coincide with another one but for rounding, as the side between has no direction."""
    m = 0
    for k in range(n):
        before = polygon[m - 1] if m > 0 else polygon[n - 1]
        if (polygon[k, 0] - before[0]) ** 2 + (polygon[k, 1] - before[1]) ** 2 > NEAR_M**2:
            polygon[m] = polygon[k]
            m += 1
    return m if m >= 3 else 0


@compiled
def area_of(polygon: FlatPolygon, n: int) -> float:
    """Area of a polygon of n corners."""
    total = 0.0
    for k in range(1, n - 1):
        total += (polygon[k, 0] - polygon[0, 0]) * (polygon[k + 1, 1] - polygon[0, 1]) - (
            polygon[k, 1] - polygon[0, 1]
        ) * (polygon[k + 1, 0] - polygon[0, 0])
    return total / 2


@compiled
def in_common(
    first: Float[np.ndarray, "n 3 2"], other: Float[np.ndarray, "n 3 2"]
) -> tuple[Float[np.ndarray, "n 8 2"], Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Compute the intersection of pairs of triangles: corners, zeros beyond the last, their number, and the area."""
    corner, count, area = np.zeros((len(first), 8, 2)), np.zeros(len(first), np.int64), np.zeros(len(first))
    polygon, spare = np.empty((8, 2)), np.empty((8, 2))
    for i in range(len(first)):
        polygon[:3], n = first[i], 3
        for k in range(3):
            if n > 0:
                a, b = other[i, k], other[i, (k + 1) % 3]
                n = cut_to_left(polygon, n, a[0], a[1], b[0], b[1], spare)
        n = without_doubles(polygon, n)
        corner[i, :n], count[i], area[i] = polygon[:n], n, area_of(polygon, n)
    return corner, count, area
