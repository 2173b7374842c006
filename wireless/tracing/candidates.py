"""Candidates for paths among very many triangles, found once for each transmitter and stored.

Where patches are few, all short chains are tried: two patches that are not certainly hidden, edges over one patch, and
one patch behind an edge. Rays from the transmitter, also diffracted ones, find longer chains, and where patches are
many all but single patches and edges; more rays are aimed at each patch in view, so that small ones are not missed, and
neighbours of pairs are added. Edges that the transmitter cannot see are left out. Where paths may pass walls, only
opaque walls occlude. The result depends on nothing but the transmitter's place and the number of rays, so that a
receiver costs no search of its own: a robot's link is traced again and again with the same candidates.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.reflected import most_reflected
from wireless.geometry.array_types import Planes, Point
from wireless.geometry.images import all_views
from wireless.geometry.neighbours import Neighbours, edge_neighbours, patch_neighbours, with_neighbours
from wireless.geometry.occlusion import make_tree
from wireless.geometry.reachable_sides import Backs
from wireless.geometry.shooting import Bent, Shooter
from wireless.geometry.space import Space
from wireless.tracing.ray_search import trace_candidates
from wireless.tracing.reachable import (
    EdgeChains,
    OpenChains,
    SeenEdges,
    can_bend,
    make_edge_chains,
    open_chains,
    place_edges,
)
from wireless.tracing.space_engine import seen_edges
from wireless.tracing.table import Setting, Table

#: Everything is tried where a patch takes at most the time of so many rays; else what is next to the pairs that rays
#: find, where that takes at most so many: among 100,000 patches these are a million pairs, which few receivers need.
RAYS_A_PATCH, RAYS_NEARBY = 16, 8
#: Transmitters are remembered as long as their candidates take no more memory than this [bytes].
MEMORY = 128_000_000
#: Pairs of a sight and a patch that are decided at once: some 40 bytes each.
_PAIRS = 1_000_000
#: Selects those of some pairs that are possible.
Possible = Callable[[Int[np.ndarray, "_ 2"]], Int[np.ndarray, "_ 2"]]


class Reach(NamedTuple):
    """Chains of patches and edges that a transmitter may reach."""

    chains: OpenChains
    """Chains of patches."""
    edges: EdgeChains | None
    """Edges, and patches before and behind them; None if edges do not diffract."""

    @property
    def size(self) -> int:
        """Memory that it takes [bytes]."""
        return sum(a.nbytes for column in self if column is not None for a in column)


class Candidates:
    """Finds what may be reached from points of a space, and traces links over that."""

    def __init__(self, space: Space, setting: Setting, rays: int):
        self._space, self._setting, self._rays = space, setting, rays
        self._side = setting.side_reflections if len(space.surfaces.edge) else -1
        self._shooter = Shooter(space, setting.max_through)
        self._most = most_reflected(setting.walls, setting.wavenumber)
        self._veiled = hidden_by_opaque(space) if setting.max_through else space
        self._few = RAYS_A_PATCH * len(space.patch_boxes.number) <= rays
        self._near: tuple[Neighbours, Neighbours] | None = None
        if not self._few and RAYS_NEARBY * len(space.patch_boxes.number) <= rays:
            self._near = edge_neighbours(space), patch_neighbours(space)
        tried = self._side >= 0 and (self._few or self._near is not None)
        self._backs = Backs(space) if tried else None
        self._known: OrderedDict[bytes, Reach] = OrderedDict()
        self._lock = threading.Lock()

    def trace(self, tx: Float[np.ndarray, "t 3"], rx: Float[np.ndarray, "r 3"]) -> Iterator[Table]:
        """Strongest paths from each transmitter to receivers, around the space's origin [m]."""
        for source in tx:
            yield trace_candidates(self._space, self._setting, source, rx, *self._reach(source), self._most)

    def _reach(self, tx: Point) -> Reach:
        """Return the chains that a transmitter may reach, as cached or searched now."""
        key = tx.tobytes()
        with self._lock:  # another thread may be about to find the same
            if key in self._known:
                self._known.move_to_end(key)
            else:
                self._known[key] = self._found(tx)
                while len(self._known) > 1 and sum(reach.size for reach in self._known.values()) > MEMORY:
                    self._known.popitem(last=False)
            return self._known[key]

    def _found(self, tx: Point) -> Reach:
        """Chains from a transmitter, and edges that it sees."""
        space, max_order, side = self._space, self._setting.max_reflections, self._side
        # Where patches are few, rays are left what is longer.
        tried = (2, 1) if self._few else (1, 0)
        rays = self._rays if max_order > tried[0] or side > tried[1] else 0
        views, n = all_views(self._veiled, tx, min(tried[0], max_order), True)
        parts = [views.chain[:n][views.order[:n] == k, :k] for k in range(min(tried[0], max_order) + 1)]
        aims = parts[1][:, 0] if max_order > 1 and not self._few else np.empty(0, np.int64)
        seen = self._shooter.shoot(tx, rays, max_order, side, aims)
        parts = [chain[np.lexsort(chain.T[::-1])] if chain.size else chain for chain in parts]
        chains = list(seen.chains[len(parts) - 2 :]) if max_order > 1 else []
        if chains and self._near is not None:
            _, patches = self._near
            chains[0] = self._nearby(chains[0], (patches, patches), partial(self._pairs, tx))
        reached = open_chains(space, tx, _padded(parts + chains, max_order))
        if side < 0:
            return Reach(reached, None)
        sights = self._sights(tx, seen.edge, seen.over)
        return Reach(reached, make_edge_chains(space, sights, self._behind(tx, sights)))

    def _sights(self, tx: Point, edge: Int[np.ndarray, " q"], over: Int[np.ndarray, "q m"]) -> SeenEdges:
        """Edges that a transmitter sees, of which rays found some over patches."""
        space, side = self._space, self._side
        if self._few:
            views, n = all_views(self._veiled, tx, min(1, side), True)
            pair, _ = seen_edges(self._veiled, views, n, True)
            pair = pair[np.lexsort((pair[:, 0], pair[:, 1]))]
            first, before = pair[:, 0], views.chain[pair[:, 1]]
            before = np.where(np.arange(before.shape[1]) < views.order[pair[:, 1], None], before, -1)
            more = over[:, 1] >= 0 if over.shape[1] > 1 else np.zeros(len(edge), bool)
            edge, over = edge[more], over[more]
        else:
            if self._near is not None:
                longer = (over[:, 1:] >= 0).any(axis=1)
                pairs = np.column_stack([edge, over[:, 0]])[~longer]
                pairs = self._nearby(pairs, self._near, partial(self._seen, tx))
                pairs = pairs[np.argsort(pairs[:, 1], kind="stable")]
                edge = np.concatenate([pairs[:, 0], edge[longer]])
                over = np.concatenate([_padded([pairs[:, 1:]], over.shape[1]), over[longer]])
            first = np.arange(len(space.surfaces.edge))
            before = np.empty((len(first), 0), np.int64)
        return place_edges(
            self._veiled,
            tx,
            np.concatenate([first, edge]),
            np.concatenate([_padded([before], max(side, 1)), _padded([over], max(side, 1))]),
            True,
        )

    def _behind(self, tx: Point, sights: SeenEdges) -> list[Bent]:
        """Patches behind the edges of sights."""
        space, bent, side = self._space, self._setting.edge_reflections, self._side
        seen = (
            np.zeros(len(space.patch_facet), np.int64) if self._backs is None else self._backs.seen_from(tx)
        )
        bent_chains: list[Bent] = []
        for order in range(min(bent - 1, side) + 1):
            which = np.flatnonzero(sights.order == order)
            n_max = min(bent - order, side)
            if self._few and n_max > 0:
                patch = np.sort(space.patch_boxes.number)
                at_once = max(1, _PAIRS // max(len(patch), 1))
                for first in range(0, len(which), at_once):
                    batch = which[first : first + at_once]
                    pairs = np.column_stack([np.repeat(batch, len(patch)), np.tile(patch, len(batch))])
                    pairs = self._bent(sights, pairs, seen)
                    bent_chains.append(Bent(pairs[:, 0], pairs[:, 1:]))
            if n_max > (1 if self._few else 0):
                source = _images(self._space.panes.plane, tx, sights.over[which, :order])
                rays = self._shooter.bend(
                    source, sights.edge[which], np.full(len(which), order == 0), self._rays, n_max
                )
                behind = [Bent(which[b.sight], b.chain) for b in rays]
                if order == 0 and self._near is not None and behind:
                    behind[0] = self._bent_nearby(sights, which, behind[0], self._near, seen)
                bent_chains += behind[1 if self._few else 0 :]
        return bent_chains

    def _bent_nearby(
        self,
        sights: SeenEdges,
        which: Int[np.ndarray, " w"],
        bent: Bent,
        near: tuple[Neighbours, Neighbours],
        seen: Int[np.ndarray, " p"],
    ) -> Bent:
        """Patches behind edges that the transmitter itself sees, and what is next to these."""
        sight_of = np.full(len(self._space.surfaces.edge), -1)
        sight_of[sights.edge[which]] = which

        def possible(pairs: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "m 2"]:
            sight = sight_of[pairs[:, 0]]
            able = self._bent(sights, np.column_stack([sight, pairs[:, 1]])[sight >= 0], seen)
            return np.column_stack([sights.edge[able[:, 0]], able[:, 1]])

        pairs = np.column_stack([sights.edge[bent.sight], bent.chain[:, 0]])
        pairs = self._nearby(pairs, near, possible)
        return Bent(sight_of[pairs[:, 0]], pairs[:, 1:])

    def _nearby(
        self, pairs: Int[np.ndarray, "n 2"], near: tuple[Neighbours, Neighbours], possible: Possible
    ) -> Int[np.ndarray, "m 2"]:
        """Pairs, and those next to them, of patches that reflect."""
        mirrors = self._space.mirrors[self._space.patch_facet]
        return with_neighbours(pairs, near, lambda rows: possible(rows[mirrors[rows[:, 1]]]))

    def _pairs(self, tx: Point, pairs: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "m 2"]:
        """Pairs of patches, the second of which the transmitter's image over the first may see."""
        return open_chains(self._space, tx, pairs).chain

    def _seen(self, tx: Point, pairs: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "m 2"]:
        """Pairs of an edge and a patch, over which the transmitter may see it."""
        pairs = pairs[np.argsort(pairs[:, 1], kind="stable")]
        seen = place_edges(self._space, tx, pairs[:, 0], pairs[:, 1:], False)
        return np.column_stack([seen.edge, seen.over[:, 0]])

    def _bent(
        self, sights: SeenEdges, pairs: Int[np.ndarray, "n 2"], seen: Int[np.ndarray, " p"]
    ) -> Int[np.ndarray, "m 2"]:
        """Pairs of a sight and a patch that its edge may bend rays to, on the side of it that can be reached."""
        panes = self._space.panes
        radius = np.linalg.norm(panes.high - panes.low, axis=1) / 2
        sphere = np.column_stack([(panes.low + panes.high) / 2, radius])
        return pairs[can_bend(self._space.ground, sights, pairs, sphere, seen)]


def hidden_by_opaque(space: Space) -> Space:
    """Return a space in which walls with transmission occlude nothing."""
    opaque = np.flatnonzero(~space.tree_passes)
    old = space.tree
    plane = np.column_stack([old.normal, old.level])
    tree = make_tree(old.triangle[opaque], plane[opaque], old.near_m)
    return space._replace(
        tree=tree._replace(number=old.number[opaque[tree.number]]),
        walls=space.walls._replace(of_triangle=space.walls.of_triangle[opaque[tree.number]]),
        tree_passes=np.zeros(len(opaque), bool),
    )


def _padded(parts: list[Int[np.ndarray, "_ _"]], max_order: int) -> Int[np.ndarray, "c m"]:
    """Chains of several lengths in one table; -1 beyond the last patch."""
    chains = np.full((sum(map(len, parts)), max_order), -1, np.int64)
    row = 0
    for lot in parts:
        chains[row : row + len(lot), : lot.shape[1]] = lot[:, :max_order]
        row += len(lot)
    return chains


def _images(plane: Planes, point: Point, chain: Int[np.ndarray, "c m"]) -> Float[np.ndarray, "c 3"]:
    """A point mirrored over each of some chains."""
    image = np.tile(point, (len(chain), 1))
    for patch in chain.T:
        off = np.einsum("ij,ij->i", image, plane[patch, :3]) - plane[patch, 3]
        image -= 2 * off[:, None] * plane[patch, :3]
    return image
