"""Candidates for paths among very many triangles, found once for each transmitter and kept.

Where patches are few, all that can be is tried: chains of two patches that are not certainly hidden, edges over one,
and one behind an edge. What is longer, and where patches are many all but single patches and edges, rays find that
the transmitter shoots and that edges bend. Where paths may pass walls, only what lets nothing through hides. What is
found depends on nothing but the transmitter's place and the number of rays, so that a receiver costs no search of its
own: a robot's link is traced again and again with the same candidates.
"""

import threading
from collections import OrderedDict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.geometry.images import Space, all_views
from wireless.geometry.occlusion import make_tree
from wireless.geometry.shooting import Bent, Shooter
from wireless.tracing.beams import (
    Beams,
    Bends,
    Sights,
    aim,
    make_bends,
    patches_behind,
    place_edges,
)
from wireless.tracing.ray_search import bend, make_lists, reflect, tabled
from wireless.tracing.space_engine import lit_edges
from wireless.tracing.table import Setting, Table

#: All is tried where a patch takes no longer than so many rays.
RAYS_A_PATCH = 64
#: Transmitters are remembered as long as their candidates take no more memory than this [bytes].
MEMORY = 128_000_000


class Reach(NamedTuple):
    """What a transmitter may reach."""

    beams: Beams
    """Chains of patches."""
    bends: Bends | None
    """Edges, and patches before and behind them; None if edges do not diffract."""

    @property
    def size(self) -> int:
        """Memory that it takes [bytes]."""
        return sum(a.nbytes for part in self if part is not None for a in part)


