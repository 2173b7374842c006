"""Candidates for paths among very many triangles: chains and edges that rays of either end find.

A transmitter's rays serve all receivers, a receiver's only its own links (and those of the transmitters that are
traced with it), so that receivers shoot a fixed share of what transmitters do. What rays find for a point depends
on nothing but the point and the number of rays.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numba.typed import List

from wireless.geometry.images import Space
from wireless.geometry.occlusion import make_boxes
from wireless.geometry.shooting import Shooter
from wireless.tracing.ray_search import (
    Sights,
    bend,
    by_edge,
    make_lists,
    pairs_of_patches,
    reflect,
    sights,
    tabled,
)
from wireless.tracing.table import Setting, Table, most_interactions

#: A receiver shoots one ray where a transmitter shoots so many.
RX_SHARE = 16
#: A patch's cone takes as long as so many rays.
FEWER = 4
#: Rays that are shot at once: some 400 bytes each.
_AT_ONCE = 100_000
#: Numbers in the lists of all links that are traced at once.
_IN_LISTS = 10_000_000


@dataclass(frozen=True, eq=False)
class Near:
    """What a transmitter may see."""

    chains: Int[np.ndarray, "c m"]
    """No patch, each patch alone, and those found by rays, by length and in rising order; -1 beyond the last."""
    edges: Sights
    """All edges directly, and those that rays found over patches."""


class Candidates:
    """Finds what may be seen from points of a space, and traces links among that.

    Args:
        space: Surfaces.
        setting: Limits of paths.
        rays: Rays from each transmitter.
    """

    def __init__(self, space: Space, setting: Setting, rays: int):
        self._space, self._setting, self._rays = space, setting, rays
        self._side = setting.side_reflections if len(space.surfaces.edge) else -1
        self._shooter = Shooter(space)
        # Where rays would take longer than the cones of all patches, these are complete besides.
        self._few = FEWER * len(space.patch_boxes.number) <= rays // RX_SHARE

    def of_transmitter(self, tx: Float[np.ndarray, "3"]) -> Near:
        """Chains from a transmitter, and edges that it sees."""
        space, most = self._space, self._setting.max_reflections
        # Where patches are few, rays are left what is longer.
        rays = self._rays if max(most - 1, self._side) > self._few else 0
        seen = self._shooter.shoot(tx[None], rays, most, self._side)
        alone = np.sort(space.patch_boxes.number)[:, None]
        parts = [np.empty((1, 0), np.int64), alone, *seen.chains][: most + 1]
        if self._few and most > 1:
            pairs = pairs_of_patches(space, tx)
            parts[2] = pairs[np.lexsort(pairs.T[::-1])]
        chains = np.full((sum(map(len, parts)), most), -1, np.int64)
        row = 0
        for part in parts:
            chains[row : row + len(part), : part.shape[1]] = part
            row += len(part)
        found = sights(space, tx[None], seen.start, seen.edge, seen.over, self._side >= 0, self._few)
        return Near(chains, by_edge(found) if self._setting.edge_reflections > 1 else found)

    def trace(
        self, near: list[Near], tx: Float[np.ndarray, "t 3"], rx: Float[np.ndarray, "r 3"]
    ) -> Iterator[Table]:
        """Strongest paths from transmitters, of which is known what they see, to receivers."""
        a_list = self._setting.keep * (8 + int(most_interactions(self._setting)))
        step = max(1, _IN_LISTS // (a_list * max(1, len(rx))))
        for i in range(0, len(tx), step):
            yield from self._traced(near[i : i + step], tx[i : i + step], rx)

    def _traced(
        self, near: list[Near], tx: Float[np.ndarray, "t 3"], rx: Float[np.ndarray, "r 3"]
    ) -> Iterator[Table]:
        """The same of so many transmitters that their lists fit into memory."""
        space, setting = self._space, self._setting
        lists, boxes = make_lists(setting, len(tx), len(rx)), make_boxes(rx, rx)
        for t, (one, seen) in enumerate(zip(tx, near, strict=True)):
            reflect(space, setting, one, rx, boxes, seen.chains, lists, t)
        if self._side >= 0:
            sights_of_tx = List([seen.edges for seen in near])
            bend(space, setting, tx, rx, sights_of_tx, *self._over_patches(rx), self._few, lists)
        for t, one in enumerate(tx):
            yield tabled(space, setting, one, rx, lists, t)

    def _over_patches(
        self, rx: Float[np.ndarray, "r 3"]
    ) -> tuple[Int[np.ndarray, " r1"], Int[np.ndarray, " q"], Int[np.ndarray, "q m"]]:
        """Edges that receivers' rays find over patches; where each receiver's begin, edges and patches."""
        if self._side < (2 if self._few else 1):
            return (
                np.zeros(len(rx) + 1, np.int64),
                np.empty(0, np.int64),
                np.empty((0, max(self._side, 1)), np.int64),
            )
        rays = max(1, self._rays // RX_SHARE)
        step = max(1, _AT_ONCE // rays)
        parts = [self._shooter.shoot(rx[i : i + step], rays, 0, self._side) for i in range(0, len(rx), step)]
        count = np.concatenate([np.diff(part.start) for part in parts])
        return (
            np.append(0, np.cumsum(count)),
            np.concatenate([part.edge for part in parts]),
            np.concatenate([part.over for part in parts]),
        )
