"""Which sides of patches can be reached at all: the inside of an opaque body is never seen from outside.

Each patch of a closed surface has the inside of that on one side and the outside on the other, unless the surface
crosses itself there. A path that does not cross the surface begins and ends on the same side of it, so that a point
reaches only one side of the patch. Half of all patches are turned away from any edge, and need not be tried.
"""

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Point, Polygon, Triangles
from wireless.geometry.closed_surfaces import Sides
from wireless.geometry.space import Panes, Space, Windows

#: How far off a patch points are tested for being inside [m].
_OFF_M = 1e-7


class Backs:
    """Sides of the patches of a space."""

    def __init__(self, space: Space):
        ground = space.ground
        count = np.diff(ground.start)
        patch, first = np.repeat(np.arange(len(count)), count), ground.start[:-1]
        corners = ground.triangle.reshape(-1, 3)
        faces, near_m = np.arange(len(corners)).reshape(-1, 3), space.tree.near_m
        self._sides = Sides(trimesh.Trimesh(corners, faces, process=False), near_m)
        surface = self._sides.surface
        known = self._sides.closed & ~space.passes[space.patch_facet[patch]]
        known &= ~np.isin(surface, surface[~known])
        self._surface = surface[first]
        self._known = known[first]
        self._known[patch[surface != self._surface[patch]]] = False
        order = np.argsort(surface, kind="stable")
        start = np.searchsorted(surface[order], np.arange(surface.max(initial=0) + 2))
        plane = space.panes.plane
        self._known &= ~_crossed(
            space.panes, space.windows, self._surface, ground.triangle[order], start, 4 * near_m
        )
        centre = ground.triangle[first].mean(axis=1)
        (front, on), (back, also) = (
            self._sides.inside(centre + off * plane[:, :3], self._surface)
            for off in (_OFF_M + 2 * near_m, -_OFF_M - 2 * near_m)
        )
        self._known &= (front != back) & ~on & ~also
        self._front = front

    def seen_from(self, point: Point) -> Int[np.ndarray, " p"]:
        """Sides of patches that may be reached from a point: 1 for that of the normal, -1 for the other, 0 for both."""
        surfaces, which = np.unique(self._surface[self._known], return_inverse=True)
        inside, on = self._sides.inside(np.tile(point, (len(surfaces), 1)), surfaces)
        seen = np.zeros(len(self._known), np.int64)
        seen[self._known] = np.where(on[which], 0, np.where(inside[which] == self._front[self._known], 1, -1))
        return seen


@compiled
def _crossed(
    panes: Panes,
    windows: Windows,
    surface: Int[np.ndarray, " p"],
    triangle: Triangles,
    start: Int[np.ndarray, " s1"],
    near_m: float,
) -> Bool[np.ndarray, " p"]:
    """Whether triangles of each patch's surface, sorted by surface, cross the window around it."""
    plane, low, high, crossed = panes.plane, panes.low, panes.high, np.zeros(len(panes.plane), np.bool_)
    off, ends = np.empty(3), np.empty((2, 3))
    for p in range(len(plane)):
        for t in range(start[surface[p]], start[surface[p] + 1]):
            apart = False
            for i in range(3):
                a, b, c = triangle[t, 0, i], triangle[t, 1, i], triangle[t, 2, i]
                apart = apart or min(a, b, c) > high[p, i] + near_m or max(a, b, c) < low[p, i] - near_m
            if apart:
                continue
            for k in range(3):
                off[k] = -plane[p, 3]
                for i in range(3):
                    off[k] += plane[p, i] * triangle[t, k, i]
            if min(off) >= -near_m or max(off) <= near_m:
                continue
            n = 0  # where sides of the triangle meet the plane
            for k in range(3):
                j = (k + 1) % 3
                if (off[k] < 0) != (off[j] < 0):
                    share = off[k] / (off[k] - off[j])
                    for i in range(3):
                        ends[n, i] = triangle[t, k, i] + share * (triangle[t, j, i] - triangle[t, k, i])
                    n += 1
            if _enters(ends, windows.window[p, : windows.corners[p]], plane[p], near_m):
                crossed[p] = True
                break
    return crossed


@compiled
def _enters(
    ends: Float[np.ndarray, "2 3"], window: Polygon, plane: Float[np.ndarray, "4"], near_m: float
) -> bool:
    """Whether a line between two points of a plane enters a convex window there by more than rounding."""
    first, last, n = 0.0, 1.0, len(window)
    for k in range(n):
        a, b, c = window[k], window[(k + 1) % n], window[(k + 2) % n]
        depth, size, inner = np.zeros(2), 0.0, 0.0
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            across = plane[j] * (b[m] - a[m]) - plane[m] * (b[j] - a[j])
            size += across * across
            inner += across * (c[i] - a[i])
            for e in range(2):
                depth[e] += across * (ends[e, i] - a[i])
        depth *= np.sign(inner) / np.sqrt(size)
        start, other = depth[0] - near_m, depth[1] - near_m
        if start < 0 and other < 0:
            return False
        if start < 0:
            first = max(first, start / (start - other))
        elif other < 0:
            last = min(last, start / (start - other))
    return first < last
