"""The strongest paths of links among very many triangles: chains found by rays, paths computed and checked exactly.

All patches and all edges are tried alone, as by exhaustive search. Chains of two patches and more come from rays
that the transmitter shoots (`wireless.geometry.shooting`), and edges over patches from rays of both ends. Where
patches are few, the cones of all of them give all pairs, and all edges over one. What the transmitter sees over a
chain is joined with the receiver, and what the receiver sees over one with the transmitter. Every candidate is laid
out and looked at as in exhaustive search (`wireless.tracing.space_paths`), so that each path is one that exhaustive
search finds; what no ray has found is missed. More rays find the same and more.

Left out: walls that are passed, as rays end there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.diffraction import close_edge_bound, edge_bound
from wireless.em.fields import NOWHERE_M
from wireless.geometry.cones import MAX_CORNERS, SLACK_M, meeting
from wireless.geometry.images import Space, cone_of, new_views, opens
from wireless.geometry.occlusion import NEAR_M, Boxes
from wireless.support.compiled import compiled
from wireless.tracing.space_engine import Room, enter_bend, enter_view, make_room, write_lists
from wireless.tracing.space_paths import images_over, is_open
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


class Lists(NamedTuple):
    """Strongest paths so far of links, see `wireless.tracing.table.enter`."""

    rank: Float[np.ndarray, "t r k 5"]
    best: Int[np.ndarray, "t r k w"]
    length: Int[np.ndarray, "t r"]


def make_lists(setting: Setting, n_tx: int, n_rx: int) -> Lists:
    """Lists of so many links, with no path in them."""
    most = int(most_interactions(setting))
    return Lists(
        np.empty((n_tx, n_rx, setting.keep, 5)),
        np.zeros((n_tx, n_rx, setting.keep, 3 + most), np.int64),
        np.zeros((n_tx, n_rx), np.int64),
    )


# Inner loops below take the few arrays that they need: to hand all of a space on costs more than such a loop.
@compiled
def _place_edges(
    surfaces: tuple[Float[np.ndarray, "e 2 3"], Float[np.ndarray, "e 3 3"], Float[np.ndarray, " e"]],
    which: Int[np.ndarray, " n"],
    image: Float[np.ndarray, "3"],
    plane: Float[np.ndarray, "p 4"],
    edge: Int[np.ndarray, " q"],
    place: Float[np.ndarray, "q 3"],
    count: int,
) -> int:
    """Append the edges of some that reach into a cone and are open to its image, and where it is; new count."""
    ends, wedge, gap = surfaces
    for j in range(len(which)):
        e = which[j]
        outside = False
        for k in range(len(plane)):
            a, b = SLACK_M - plane[k, 3], SLACK_M - plane[k, 3]
            for i in range(3):
                a += plane[k, i] * ends[e, 0, i]
                b += plane[k, i] * ends[e, 1, i]
            if a < 0 and b < 0:
                outside = True
                break
        if outside:
            continue
        z, x, y = 0.0, 0.0, 0.0
        for i in range(3):
            d = image[i] - ends[e, 0, i]
            z += d * wedge[e, 0, i]
            x += d * wedge[e, 1, i]
            y += d * wedge[e, 2, i]
        distance, angle = np.sqrt(x * x + y * y), np.arctan2(y, x) % (2 * np.pi)
        if distance >= NEAR_M and is_open(gap[e], distance, angle):
            edge[count] = e
            place[count, 0], place[count, 1], place[count, 2] = z, distance, angle
            count += 1
    return count


@compiled
def sights(
    space: Space,
    points: Float[np.ndarray, "s 3"],
    start: Int[np.ndarray, " s1"],
    edge: Int[np.ndarray, " q"],
    over: Int[np.ndarray, "q m"],
    alone: bool,
    every: bool,
) -> Sights:
    """Edges that are open to points and to their images.

    Args:
        space: Surfaces.
        points: Positions around the space's origin [m].
        start: Where each point's edges begin in edge, and an end.
        edge: Edges that rays found over patches.
        over: Patches that they were found over; -1 beyond the last.
        alone: Whether all edges are tried without patches.
        every: Whether all edges in the cones of all single patches are tried.
    """
    n_edges, most, count = len(space.surfaces.edge), over.shape[1], 0
    surfaces = space.surfaces.edge, space.surfaces.edge_wedge, space.surfaces.edge_gap_rad
    begin, room = np.zeros(len(points) + 1, np.int64), 2 * n_edges + 256
    found, place = np.empty(room, np.int64), np.empty((room, 3))
    order, chain = np.zeros(room, np.int64), np.full((room, most), -1, np.int64)
    views, plane = new_views(2, 1), np.empty((MAX_CORNERS + 1, 4))
    spare, here, everything = np.empty((MAX_CORNERS, 3)), np.empty(n_edges, np.int64), np.arange(n_edges)
    for s in range(len(points)):
        if alone:
            count = _place_edges(surfaces, everything, points[s], plane[:0], found, place, count)
        views.image[0, 0] = points[s]
        for h in range(len(space.patch_boxes.number) if every else 0):
            if not opens(space, views, 0, space.patch_boxes.number[h], views, 1, plane, 0, spare):
                continue
            n_planes = cone_of(space, views, 1, plane)
            n = meeting(space.edge_boxes, plane, n_planes, here)
            if count + n_edges > len(found):
                found, place = np.concatenate((found, found)), np.concatenate((place, place))
                order, chain = np.concatenate((order, order)), np.concatenate((chain, chain))
            first = count
            count = _place_edges(surfaces, here[:n], views.image[1, 1], plane[:n_planes], found, place, count)
            for j in range(first, count):
                order[j], chain[j, 0] = 1, views.chain[1, 0]
        for j in range(start[s], start[s + 1]):
            k = 0
            while k < most and over[j, k] >= 0:
                k += 1
            if k == 1 and every:
                continue
            if count + n_edges > len(found):
                found, place = np.concatenate((found, found)), np.concatenate((place, place))
                order, chain = np.concatenate((order, order)), np.concatenate((chain, chain))
            image = images_over(space, points[s], over[j, :k])
            first = count
            count = _place_edges(surfaces, edge[j : j + 1], image[k], plane[:0], found, place, count)
            if count > first:
                order[first], chain[first] = k, over[j]
        begin[s + 1] = count
    return Sights(
        begin, found[:count].copy(), order[:count].copy(), chain[:count].copy(), place[:count].copy()
    )


@compiled
def pairs_of_patches(space: Space, source: Float[np.ndarray, "3"]) -> Int[np.ndarray, "c 2"]:
    """All chains of two patches whose cones meet, whatever hides them; in no order."""
    views, n_patches = new_views(3, 2), len(space.patch_facet)
    views.image[0, 0] = source
    plane, spare = np.empty((MAX_CORNERS + 1, 4)), np.empty((MAX_CORNERS, 3))
    here, chain, count = np.empty(n_patches, np.int64), np.empty((256, 2), np.int64), 0
    for h in range(len(space.patch_boxes.number)):
        if not opens(space, views, 0, space.patch_boxes.number[h], views, 1, plane, 0, spare):
            continue
        n_planes = cone_of(space, views, 1, plane)
        for j in range(meeting(space.patch_boxes, plane, n_planes, here)):
            if opens(space, views, 1, here[j], views, 2, plane, n_planes, spare):
                if count == len(chain):
                    chain = np.concatenate((chain, chain))
                chain[count] = views.chain[2]
                count += 1
    return chain[:count]


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
    sides = (images_over(space, tx, near), near, len(near)), (images_over(space, rx, far), far, len(far))
    return enter_bend(space, setting, tx, rx, edge, sides[0], sides[1], room, rank, best, count)


@compiled
def _unfold(
    surfaces: tuple[Float[np.ndarray, "e 2 3"], Float[np.ndarray, "e 3 3"], Float[np.ndarray, " e"]],
    edge: Int[np.ndarray, " q"],
    place: Float[np.ndarray, "q 3"],
    other: Float[np.ndarray, "3"],
    wavenumber: float,
    least: float,
    which: Int[np.ndarray, " q"],
    bound: Float[np.ndarray, " q"],
) -> int:
    """Sights whose edge is met where the ray leaves it for the other end as it came, and bounds of their power.

    Returns:
        How many are in `which`: those whose power may exceed the least.
    """
    ends, wedge, gap = surfaces
    n = 0
    for j in range(len(edge)):
        e = edge[j]
        z, x, y, end = 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            d = other[i] - ends[e, 0, i]
            z += d * wedge[e, 0, i]
            x += d * wedge[e, 1, i]
            y += d * wedge[e, 2, i]
            end += wedge[e, 0, i] * (ends[e, 1, i] - ends[e, 0, i])
        distance = np.sqrt(x * x + y * y)
        if distance < NOWHERE_M:
            continue
        at = (place[j, 0] * distance + z * place[j, 1]) / (place[j, 1] + distance)
        if at < -NEAR_M or at > end + NEAR_M:
            continue
        angle = np.arctan2(y, x) % (2 * np.pi)
        if not is_open(gap[e], distance, angle):
            continue
        most = edge_bound(angle, place[j, 2], gap[e], wavenumber, place[j, 1], distance)
        if most < least:
            continue
        before, after = np.hypot(place[j, 0] - at, place[j, 1]), np.hypot(z - at, distance)
        slant = distance / after
        most = min(most, close_edge_bound(angle, place[j, 2], gap[e], wavenumber, before, after, slant))
        if most < least:
            continue
        which[n], bound[n] = j, most
        n += 1
    return n


@compiled
def _bend(
    space: Space,
    setting: Setting,
    ends: Float[np.ndarray, "2 3"],
    swapped: bool,
    sights: Sights,
    room: Room,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter the ways over edges that one end sees (over patches, or not) and the other end directly.

    Ends are the one that sees, and the other; swapped if the first is the receiver. What may be strongest comes
    first, so that a full list spares the rest.
    """
    keep, nobody = len(rank), np.empty(0, np.int64)
    surfaces = space.surfaces.edge, space.surfaces.edge_wedge, space.surfaces.edge_gap_rad
    which, bound = np.empty(len(sights.edge), np.int64), np.empty(len(sights.edge))
    least = rank[keep - 1, 0] if count == keep else 0.0
    n = _unfold(surfaces, sights.edge, sights.place, ends[1], setting.wavenumber, least, which, bound)
    order = np.argsort(-bound[:n], kind="mergesort")
    for k in range(n):
        j = which[order[k]]
        if count == keep and bound[order[k]] < rank[keep - 1, 0]:
            break
        e, over = sights.edge[j], sights.over[j, : sights.order[j]]
        if swapped:
            count = _join(space, setting, ends[1], ends[0], e, nobody, over, room, rank, best, count)
        else:
            count = _join(space, setting, ends[0], ends[1], e, over, nobody, room, rank, best, count)
    return count


