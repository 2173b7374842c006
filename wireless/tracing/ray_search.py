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
from wireless.geometry.images import Space
from wireless.geometry.occlusion import HIDDEN, TOUCHED
from wireless.support.compiled import compiled
from wireless.tracing.beams import Beams, Bends
from wireless.tracing.laying import edge_sight, ground_of, is_open, lay, mirror_over, on_large
from wireless.tracing.space_engine import Room, make_room, write_lists
from wireless.tracing.space_paths import is_limit, left_by_mirrors, list_path, look, try_path, weigh_path
from wireless.tracing.sweep import beams_at, bends_at
from wireless.tracing.table import Setting, Table, make_table, most_interactions


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
        np.zeros((n_rx, setting.keep, 3 + most), np.int64),
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
        if m < 0 or m > setting.max_interactions:
            continue
        if count == keep and before + after > 0:
            most = bound[h] * left_by_mirrors(facet_normal, setting, m, scratch)
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
    lists: Lists,
) -> None:
    """Enter the ways over patches into the lists of all links.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
        beams: What the transmitter reaches.
        lists: Strongest paths so far.
    """
    room, hits, ends = make_room(setting, len(rx)), beams_at(beams, rx), np.empty((2, 3))
    ends[0] = tx
    for r in range(len(rx)):
        mine, ends[1] = hits.row[hits.start[r] : hits.start[r + 1]], rx[r]
        bound = np.full(len(mine), np.inf)
        for h in range(len(mine)):
            length2 = 0.0
            for i in range(3):
                length2 += (beams.column[i, mine[h]] - rx[r, i]) ** 2
            if beams.order[mine[h]] > 0:
                bound[h] = 1 / (4 * setting.wavenumber**2 * length2)
        lists.length[r] = _enter(
            space,
            setting,
            ends,
            np.full(len(mine), -1),
            beams.chain[mine],
            np.full((len(mine), 1), -1),
            bound,
            room,
            lists.rank[r],
            lists.best[r],
            lists.length[r],
        )


@compiled
def _bound(
    edges: tuple[Float[np.ndarray, "e 2 3"], Float[np.ndarray, "e 3 3"], Float[np.ndarray, " e"]],
    wavenumber: float,
    e: int,
    angle: float,
    column: Float[np.ndarray, "9 q"],
    q: int,
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "3"],
    least: float,
) -> float:
    """What the power of a bend cannot exceed; -1 if it is none or below the least.

    The receiver's image over the patches behind the edge is given, and the angle of the transmitter's.
    """
    _, distance, behind = edge_sight(edges[0], edges[1], e, image)
    gap, z, place, off = edges[2][e], 0.0, column[7, q], column[8, q]
    if distance < NOWHERE_M or not is_open(gap, distance, behind):
        return -1.0
    most = edge_bound(behind, angle, gap, wavenumber, off, distance)
    if most < least:
        return -1.0
    for i in range(3):
        z += column[3 + i, q] * (rx[i] - column[i, q])
    at = (place * distance + z * off) / (off + distance)
    before, after = np.hypot(place - at, off), np.hypot(z - at, distance)
    most = min(most, close_edge_bound(behind, angle, gap, wavenumber, before, after, distance / after))
    return most if most >= least else -1.0


@compiled
def bend(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    bends: Bends,
    lists: Lists,
) -> None:
    """Enter the ways over edges into the lists of all links.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
        bends: What the transmitter reaches.
        lists: Strongest paths so far.
    """
    room, hits, keep = make_room(setting, len(rx)), bends_at(space.panes, bends, rx), setting.keep
    edges = space.surfaces.edge, space.surfaces.edge_wedge, space.surfaces.edge_gap_rad
    plane, column, far, angle = space.panes.plane, bends.column, bends.far, bends.angle
    image, ends = np.empty((far.shape[1] + 1, 3)), np.empty((2, 3))
    ends[0] = tx
    for r in range(len(rx)):
        mine, ends[1] = hits.row[hits.start[r] : hits.start[r + 1]], rx[r]
        least = lists.rank[r, keep - 1, 0] if lists.length[r] == keep else 0.0
        bound = np.empty(len(mine))
        for h in range(len(mine)):
            q = mine[h]
            after = mirror_over(plane, rx[r], far[q], image)
            bound[h] = _bound(
                edges,
                setting.wavenumber,
                bends.edge[q],
                angle[q],
                column,
                q,
                rx[r],
                image[after],
                least,
            )
        # What may be strongest comes first, so that a full list spares the rest.
        order = np.argsort(-bound, kind="mergesort")
        order = order[: (bound >= 0).sum()]
        mine = mine[order]
        lists.length[r] = _enter(
            space,
            setting,
            ends,
            bends.edge[mine],
            bends.near[mine],
            far[mine],
            bound[order],
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
    table = make_table(setting, len(rx))
    table.found[:] = lists.length
    write_lists(space, setting, tx, rx, make_room(setting, len(rx)), lists.best, table)
    return table
