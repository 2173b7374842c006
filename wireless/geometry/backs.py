"""Which sides of patches can be reached at all: nobody outside of a body that lets nothing through sees its inside.

Each patch of a closed surface has the inside of that on one side and the outside on the other, unless the surface
crosses itself there. A way that does not cross the surface begins and ends on the same side of it, so that a point
reaches only one side of the patch. Half of all patches are turned away from any edge, and need not be tried.
"""

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from wireless.geometry.closed import Sides
from wireless.geometry.images import Space
from wireless.geometry.occlusion import NEAR_M
from wireless.support.compiled import compiled

#: How far off a patch its sides are asked what they are inside of [m].
_OFF_M = 1e-7


class Backs:
    """Sides of the patches of a space.

    Args:
        space: Surfaces.
    """

    def __init__(self, space: Space):
        count = np.diff(space.start)
        patch, first = np.repeat(np.arange(len(count)), count), space.start[:-1]
        corners = space.triangle.reshape(-1, 3)
        self._sides = Sides(trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False))
        surface = self._sides.surface
        known = self._sides.closed & ~space.passes[space.patch_facet[patch]]
        known &= ~np.isin(surface, surface[~known])
        self._surface = surface[first]
        self._known = known[first]
        self._known[patch[surface != self._surface[patch]]] = False
        order = np.argsort(surface, kind="stable")
        start = np.searchsorted(surface[order], np.arange(surface.max(initial=0) + 2))
        plane, panes = space.panes.plane, space.panes
        _cross(plane, panes.low, panes.high, self._surface, space.triangle[order], start, self._known)
        centre = space.triangle[first].mean(axis=1)
        (front, on), (back, also) = (
            self._sides.inside(centre + off * plane[:, :3], self._surface) for off in (_OFF_M, -_OFF_M)
        )
        self._known &= (front != back) & ~on & ~also
        self._front = front

    def seen_from(self, point: Float[np.ndarray, "3"]) -> Int[np.ndarray, " p"]:
        """Sides of patches that may be reached from a point: 1 for that of the normal, -1 for the other, 0 for both."""
        some, which = np.unique(self._surface[self._known], return_inverse=True)
        inside, on = self._sides.inside(np.tile(point, (len(some), 1)), some)
        seen = np.zeros(len(self._known), np.int64)
        seen[self._known] = np.where(on[which], 0, np.where(inside[which] == self._front[self._known], 1, -1))
        return seen


@compiled
def _cross(
    plane: Float[np.ndarray, "p 4"],
    low: Float[np.ndarray, "p 3"],
    high: Float[np.ndarray, "p 3"],
    surface: Int[np.ndarray, " p"],
    triangle: Float[np.ndarray, "t 3 3"],
    start: Int[np.ndarray, " s1"],
    known: Bool[np.ndarray, " p"],
) -> None:
    """Take out of `known` each patch that other triangles of its surface, sorted by surface, might cross."""
    for p in range(len(plane)):
        t = start[surface[p]]
        while known[p] and t < start[surface[p] + 1]:
            beside, least, most = False, np.inf, -np.inf
            for i in range(3):
                a, b, c = triangle[t, 0, i], triangle[t, 1, i], triangle[t, 2, i]
                beside = beside or min(a, b, c) > high[p, i] + NEAR_M or max(a, b, c) < low[p, i] - NEAR_M
            if not beside:
                for k in range(3):
                    off = -plane[p, 3]
                    for i in range(3):
                        off += plane[p, i] * triangle[t, k, i]
                    least, most = min(least, off), max(most, off)
                known[p] = least >= -NEAR_M or most <= NEAR_M
            t += 1