@compiled
def _bend_over_both(
    space: Space,
    setting: Setting,
    ends: Float[np.ndarray, "2 3"],
    near: Sights,
    far: Sights,
    room: Room,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter the ways over edges that both ends see over patches; both sights by edge."""
    i, last = 0, len(near.edge)
    for j in range(len(far.edge)):
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
def by_edge(sights: Sights) -> Sights:
    """The sights of one point by rising edge."""
    order = np.argsort(sights.edge, kind="mergesort")
    return Sights(
        sights.start, sights.edge[order], sights.order[order], sights.over[order], sights.place[order]
    )


@compiled
def reflect(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    rx_boxes: Boxes,
    chain: Int[np.ndarray, "c m"],
    lists: Lists,
    t: int,
) -> None:
    """Enter the ways from transmitter number t over chains of patches into the lists of its links.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
        rx_boxes: Receivers, sorted into boxes.
        chain: Patches from the transmitter on, by length and in rising order; -1 beyond the last.
        lists: Strongest paths so far.
        t: Which of the lists are meant.
    """
    room = make_room(setting, len(rx))
    _try_chains(space, setting, tx, rx, rx_boxes, chain, room, lists.rank[t], lists.best[t], lists.length[t])


@compiled
def bend(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "t 3"],
    rx: Float[np.ndarray, "r 3"],
    near: list[Sights],
    start: Int[np.ndarray, " r1"],
    edge: Int[np.ndarray, " q"],
    over: Int[np.ndarray, "q m"],
    every: bool,
    lists: Lists,
) -> None:
    """Enter the ways over edges into the lists of all links.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Positions of transmitters, around the space's origin [m].
        rx: Positions of receivers.
        near: What each transmitter may see.
        start: Where each receiver's edges begin in edge, and an end.
        edge: Edges that the receivers' rays found over patches.
        over: Patches that they were found over; -1 beyond the last.
        every: Whether receivers try all edges in the cones of all single patches.
        lists: Strongest paths so far.
    """
    room, ends = make_room(setting, len(rx)), np.empty((2, 3))
    rank, best, count = lists.rank, lists.best, lists.length
    for r in range(len(rx)):
        far = sights(space, rx[r : r + 1], start[r : r + 2], edge, over, False, every)
        if setting.edge_reflections > 1:
            far = by_edge(far)
        for t in range(len(tx)):
            ends[0], ends[1] = tx[t], rx[r]
            count[t, r] = _bend(
                space, setting, ends, False, near[t], room, rank[t, r], best[t, r], count[t, r]
            )
            if setting.edge_reflections > 1:
                count[t, r] = _bend_over_both(
                    space, setting, ends, near[t], far, room, rank[t, r], best[t, r], count[t, r]
                )
            ends[0], ends[1] = rx[r], tx[t]
            count[t, r] = _bend(space, setting, ends, True, far, room, rank[t, r], best[t, r], count[t, r])


@compiled
def tabled(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    lists: Lists,
    t: int,
) -> Table:
    """The table of transmitter number t, from the lists of its links."""
    table = make_table(setting, len(rx))
    table.found[:] = lists.length[t]
    write_lists(space, setting, tx, rx, make_room(setting, len(rx)), lists.best[t], table)
    return table