class Candidates:
    """Finds what may be reached from points of a space, and traces links over that.

    Args:
        space: Surfaces.
        setting: Limits of paths.
        rays: Rays from each transmitter.
    """

    def __init__(self, space: Space, setting: Setting, rays: int):
        self._space, self._setting, self._rays = space, setting, rays
        self._side = setting.side_reflections if len(space.surfaces.edge) else -1
        self._shooter = Shooter(space, setting.max_through)
        self._veiled = hidden_by_opaque(space) if setting.max_through else space
        self._few = RAYS_A_PATCH * len(space.patch_boxes.number) <= rays
        self._known: OrderedDict[bytes, Reach] = OrderedDict()
        self._lock = threading.Lock()

    def trace(self, tx: Float[np.ndarray, "t 3"], rx: Float[np.ndarray, "r 3"]) -> Iterator[Table]:
        """Strongest paths from each transmitter to receivers, around the space's origin [m]."""
        space, setting = self._space, self._setting
        for one in tx:
            reach = self._reach(one)
            lists = make_lists(setting, len(rx))
            reflect(space, setting, one, rx, reach.beams, lists)
            if reach.bends is not None:
                bend(space, setting, one, rx, reach.bends, lists)
            yield tabled(space, setting, one, rx, lists)

    def _reach(self, tx: Float[np.ndarray, "3"]) -> Reach:
        """What a transmitter may reach, as remembered or found now."""
        key = tx.tobytes()
        with self._lock:  # another thread may be about to find the same
            if key in self._known:
                self._known.move_to_end(key)
            else:
                self._known[key] = self._found(tx)
                while len(self._known) > 1 and sum(one.size for one in self._known.values()) > MEMORY:
                    self._known.popitem(last=False)
            return self._known[key]

    def _found(self, tx: Float[np.ndarray, "3"]) -> Reach:
        """Chains from a transmitter, and edges that it sees."""
        space, most, side = self._space, self._setting.max_reflections, self._side
        # Where patches are few, rays are left what is longer.
        tried = (2, 1) if self._few else (1, 0)
        rays = self._rays if most > tried[0] or side > tried[1] else 0
        seen = self._shooter.shoot(tx, rays, most, side)
        if self._few:
            views, n = all_views(self._veiled, tx, min(2, most), True)
            parts = [views.chain[:n][views.order[:n] == k, :k] for k in range(min(2, most) + 1)]
        else:
            parts = [np.empty((1, 0), np.int64), space.patch_boxes.number[:, None]][: most + 1]
        parts = [part[np.lexsort(part.T[::-1])] if part.size else part for part in parts]
        parts += seen.chains[len(parts) - 2 :] if most > 1 else []
        beams = aim(space, tx, _padded(parts, most))
        if side < 0:
            return Reach(beams, None)
        sights = self._sights(tx, seen.edge, seen.over)
        return Reach(beams, make_bends(space, sights, self._behind(tx, sights)))

    def _sights(
        self, tx: Float[np.ndarray, "3"], edge: Int[np.ndarray, " q"], over: Int[np.ndarray, "q m"]
    ) -> Sights:
        """Edges that a transmitter sees, of which rays found some over patches."""
        space, side = self._space, self._side
        if self._few:
            views, n = all_views(self._veiled, tx, min(1, side), True)
            pair, _ = lit_edges(self._veiled, views, n, True)
            pair = pair[np.lexsort((pair[:, 0], pair[:, 1]))]
            first, before = pair[:, 0], views.chain[pair[:, 1]]
            before = np.where(np.arange(before.shape[1]) < views.order[pair[:, 1], None], before, -1)
            more = over[:, 1] >= 0 if over.shape[1] > 1 else np.zeros(len(edge), bool)
            edge, over = edge[more], over[more]
        else:
            first = np.arange(len(space.surfaces.edge))
            before = np.empty((len(first), 0), np.int64)
        return place_edges(
            space,
            tx,
            np.concatenate([first, edge]),
            np.concatenate([_padded([before], max(side, 1)), _padded([over], max(side, 1))]),
        )

    def _behind(self, tx: Float[np.ndarray, "3"], sights: Sights) -> list[Bent]:
        """Patches behind the edges of sights."""
        space, bent, side = self._space, self._setting.edge_reflections, self._side
        found: list[Bent] = []
        for order in range(min(bent - 1, side) + 1):
            which = np.flatnonzero(sights.order == order)
            most = min(bent - order, side)
            if self._few and most > 0:
                asked = sights.edge[which], sights.place[which], sights.part[which]
                surfaces = space.surfaces.edge, space.surfaces.edge_wedge, space.surfaces.edge_gap_rad
                sight, patch = patches_behind(surfaces, *asked, *self._balls())
                found.append(Bent(which[sight], patch[:, None]))
            if most > (1 if self._few else 0):
                source = _images(self._space.panes.plane, tx, sights.over[which, :order])
                rays = self._shooter.bend(
                    source, sights.edge[which], np.full(len(which), order == 0), self._rays, most
                )
                found += [Bent(which[b.sight], b.chain) for b in rays[1 if self._few else 0 :]]
        return found

    def _balls(self) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 4"]]:
        """Patches that reflect, and a ball around each."""
        patch = np.sort(self._space.patch_boxes.number)
        low, high = self._space.panes.low[patch], self._space.panes.high[patch]
        return patch, np.column_stack([(low + high) / 2, np.linalg.norm(high - low, axis=1) / 2])


def hidden_by_opaque(space: Space) -> Space:
    """The same space, in which what lets paths through hides nothing."""
    opaque = np.flatnonzero(~space.tree_passes)
    tree = make_tree(space.tree.triangle[opaque])
    return space._replace(
        tree=tree._replace(number=space.tree.number[opaque[tree.number]]),
        tree_wall=space.tree_wall[opaque[tree.number]],
        tree_passes=np.zeros(len(opaque), bool),
    )


def _padded(parts: list[Int[np.ndarray, "_ _"]], most: int) -> Int[np.ndarray, "c m"]:
    """Chains of several lengths in one table; -1 beyond the last patch."""
    chains = np.full((sum(map(len, parts)), most), -1, np.int64)
    row = 0
    for part in parts:
        chains[row : row + len(part), : part.shape[1]] = part[:, :most]
        row += len(part)
    return chains


def _images(
    plane: Float[np.ndarray, "p 4"], point: Float[np.ndarray, "3"], chain: Int[np.ndarray, "c m"]
) -> Float[np.ndarray, "c 3"]:
    """A point mirrored over each of some chains."""
    image = np.tile(point, (len(chain), 1))
    for patch in chain.T:
        off = np.einsum("ij,ij->i", image, plane[patch, :3]) - plane[patch, 3]
        image -= 2 * off[:, None] * plane[patch, :3]
    return image
