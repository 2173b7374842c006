"""The strongest paths of links among very many triangles: candidates of the transmitter, computed and checked exactly.

For each transmitter there is a table of what it may reach, over patches and edges (`wireless.tracing.candidates`).
One sweep over it leaves few rows for each receiver (`wireless.tracing.sweep`). Those are laid out and looked at as in
exhaustive search (`wireless.tracing.laying`, `wireless.tracing.space_paths`), so that each path is one that exhaustive
search finds; what is not in the table is missed. Of bends what may be strongest comes first, so that a full list
spares the rest. Rows say nothing of walls: those that a path may pass are found on its legs.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.diffraction import close_edge_bound, edge_bound
from wireless.em.fields import NOWHERE_M
from wireless.em.reflected import Reflected, by_face, by_mirror
from wireless.geometry.images import Space
from wireless.geometry.occlusion import HIDDEN, TOUCHED
from wireless.support.compiled import compiled
from wireless.tracing.beams import Beams, Bends
from wireless.tracing.laying import edge_sight, ground_of, is_open, lay, mirror_over, on_large
from wireless.tracing.space_engine import Room, make_room, table_of
from wireless.tracing.space_paths import is_limit, left_by_mirrors, list_path, look, try_path, weigh_path
from wireless.tracing.sweep import beams_at, bends_at
from wireless.tracing.table import Setting, Table, most_interactions

#: Bends of a link whose bounds are found closely at once: those behind are spared if the list fills up.
_LOT = 64


class Lists(NamedTuple):
    """Strongest paths so far of links, see `wireless.tracing.table.enter`."""

    rank: Float[np.ndarray, "r k 5"]
    best: Int[np.ndarray, "r k w"]
    length: Int[np.ndarray, " r"]


def make_lists(setting: Setting, n_rx: int) -> Lists:
    """Lists of so many links, with no path in them."""
    most = int(most_interactions(setting))
    return Lists(
        np.empty((n_rx, setting.keep, 5)),
        np.empty((n_rx, setting.keep, 3 + most), np.int64),
        np.zeros(n_rx, np.int64),
    )


@compiled
def _enter(
    space: Space,
    setting: Setting,
    ends: Float[np.ndarray, "2 3"],
    edge: Int[np.ndarray, " n"],
    near: Int[np.ndarray, "n m"],
    far: Int[np.ndarray, "n l"],
    bound: Float[np.ndarray, " n"],
    bare: Float[np.ndarray, " n"],
    room: Room,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter ways into a link's list, but those whose bound shows that they are too weak; the list's new length.

    Args:
        space: Surfaces.
        setting: Physics and limits.
        ends: Transmitter and receiver.
        edge: Edge of each way; -1 for none.
        near: Patches before it, or all, the first from the transmitter first; -1 beyond the last.
        far: Patches behind it, the first from the receiver first.
        bound: What the power of each cannot exceed.
        bare: The same if its patches reflected everything.
        room: Arrays to work in.
        rank: The list, see `wireless.tracing.table.enter`.
        best: The same.
        count: Its length.
    """
    ground, tree, scratch, who, keep = ground_of(space), space.tree, room.scratch, room.who, len(rank)
    facet_normal, edge_facets = space.surfaces.facet_normal, space.surfaces.edge_facets
    tx, rx = ends[0], ends[1]
    images, others = np.empty((near.shape[1] + 1, 3)), np.empty((far.shape[1] + 1, 3))
    for h in range(len(edge)):
        if count == keep and bound[h] < rank[keep - 1, 0]:
            continue
        before, after = (
            mirror_over(ground.plane, tx, near[h], images),
            mirror_over(ground.plane, rx, far[h], others),
        )
        m, large = lay(
            ground,
            tx,
            rx,
            (images, near[h], before),
            edge[h],
            (others, far[h], after),
            room.points,
            scratch.point,
            scratch.kind,
            scratch.primitive,
        )
        if m < 0 or m > setting.max_met:
            continue
        if count == keep and before + after > 1:
            most = bare[h] * left_by_mirrors(facet_normal, setting, m, scratch)
            if most < rank[keep - 1, 0]:
                continue
        who[0], who[1], who[2] = edge[h], before, after
        for i in range(before):
            who[3 + i] = near[h, i]
        for i in range(after):
            who[3 + before + i] = far[h, i]
        if setting.max_through > 0:
            if not large or on_large(space, near[h], before, edge[h], far[h], after, scratch.point):
                count = try_path(
                    space,
                    setting,
                    tx,
                    rx,
                    room.points,
                    m,
                    who,
                    scratch,
                    room.where,
                    room.which,
                    rank,
                    best,
                    count,
                )
            continue
        # To look takes as long as to weigh; of a full list most are too weak.
        length, power, full = -1.0, 0.0, count == keep
        if full:
            length, power = weigh_path(facet_normal, edge_facets, ground, setting, m, scratch)
            if length < 0 or power <= rank[keep - 1, 0]:
                continue
        seen = look(tree, m, scratch.point, scratch.kind)
        if seen == HIDDEN:
            continue
        if not full:
            length, power = weigh_path(facet_normal, edge_facets, ground, setting, m, scratch)
            if length < 0:
                continue
        if large and not on_large(space, near[h], before, edge[h], far[h], after, scratch.point):
            continue
        if seen == TOUCHED and not is_limit(space, tx, rx, who, scratch.point, room.points):
            continue
        count = list_path(scratch.point, m, who, length, power, rank, best, count)
    return count


