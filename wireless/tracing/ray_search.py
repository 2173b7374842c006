"""The strongest paths of links among very many triangles: chains found by rays, paths computed and checked exactly.

All patches and all edges are tried alone, as by exhaustive search. Chains of two patches and more come from rays
that the transmitter shoots (`wireless.geometry.shooting`), and edges over patches from rays of both ends: what the
transmitter sees over a chain is joined with the receiver, and what the receiver sees over one with the
transmitter. Every candidate is laid out and looked at as in exhaustive search (`wireless.tracing.space_paths`), so that
each path is one that exhaustive search finds; what no ray has found is missed. More rays find the same and more.

Left out: walls that are passed, as rays end there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.diffraction import edge_bound
from wireless.em.fields import NOWHERE_M
from wireless.geometry.cones import MAX_CORNERS
from wireless.geometry.images import Space, cone_of, new_views, opens
from wireless.geometry.occlusion import NEAR_M, Boxes
from wireless.support.compiled import compiled
from wireless.tracing.space_engine import Room, enter_view, make_room, write_lists
from wireless.tracing.space_paths import edge_sight, images_over, is_open, lay, try_path
from wireless.tracing.table import Setting, Table, make_table, most_interactions


class Sights(NamedTuple):
    """Edges that points may see, directly or over patches, by point and edge."""

    start: Int[np.ndarray, " s1"]
    """Where each point's begin, and an end."""
    edge: Int[np.ndarray, " q"]
    """Edges."""
    order: Int[np.ndarray, " q"]
    """Number of patches that each is seen over."""
    over: Int[np.ndarray, "q m"]
    """These patches, the first from the point first; -1 beyond the last."""
    place: Float[np.ndarray, "q 3"]
    """Where the point's image is, as seen from the edge (`wireless.tracing.space_paths.edge_sight`)."""


@compiled
def sights(
    space: Space,
    points: Float[np.ndarray, "s 3"],
    start: Int[np.ndarray, " s1"],
    edge: Int[np.ndarray, " q"],
    over: Int[np.ndarray, "q m"],
    alone: bool,
) -> Sights:
    """Edges that are open to the images of points.

    Args:
        space: Surfaces.
        points: Positions around the space's origin [m].
        start: Where each point's edges begin in edge, and an end.
        edge: Edges over patches, rising for each point.
        over: Patches that they are seen over.
        alone: Whether all edges are tried without patches too.
    """
    n_edges, gap = len(space.surfaces.edge), space.surfaces.edge_gap_rad
    room = len(edge) + (n_edges * len(points) if alone else 0)
    found = Sights(
        np.zeros(len(points) + 1, np.int64),
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.full((room, over.shape[1]), -1, np.int64),
        np.empty((room, 3)),
    )
    count = 0
    for s in range(len(points)):
        j = start[s]
        for e in range(n_edges):
            if alone:
                z, distance, angle = edge_sight(space, e, points[s])
                if distance >= NEAR_M and is_open(gap[e], distance, angle):
                    found.edge[count], found.order[count] = e, 0
                    found.place[count, 0], found.place[count, 1], found.place[count, 2] = z, distance, angle
                    count += 1
            while j < start[s + 1] and edge[j] == e:
                order = 0
                while order < over.shape[1] and over[j, order] >= 0:
                    order += 1
                image = images_over(space, points[s], over[j, :order])
                z, distance, angle = edge_sight(space, e, image[order])
                if distance >= NEAR_M and is_open(gap[e], distance, angle):
                    found.edge[count], found.order[count], found.over[count] = e, order, over[j]
                    found.place[count, 0], found.place[count, 1], found.place[count, 2] = z, distance, angle
                    count += 1
                j += 1
        found.start[s + 1] = count
    return Sights(
        found.start,
        found.edge[:count].copy(),
        found.order[:count].copy(),
        found.over[:count].copy(),
        found.place[:count].copy(),
    )


@compiled
def _try_chains(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    rx_boxes: Boxes,
    chain: Int[np.ndarray, "c m"],
    room: Room,
    rank: Float[np.ndarray, "r k 5"],
    best: Int[np.ndarray, "r k w"],
    count: Int[np.ndarray, " r"],
) -> None:
    """Enter the ways over chains, which come by length and in rising order, into the lists of their links."""
    most = chain.shape[1]
    # View k looks over the first k patches of a chain: of the next one only the views that differ are new.
    views, same, spare = new_views(most + 1, most), 0, np.empty((MAX_CORNERS, 3))
    views.image[0, 0] = tx
    for c in range(len(chain)):
        order, shared = 0, 0
        while order < most and chain[c, order] >= 0:
            order += 1
        while c > 0 and shared < order and chain[c, shared] == chain[c - 1, shared]:
            shared += 1
        if shared > same:  # the patch that closed the chain before closes this one too
            continue
        same = shared
        while same < order:
            n_planes = cone_of(space, views, same, room.plane)
            if not opens(space, views, same, chain[c, same], views, same + 1, room.plane, n_planes, spare):
                break
            same += 1
        if same == order:
            enter_view(space, setting, tx, rx, rx_boxes, views, order, room, rank, best, count)


