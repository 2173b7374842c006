"""The strongest paths of links among any triangles: images over facets, bent at edges, each leg looked at.

Chains of images of the transmitter are walked depth first (`wireless.geometry.images`). For each receiver in the cone
of an image the way is walked back from the receiver, and is a path if each point lies in its facet and its
legs meet no more walls than may be passed. At an edge the ways from both ends are unfolded into one straight
line (the ray leaves at the angle it arrives, Keller's law), which gives the point on the edge: edges that
images of the transmitter see are joined with those in the cones of the receiver's images.

Nothing is sampled. What cannot enter a link's list is not computed, by the bounds that floor plans have too
(`wireless.tracing.plan_engine`), which are faster and find the same paths.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.diffraction import edge_bound
from wireless.em.fields import NOWHERE_M
from wireless.geometry.boxes import Boxes
from wireless.geometry.cones import MAX_CORNERS, PIECES, SLACK_M, clipped, meeting, sees
from wireless.geometry.images import Space, Views, all_views, cone_of, new_views, spread, windows_of
from wireless.support.compiled import compiled
from wireless.tracing.laying import edge_sight, ground_of, images_over, is_open, lay, on_large
from wireless.tracing.space_paths import aside, pass_walls, try_path, weigh_path
from wireless.tracing.table import (
    Scratch,
    Setting,
    Table,
    make_scratch,
    make_table,
    most_interactions,
    write_row,
)

#: With fewer receivers, asking each costs less than finding out whether the last patch is seen at all.
_FEW = 32


class Room(NamedTuple):
    """Arrays to work in, for one transmitter and some receivers."""

    scratch: Scratch
    points: Float[np.ndarray, "m 3"]
    who: Int[np.ndarray, " w"]
    where: Float[np.ndarray, " k"]
    which: Int[np.ndarray, " k"]
    receivers: Int[np.ndarray, " r"]
    plane: Float[np.ndarray, "p 4"]
    piece: Float[np.ndarray, "s k 3"]


@compiled
def make_room(setting: Setting, n_rx: int) -> Room:
    """Arrays to work in."""
    most = most_interactions(setting)
    return Room(
        make_scratch(setting),
        np.empty((most, 3)),
        np.zeros(3 + most, np.int64),
        np.empty(setting.max_through),
        np.empty(setting.max_through, np.int64),
        np.empty(n_rx, np.int64),
        np.empty((MAX_CORNERS + 1, 4)),
        np.empty((PIECES, MAX_CORNERS, 3)),
    )


@compiled
def enter_view(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    rx_boxes: Boxes,
    views: Views,
    v: int,
    room: Room,
    rank: Float[np.ndarray, "r k 5"],
    best: Int[np.ndarray, "r k w"],
    count: Int[np.ndarray, " r"],
) -> None:
    """Enter the ways over the chain of one view into the lists of the receivers in its cone."""
    keep, k2 = rank.shape[1], 2 * setting.wavenumber
    order, plane, who = views.order[v], room.plane, room.who
    n_planes = cone_of(windows_of(space), views, v, plane)
    image, chain, ground = views.image[v], views.chain[v], ground_of(space)
    who[0], who[1], who[2], who[3 : 3 + order] = -1, order, 0, chain[:order]
    for h in range(meeting(rx_boxes, plane, n_planes, room.receivers)):
        r = room.receivers[h]
        inside = True
        for k in range(n_planes):
            depth = SLACK_M - plane[k, 3]
            for i in range(3):
                depth += plane[k, i] * rx[r, i]
            inside = inside and depth >= 0
        if not inside:
            continue
        if count[r] == keep:
            length2 = 0.0
            for i in range(3):
                length2 += (image[order, i] - rx[r, i]) ** 2
            if rank[r, keep - 1, 0] * k2 * k2 * length2 > 1:
                continue
        scratch = room.scratch
        m, large = lay(
            ground,
            tx,
            rx[r],
            (image, chain, order),
            -1,
            (image, chain, 0),
            room.points,
            scratch.point,
            scratch.kind,
            scratch.primitive,
        )
        if m >= 0 and not (large and not on_large(space, chain, order, -1, chain, 0, scratch.point)):
            count[r] = try_path(
                space,
                setting,
                tx,
                rx[r],
                room.points,
                m,
                who,
                room.scratch,
                room.where,
                room.which,
                rank[r],
                best[r],
                count[r],
            )


@compiled
def enter_bend(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    edge: int,
    near: tuple[Float[np.ndarray, "m1 3"], Int[np.ndarray, " m"], int],
    far: tuple[Float[np.ndarray, "n1 3"], Int[np.ndarray, " n"], int],
    room: Room,
    rank: Float[np.ndarray, "k 5"],
    best: Int[np.ndarray, "k w"],
    count: int,
) -> int:
    """Enter the way over an edge and patches of both ends into a link's list; the list's new length.

    Near and far as in `wireless.tracing.laying.lay`.
    """
    scratch = room.scratch
    m, large = lay(
        ground_of(space),
        tx,
        rx,
        near,
        edge,
        far,
        room.points,
        scratch.point,
        scratch.kind,
        scratch.primitive,
    )
    if m < 0 or (large and not on_large(space, near[1], near[2], edge, far[1], far[2], scratch.point)):
        return count
    who, before, after = room.who, near[2], far[2]
    who[0], who[1], who[2] = edge, before, after
    who[3 : 3 + before], who[3 + before : 3 + before + after] = near[1][:before], far[1][:after]
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
def _reflect(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    rx_boxes: Boxes,
    room: Room,
    rank: Float[np.ndarray, "r k 5"],
    best: Int[np.ndarray, "r k w"],
    count: Int[np.ndarray, " r"],
) -> None:
    """Enter all ways without diffraction into the lists of their links; chains are walked depth first."""
    views, n = new_views(64, setting.max_reflections), 1
    views.image[0, 0] = tx
    found = np.empty(len(space.patch_facet), np.int64)
    while n > 0:
        n -= 1
        order = views.order[n]
        enter_view(space, setting, tx, rx, rx_boxes, views, n, room, rank, best, count)
        if order < setting.max_reflections:
            worth = order + 1 < setting.max_reflections or len(rx) > _FEW
            occluding = worth and setting.max_through == 0
            views, n = spread(space, views, n, n, occluding, room.plane, found, room.piece)


@compiled
def _widen(
    line: Float[np.ndarray, "k 3"],
    image: Float[np.ndarray, "3"],
    strip: Float[np.ndarray, "4 3"],
    aside_m: float,
) -> None:
    """Make a strip across the view of a line, so narrow that it is seen if the line is seen or touched."""
    size, across = 0.0, np.empty(3)
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        across[i] = (line[1, a] - line[0, a]) * (image[b] - line[0, b]) - (line[1, b] - line[0, b]) * (
            image[a] - line[0, a]
        )
        size += across[i] ** 2
    across *= aside_m / np.sqrt(size) if size > 0 else 0.0
    for i in range(3):
        strip[0, i], strip[1, i] = line[0, i] - across[i], line[1, i] - across[i]
        strip[2, i], strip[3, i] = line[1, i] + across[i], line[0, i] + across[i]


@compiled
def lit_edges(
    space: Space, views: Views, n: int, occluding: bool
) -> tuple[Int[np.ndarray, "h 2"], Float[np.ndarray, "h 3"]]:
    """Pairs of edge and view that sees it, by edge, and where the image is (`edge_sight`)."""
    found, pair, sight, h = (
        np.empty(len(space.surfaces.edge), np.int64),
        np.empty((64, 2), np.int64),
        np.empty((64, 3)),
        0,
    )
    plane, piece = np.empty((MAX_CORNERS + 1, 4)), np.empty((PIECES, MAX_CORNERS, 3))
    line, ends, behind = np.empty((MAX_CORNERS, 3)), np.empty((2, 3)), np.zeros(4)
    strip, near_m = np.empty((4, 3)), space.surfaces.near_m
    for v in range(n):
        n_planes = cone_of(windows_of(space), views, v, plane)
        if n_planes > 0:
            behind[:] = plane[n_planes - 1]
        image = views.image[v, views.order[v]]
        for j in range(meeting(space.edge_boxes, plane, n_planes, found)):
            edge = found[j]
            z, distance, angle = edge_sight(space.surfaces.edge, space.surfaces.edge_wedge, edge, image)
            if distance < near_m or not is_open(space.surfaces.edge_gap_rad[edge], distance, angle, near_m):
                continue
            ends[:] = space.surfaces.edge[edge]
            if clipped(ends, 2, plane, n_planes, line, piece[0]) == 0:
                continue
            _widen(line, image, strip, aside(near_m))
            if occluding and not sees(
                space.tree, space.tree_wall, space.wall, space.wall_corners, image, behind, strip, 4, piece
            ):
                continue
            if h == len(pair):
                pair, sight = np.concatenate((pair, pair)), np.concatenate((sight, sight))
            pair[h, 0], pair[h, 1] = edge, v
            sight[h, 0], sight[h, 1], sight[h, 2] = z, distance, angle
            h += 1
    order = np.argsort(pair[:h, 0], kind="mergesort")
    return pair[order], sight[order]


@compiled
def _bend(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    room: Room,
    rank: Float[np.ndarray, "r k 5"],
    best: Int[np.ndarray, "r k w"],
    count: Int[np.ndarray, " r"],
) -> None:
    """Enter all ways over an edge into the lists of their links."""
    keep, orders, plane, touch_m = rank.shape[1], setting.edge_reflections, room.plane, space.surfaces.near_m
    occluding = setting.max_through == 0
    side = setting.side_reflections
    near, n_near = all_views(space, tx, side, occluding)
    pair, sight = lit_edges(space, near, n_near, occluding)
    start = np.searchsorted(pair[:, 0], np.arange(len(space.surfaces.edge) + 1))
    found = np.empty(len(space.surfaces.edge), np.int64)
    for r in range(len(rx)):
        far, n_far = all_views(space, rx[r], side, occluding)
        for v in range(n_far):
            after = far.order[v]
            image = far.image[v, after]
            n_planes = cone_of(windows_of(space), far, v, plane)
            for e in range(meeting(space.edge_boxes, plane, n_planes, found)):
                edge = found[e]
                if start[edge] == start[edge + 1]:
                    continue
                gap = space.surfaces.edge_gap_rad[edge]
                far_z, far_m, phi = edge_sight(space.surfaces.edge, space.surfaces.edge_wedge, edge, image)
                if far_m < NOWHERE_M or not is_open(gap, far_m, phi, touch_m):
                    continue
                end = 0.0
                for i in range(3):
                    end += space.surfaces.edge_wedge[edge, 0, i] * (
                        space.surfaces.edge[edge, 1, i] - space.surfaces.edge[edge, 0, i]
                    )
                for j in range(start[edge], start[edge + 1]):
                    w = pair[j, 1]
                    before = near.order[w]
                    near_z, near_m = sight[j, 0], sight[j, 1]
                    z = (near_z * far_m + far_z * near_m) / (near_m + far_m)
                    if before + after > orders:  # views come by order
                        break
                    if z < -touch_m or z > end + touch_m:
                        continue
                    if count[r] == keep:
                        most_power = edge_bound(phi, sight[j, 2], gap, setting.wavenumber, near_m, far_m)
                        if most_power < rank[r, keep - 1, 0]:
                            continue
                    count[r] = enter_bend(
                        space,
                        setting,
                        tx,
                        rx[r],
                        edge,
                        (near.image[w], near.chain[w], before),
                        (far.image[v], far.chain[v], after),
                        room,
                        rank[r],
                        best[r],
                        count[r],
                    )


@compiled
def trace_space(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    rx_boxes: Boxes,
) -> Table:
    """Strongest paths from one transmitter to many receivers.

    Args:
        space: Surfaces.
        setting: Physics and limits; permittivities are those of facets.
        tx: Position of the transmitter, around the space's origin [m].
        rx: Positions of receivers.
        rx_boxes: Receivers, sorted into boxes.
    """
    keep, most, found = setting.keep, most_interactions(setting), np.zeros(len(rx), np.int64)
    rank, best = np.empty((len(rx), keep, 5)), np.empty((len(rx), keep, 3 + most), np.int64)
    room = make_room(setting, len(rx))
    _reflect(space, setting, tx, rx, rx_boxes, room, rank, best, found)
    if setting.edge_reflections >= 0 and len(space.surfaces.edge):
        _bend(space, setting, tx, rx, room, rank, best, found)
    return table_of(space, setting, tx, rx, room, best, found)


@compiled
def table_of(
    space: Space,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "r 3"],
    room: Room,
    best: Int[np.ndarray, "r k w"],
    found: Int[np.ndarray, " r"],
) -> Table:
    """The table of each link's list, whose paths are laid out and weighed once more."""
    scratch, ground, surfaces = room.scratch, ground_of(space), space.surfaces
    table, row = make_table(setting, len(rx), found.sum()), 0
    table.found[:] = found
    for r in range(len(rx)):
        for j in range(table.found[r]):
            edge, before, after = best[r, j, 0], best[r, j, 1], best[r, j, 2]
            near = best[r, j, 3 : 3 + before]
            far = best[r, j, 3 + before : 3 + before + after]
            m, _ = lay(
                ground,
                tx,
                rx[r],
                (images_over(ground.plane, tx, near), near, before),
                edge,
                (images_over(ground.plane, rx[r], far), far, after),
                room.points,
                scratch.point,
                scratch.kind,
                scratch.primitive,
            )
            if setting.max_through > 0:
                m = pass_walls(space, setting, m, scratch, room.where, room.which)
            length, power = weigh_path(
                surfaces.facet_normal, surfaces.edge_facets, ground, setting, m, scratch
            )
            write_row(table, row, length, power, m, scratch)
            row += 1
    return table