@compiled
def reflect(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    beams: Beams,
    most: Reflected,
    lists: Lists,
) -> None:
    """Enter the ways over patches into the lists of all links.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
        beams: What the transmitter reaches.
        most: What facets reflect at most.
        lists: Strongest paths so far.
    """
    room, hits, ends = make_room(setting, len(rx)), beams_at(beams, rx), np.empty((2, 3))
    ends[0] = tx
    for r in range(len(rx)):
        mine, ends[1] = hits.row[hits.start[r] : hits.start[r + 1]], rx[r]
        bound, bare = np.full(len(mine), np.inf), np.full(len(mine), np.inf)
        for h in range(len(mine)):
            beam, length2, off = mine[h], 0.0, 0.0
            order = beams.order[beam]
            if order == 0:
                continue
            for i in range(3):
                way = rx[r, i] - beams.column[i, beam]
                length2 += way * way
                off += way * beams.column[3 + i, beam]
            bare[h] = 1 / (4 * setting.wavenumber**2 * length2)
            facet = space.patch_facet[beams.chain[beam, order - 1]]
            bound[h] = bare[h] * by_mirror(most.mirror, most.row[facet], abs(off) / np.sqrt(length2))
        lists.length[r] = _enter(
            space,
            setting,
            ends,
            np.full(len(mine), -1),
            beams.chain[mine],
            np.full((len(mine), 1), -1),
            bound,
            bare,
            room,
            lists.rank[r],
            lists.best[r],
            lists.length[r],
        )


@compiled
def _rough_bounds(
    edges: tuple[Float[np.ndarray, "e 2 3"], Float[np.ndarray, "e 3 3"], Float[np.ndarray, " e"]],
    plane: Float[np.ndarray, "p 4"],
    wavenumber: float,
    bends: Bends,
    mine: Int[np.ndarray, " n"],
    rx: Float[np.ndarray, "3"],
    least: float,
    sight: Float[np.ndarray, "n 3"],
    image: Float[np.ndarray, "m1 3"],
    near_m: float,
) -> Float[np.ndarray, " n"]:
    """What the power of bends cannot exceed if their faces were mirrors; -1 if it is none or below the least.

    Where the receiver's image is, as seen from the edge, is put into `sight` (`wireless.tracing.laying.edge_sight`).
    """
    rough, edge, far, column, angle = np.empty(len(mine)), bends.edge, bends.far, bends.column, bends.angle
    for h in range(len(mine)):
        q = mine[h]
        e = edge[q]
        after = mirror_over(plane, rx, far[q], image) if far[q, 0] >= 0 else 0
        z, distance, behind = edge_sight(edges[0], edges[1], e, image[after] if after else rx)
        sight[h, 0], sight[h, 1], sight[h, 2], rough[h] = z, distance, behind, -1.0
        if distance >= NOWHERE_M and is_open(edges[2][e], distance, behind, near_m):
            most = edge_bound(behind, angle[q], edges[2][e], wavenumber, column[8, q], distance)
            if most >= least:
                rough[h] = most
    return rough


@compiled
def _within(angle: float, gap: float) -> float:
    """An angle from the 0-face within a wedge, which rounding may have turned out of it."""
    return min(angle, gap) if angle < np.pi + gap / 2 else 0.0


