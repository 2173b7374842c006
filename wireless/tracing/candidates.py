"""Candidates for paths among very many triangles: chains and edges that rays of either end find.

A transmitter's rays serve all receivers, a receiver's only its own links (and those of the transmitters that are
traced with it), so that receivers shoot a fixed share of what transmitters do. What rays find for a point depends
on nothing but the point and the number of rays.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wireless.geometry.images import Space
from wireless.geometry.shooting import Shooter, Sightings
from wireless.tracing.ray_search import Sights, sights
from wireless.tracing.table import Setting

#: A receiver shoots one ray where a transmitter shoots so many.
RX_SHARE = 16
#: Rays that are shot at once: some 400 bytes each.
_AT_ONCE = 100_000


@dataclass(frozen=True, eq=False)
class Near:
    """What a transmitter may see."""

    chains: Int[np.ndarray, "c m"]
    """No patch, each patch alone, and those found by rays, by length and in rising order; -1 beyond the last."""
    edges: Sights
    """All edges directly, and those that rays found over patches."""


class Candidates:
    """Finds what may be seen from points of a space.

    Args:
        space: Surfaces.
        setting: Limits of paths.
        rays: Rays from each transmitter.
    """

    def __init__(self, space: Space, setting: Setting, rays: int):
        self._space, self._setting, self._rays = space, setting, rays
        self._side = setting.side_reflections if len(space.surfaces.edge) else -1
        self._shooter = Shooter(space)

    def of_transmitter(self, tx: Float[np.ndarray, "3"]) -> Near:
        """Chains from a transmitter, and edges that it sees."""
        most, shining = (
            self._setting.max_reflections,
            np.flatnonzero(self._space.mirrors[self._space.patch_facet]),
        )
        seen = self._shooter.shoot(tx[None], self._rays, most, self._side)
        parts = [np.empty((1, 0), np.int64), shining[:, None], *seen.chains][: most + 1]
        chains = np.full((sum(map(len, parts)), most), -1, np.int64)
        row = 0
        for part in parts:
            chains[row : row + len(part), : part.shape[1]] = part
            row += len(part)
        return Near(chains, self._sights(tx[None], seen, self._side >= 0))

    def of_receivers(self, rx: Float[np.ndarray, "r 3"]) -> Sights:
        """Edges that receivers see over patches."""
        rays = max(1, self._rays // RX_SHARE)
        if self._side < 1:
            nothing = np.zeros(len(rx) + 1, np.int64), np.empty(0, np.int64), np.empty((0, 1), np.int64)
            return sights(self._space, rx, *nothing, False)
        step = max(1, _AT_ONCE // rays)
        parts = []
        for i in range(0, len(rx), step):
            some = rx[i : i + step]
            parts.append(self._sights(some, self._shooter.shoot(some, rays, 0, self._side), False))
        count = np.concatenate([np.diff(p.start) for p in parts])
        return Sights(
            np.append(0, np.cumsum(count)),
            *(np.concatenate([getattr(p, name) for p in parts]) for name in Sights._fields[1:]),
        )

    def _sights(self, points: Float[np.ndarray, "s 3"], seen: Sightings, alone: bool) -> Sights:
        return sights(self._space, points, seen.start, seen.edge, seen.over, alone)