@compiled
def _join(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    edge: int,
    near: Int[np.ndarray, " m"],
    far: Int[np.ndarray, " m"],
    room: Room,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter the way over an edge and the chains of both ends into a link's list; the list's new length."""
    before, after, who = len(near), len(far), room.who
    ways = (images_over(space, tx, near), near, before), (images_over(space, rx, far), far, after)
    m = lay(space, tx, rx, ways[0], edge, ways[1], room.points, room.scratch)
    if m < 0:
        return count
    who[0], who[1], who[2] = edge, before, after
    who[3 : 3 + before], who[3 + before : 3 + before + after] = near, far
    return try_path(
        space,
        setting,
        tx,
        rx,
        room.points,
        m,
        who,
        room.scratch,
        room.where,
        room.which,
        rank,
        best,
        count,
    )


@compiled
def _bend(
    space: Space,
    setting: Setting,
    ends: Float[np.ndarray, "2 3"],
    swapped: bool,
    sights: Sights,
    s: int,
    room: Room,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter the ways over edges that one end sees (over patches, or not) and the other end directly.

    Ends are the one that sees, number s of the sights, and the other; swapped if the first is the receiver.
    """
    keep, nobody, other = len(rank), np.empty(0, np.int64), ends[1]
    edges, wedges = space.surfaces.edge, space.surfaces.edge_wedge
    for j in range(sights.start[s], sights.start[s + 1]):
        e = sights.edge[j]
        z, x, y, end = 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            d = other[i] - edges[e, 0, i]
            z += d * wedges[e, 0, i]
            x += d * wedges[e, 1, i]
            y += d * wedges[e, 2, i]
            end += wedges[e, 0, i] * (edges[e, 1, i] - edges[e, 0, i])
        distance = np.sqrt(x * x + y * y)
        if distance < NOWHERE_M:
            continue
        at = (sights.place[j, 0] * distance + z * sights.place[j, 1]) / (sights.place[j, 1] + distance)
        if at < -NEAR_M or at > end + NEAR_M:
            continue
        gap, angle = space.surfaces.edge_gap_rad[e], np.arctan2(y, x) % (2 * np.pi)
        if not is_open(gap, distance, angle):
            continue
        if count == keep:
            bound = edge_bound(
                angle, sights.place[j, 2], gap, setting.wavenumber, sights.place[j, 1], distance
            )
            if bound < rank[keep - 1, 0]:
                continue
        over = sights.over[j, : sights.order[j]]
        if swapped:
            count = _join(space, setting, other, ends[0], e, nobody, over, room, rank, best, count)
        else:
            count = _join(space, setting, ends[0], other, e, over, nobody, room, rank, best, count)
    return count


@compiled
def _bend_over_both(
    space: Space,
    setting: Setting,
    ends: Float[np.ndarray, "2 3"],
    near: Sights,
    far: Sights,
    r: int,
    room: Room,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter the ways over edges that both ends see over patches; r is the receiver's number."""
    i, last = 0, near.start[1]
    for j in range(far.start[r], far.start[r + 1]):
        e = far.edge[j]
        while i < last and near.edge[i] < e:
            i += 1
        k = i
        while k < last and near.edge[k] == e:
            before, after = near.order[k], far.order[j]
            total = near.place[k, 1] + far.place[j, 1]
            at = (near.place[k, 0] * far.place[j, 1] + far.place[j, 0] * near.place[k, 1]) / total
            end = 0.0
            for c in range(3):
                along = space.surfaces.edge[e, 1, c] - space.surfaces.edge[e, 0, c]
                end += space.surfaces.edge_wedge[e, 0, c] * along
            inside = -NEAR_M <= at <= end + NEAR_M
            if before > 0 and before + after <= setting.edge_reflections and inside:
                over = near.over[k, :before], far.over[j, :after]
                count = _join(space, setting, ends[0], ends[1], e, over[0], over[1], room, rank, best, count)
            k += 1
    return count


@compiled
def trace_candidates(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    rx_boxes: Boxes,
    chain: Int[np.ndarray, "c m"],
    near: Sights,
    far: Sights,
) -> Table:
    """Strongest paths from one transmitter to many receivers, among candidates.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
        rx_boxes: Receivers, sorted into boxes.
        chain: Patches from the transmitter on, by length and in rising order; -1 beyond the last.
        near: Edges that the transmitter may see.
        far: Edges that each receiver may see over patches.
    """
    keep, table, most = setting.keep, make_table(setting, len(rx)), most_interactions(setting)
    rank, best = np.empty((len(rx), keep, 5)), np.zeros((len(rx), keep, 3 + most), np.int64)
    room, count = make_room(setting, len(rx)), table.found
    _try_chains(space, setting, tx, rx, rx_boxes, chain, room, rank, best, count)
    ends = np.empty((2, 3))
    for r in range(len(rx)):
        if setting.edge_reflections < 0:
            break
        ends[0], ends[1] = tx, rx[r]
        count[r] = _bend(space, setting, ends, False, near, 0, room, rank[r], best[r], count[r])
        if setting.edge_reflections > 1:
            count[r] = _bend_over_both(space, setting, ends, near, far, r, room, rank[r], best[r], count[r])
        ends[0], ends[1] = rx[r], tx
        count[r] = _bend(space, setting, ends, True, far, r, room, rank[r], best[r], count[r])
    write_lists(space, setting, tx, rx, room, best, table)
    return table