@compiled
def _bounds(
    space: Space,
    setting: Setting,
    most: Reflected,
    bends: Bends,
    mine: Int[np.ndarray, " n"],
    some: Int[np.ndarray, " m"],
    ends: Float[np.ndarray, "2 3"],
    sight: Float[np.ndarray, "n 3"],
    image: Float[np.ndarray, "m1 3"],
    bound: Float[np.ndarray, " m"],
    bare: Float[np.ndarray, " m"],
) -> None:
    """What the power of some bends cannot exceed (`bound`), and what if patches reflected everything (`bare`).

    For many at once, as to hand these tables on takes longer than to find one. Sights are those of `_rough_bounds`.
    """
    edge, edge_wedge, gaps = space.surfaces.edge, space.surfaces.edge_wedge, space.surfaces.edge_gap_rad
    edge_facets, plane, patch_facet = space.surfaces.edge_facets, space.panes.plane, space.patch_facet
    mirror, apart, alike, row = most.mirror, most.apart, most.alike, most.row
    column, wavenumber, bisector = bends.column, setting.wavenumber, setting.bisector
    for j in range(len(some)):
        h = some[j]
        q = mine[h]
        e, distance, place, off = bends.edge[q], sight[h, 1], column[7, q], column[8, q]
        gap, z = gaps[e], 0.0
        phi, phi_source = _within(sight[h, 2], gap), _within(bends.angle[q], gap)
        for i in range(3):
            z += column[3 + i, q] * (ends[1, i] - column[i, q])
        at = (place * distance + z * off) / (off + distance)
        before, after = np.hypot(place - at, off), np.hypot(z - at, distance)
        sin_b0 = distance / after
        faces = (
            by_face(apart, alike, row[edge_facets[e, 0]], phi, phi_source, sin_b0, bisector),
            by_face(apart, alike, row[edge_facets[e, 1]], gap - phi, gap - phi_source, sin_b0, bisector),
        )
        bare[j] = close_edge_bound(phi, phi_source, gap, wavenumber, before, after, sin_b0, faces)
        bound[j] = bare[j]
        # Of patches those are asked that are next to the receiver, and to the edge.
        far, order = bends.far[q, 0], 0
        if far >= 0:
            cosine = 0.0
            for i in range(3):
                cosine += plane[far, i] * (ends[1, i] - column[i, q] - at * column[3 + i, q])
            bound[j] *= by_mirror(mirror, row[patch_facet[far]], abs(cosine) / after)
        if bends.near[q, 0] >= 0:
            order = mirror_over(plane, ends[0], bends.near[q], image)
        if order > 0:
            near, cosine = bends.near[q, order - 1], 0.0
            for i in range(3):
                point = edge[e, 0, i] + (at + sight[h, 0] - z) * edge_wedge[e, 0, i]
                cosine += plane[near, i] * (point - image[order, i])
            bound[j] *= by_mirror(mirror, row[patch_facet[near]], abs(cosine) / before)


@compiled
def bend(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    bends: Bends,
    most: Reflected,
    lists: Lists,
) -> None:
    """Enter the ways over edges into the lists of all links.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
        bends: What the transmitter reaches.
        most: What facets reflect at most.
        lists: Strongest paths so far.
    """
    room, hits, keep = make_room(setting, len(rx)), bends_at(space.panes, bends, rx), setting.keep
    edges = space.surfaces.edge, space.surfaces.edge_wedge, space.surfaces.edge_gap_rad
    plane = space.panes.plane
    image = np.empty((max(bends.far.shape[1], bends.near.shape[1]) + 1, 3))
    ends, bound, bare = np.empty((2, 3)), np.empty(_LOT), np.empty(_LOT)
    ends[0] = tx
    for r in range(len(rx)):
        mine, ends[1] = hits.row[hits.start[r] : hits.start[r + 1]], rx[r]
        least = lists.rank[r, keep - 1, 0] if lists.length[r] == keep else 0.0
        sight = np.empty((len(mine), 3))
        rough = _rough_bounds(
            edges, plane, setting.wavenumber, bends, mine, rx[r], least, sight, image, space.surfaces.near_m
        )
        # What may be strongest comes first, so that a full list spares the rest.
        order = np.argsort(-rough, kind="mergesort")
        order = order[: (rough >= 0).sum()]
        for first in range(0, len(order), _LOT):
            some = order[first : first + _LOT]
            least = lists.rank[r, keep - 1, 0] if lists.length[r] == keep else 0.0
            if rough[some[0]] < least:
                break
            _bounds(space, setting, most, bends, mine, some, ends, sight, image, bound, bare)
            for j in range(len(some)):
                bound[j] = min(bound[j], rough[some[j]])
            best_first = np.argsort(-bound[: len(some)], kind="mergesort")
            some = mine[some[best_first]]
            lists.length[r] = _enter(
                space,
                setting,
                ends,
                bends.edge[some],
                bends.near[some],
                bends.far[some],
                bound[best_first],
                bare[best_first],
                room,
                lists.rank[r],
                lists.best[r],
                lists.length[r],
            )


@compiled
def tabled(
    space: Space, setting: Setting, tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "r 3"], lists: Lists
) -> Table:
    """The table of a transmitter, from the lists of its links."""
    return table_of(space, setting, tx, rx, make_room(setting, len(rx)), lists.best, lists.length)
