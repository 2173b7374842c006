"""The strongest paths of links among stacked storeys: views of both ends, joined at edges, weighed.

As in a floor plan (`wireless.tracing.plan_engine`) reflections come from the views of the transmitter, and diffracted
paths are joined where a view of either end meets the same edge. At an upright edge the way from above is one straight
line when unfolded, whose slope both views must allow. At the rim of a slab the ways from both ends are unfolded about
it, which gives the point of the rim (Keller's law) that both must see; each way rises or falls as evenly as it likes.

Left out: reflections at floors and ceilings, walls that are passed (`wireless.tracing.space_engine` has both).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.diffraction import edge_bound
from wireless.em.fields import NOWHERE_M
from wireless.geometry.beams import NEAR_M
from wireless.geometry.growing import longer, longer_ints
from wireless.geometry.layer_beams import cast_layers
from wireless.geometry.layers import Layers
from wireless.support.compiled import compiled
from wireless.tracing.plan_engine import (
    by_first,
    corner_sight,
    lay_flat,
    lay_over,
    raise_flat,
    weigh_flat,
)
from wireless.tracing.table import (
    Scratch,
    Setting,
    Table,
    enter,
    make_scratch,
    make_table,
    weigh,
    with_room,
    write_row,
)

#: Slopes that differ by less are one.
_SLOPE = 1e-12


class LayerViews(NamedTuple):
    """Views of many points, one after the other, without their targets."""

    view_start: Int[np.ndarray, " r1"]
    """Where each point's views begin, and an end."""
    image: Float[np.ndarray, "b 2"]
    """See `wireless.geometry.layer_beams.Seen`, as for the next."""
    chain: Int[np.ndarray, "b 5"]
    """Views before count from the point's first one."""
    corner_start: Int[np.ndarray, " r1"]
    """Where each point's corners begin, and an end."""
    corner_hit: Int[np.ndarray, "c 2"]
    corner_slope: Float[np.ndarray, "c 2"]
    rim_start: Int[np.ndarray, " r1"]
    """Where each point's rims begin, and an end."""
    rim_hit: Int[np.ndarray, "e 2"]
    rim_part: Float[np.ndarray, "e 2"]


@compiled
def _grown_ints(a: Int[np.ndarray, "n k"], n: int) -> Int[np.ndarray, "m k"]:
    while len(a) < n:
        a = longer_ints(a)
    return a


@compiled
def _grown(a: Float[np.ndarray, "n k"], n: int) -> Float[np.ndarray, "m k"]:
    while len(a) < n:
        a = longer(a)
    return a


@compiled
def layer_views(
    layers: Layers,
    points: Float[np.ndarray, "r 3"],
    start: Int[np.ndarray, " r1"],
    start_list: Int[np.ndarray, " s"],
    edge_order: int,
    span_m: Float[np.ndarray, "2 2"],
) -> LayerViews:
    """Views of many points onto edges.

    Args:
        layers: Walls, corners, triangles and openings.
        points: Positions [m] around the layers' origin.
        start: Where each point's triangles begin in start_list, and an end.
        start_list: Triangles around points.
        edge_order: Most reflections on the way to an edge.
        span_m: See `wireless.geometry.layer_beams.cast_layers`.
    """
    n = len(points)
    view_start, corner_start, rim_start = (
        np.zeros(n + 1, np.int64),
        np.zeros(n + 1, np.int64),
        np.zeros(n + 1, np.int64),
    )
    image, view = np.empty((1024, 2)), np.empty((1024, 5), np.int64)
    corner, slope = np.empty((1024, 2), np.int64), np.empty((1024, 2))
    rim, part = np.empty((1024, 2), np.int64), np.empty((1024, 2))
    nobody, nothing = np.empty((0, 3)), np.zeros(len(layers.tri_layer) + 1, np.int64)
    empty = np.empty(0, np.int64)
    for i in range(n):
        around = start_list[start[i] : start[i + 1]]
        seen = cast_layers(layers, around, points[i], nobody, nothing, empty, -1, edge_order, span_m)
        v, c, e = view_start[i], corner_start[i], rim_start[i]
        view_start[i + 1], corner_start[i + 1] = v + len(seen.image), c + len(seen.corner_hit)
        rim_start[i + 1] = e + len(seen.rim_hit)
        image, view = _grown(image, view_start[i + 1]), _grown_ints(view, view_start[i + 1])
        corner, slope = _grown_ints(corner, corner_start[i + 1]), _grown(slope, corner_start[i + 1])
        rim, part = _grown_ints(rim, rim_start[i + 1]), _grown(part, rim_start[i + 1])
        image[v : view_start[i + 1]], view[v : view_start[i + 1]] = seen.image, seen.chain
        corner[c : corner_start[i + 1]], slope[c : corner_start[i + 1]] = seen.corner_hit, seen.corner_slope
        rim[e : rim_start[i + 1]], part[e : rim_start[i + 1]] = seen.rim_hit, seen.rim_part
    return LayerViews(
        view_start,
        image[: view_start[n]],
        view[: view_start[n]],
        corner_start,
        corner[: corner_start[n]],
        slope[: corner_start[n]],
        rim_start,
        rim[: rim_start[n]],
        part[: rim_start[n]],
    )


@compiled
def _rim_sight(layers: Layers, rim: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Place along a rim, distance from its line and angle from its 0-face of a point; distance -1 if behind it."""
    end, wedge = layers.rim[rim, 0], layers.rim_wedge[rim]
    dx, dy, dz = x - end[0], y - end[1], z - end[2]
    along = dx * wedge[0, 0] + dy * wedge[0, 1] + dz * wedge[0, 2]
    a = dx * wedge[1, 0] + dy * wedge[1, 1] + dz * wedge[1, 2]
    b = dx * wedge[2, 0] + dy * wedge[2, 1] + dz * wedge[2, 2]
    distance, angle = np.hypot(a, b), np.arctan2(b, a) % (2 * np.pi)
    near = NEAR_M / max(distance, NEAR_M)
    if distance < NEAR_M or layers.rim_gap_rad[rim] + near < angle < 2 * np.pi - near:
        return along, -1.0, angle
    return along, distance, angle


@compiled
def _lay_rim(
    layers: Layers,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "b 2"],
    view: Int[np.ndarray, "b 5"],
    node: int,
    rim: int,
    along: float,
    far_image: Float[np.ndarray, "d 2"],
    far_view: Int[np.ndarray, "d 5"],
    far_node: int,
    scratch: Scratch,
) -> int:
    """Put a path over some place along a rim into `scratch`; its number of interactions."""
    plan, point = layers.plan, scratch.point
    end, way = layers.rim[rim, 0], layers.rim_wedge[rim, 0]
    x, y, z = end[0] + along * way[0], end[1] + along * way[1], end[2] + along * way[2]
    number = len(plan.corner_vertex) + rim
    n = lay_over(plan, tx, rx, image, view, node, number, x, y, far_image, far_view, far_node, scratch)
    edge, flat = view[node, 2] + view[node, 3], scratch.flat
    for half in range(2):
        first, last = (0, edge + 1) if half == 0 else (edge + 1, n + 1)
        low, high = (tx[2], z) if half == 0 else (z, rx[2])
        total, gone = 0.0, 0.0
        for j in range(first, last):
            total += np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
        point[first, 0], point[first, 1], point[first, 2] = flat[first, 0], flat[first, 1], low
        for j in range(first, last):
            gone += np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
            share = gone / total if total > 0 else 1.0
            point[j + 1, 0], point[j + 1, 1] = flat[j + 1, 0], flat[j + 1, 1]
            point[j + 1, 2] = low + share * (high - low) if j + 1 < last else high
    for j in range(n):
        scratch.kind[j], scratch.primitive[j] = scratch.flat_kind[j], scratch.flat_primitive[j]
        if j == edge:
            continue
        wall = scratch.primitive[j]
        scratch.normal[j, 0], scratch.normal[j, 1] = -plan.wall_along[wall, 1], plan.wall_along[wall, 0]
        scratch.normal[j, 2] = 0.0
        scratch.walls[j] = setting.walls[wall]
    return n


@compiled
def _lay(
    layers: Layers,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "b 2"],
    view: Int[np.ndarray, "b 5"],
    node: int,
    edge: int,
    along: float,
    far_image: Float[np.ndarray, "d 2"],
    far_view: Int[np.ndarray, "d 5"],
    far_node: int,
    scratch: Scratch,
) -> tuple[int, float, float]:
    """Lay out and weigh a path: its number of interactions, length and power; length -1 if it is none.

    Edges are corners, then rims; -1 for a path without one.
    """
    plan, n_corners = layers.plan, len(layers.plan.corner_vertex)
    if edge < n_corners:
        n = lay_flat(plan, tx, rx, image, view, node, edge, far_image, far_view, far_node, scratch)
        m = raise_flat(plan, setting, tx[2], rx[2], n, 0, scratch)
        scratch.wedge[:] = 0.0  # of a rim before
        length, power = weigh_flat(plan, setting, edge, m, scratch)
        return m, length, power
    rim = edge - n_corners
    m = _lay_rim(
        layers, setting, tx, rx, image, view, node, rim, along, far_image, far_view, far_node, scratch
    )
    scratch.wedge[:] = layers.rim_wedge[rim]
    for i in range(2):
        scratch.wedge_walls[i] = setting.walls[layers.rim_walls[rim, i]]
    length, power = weigh(setting, m, layers.rim_gap_rad[rim] / np.pi, scratch)
    return m, length, power


@compiled
def _try(
    layers: Layers,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "b 2"],
    view: Int[np.ndarray, "b 5"],
    node: int,
    edge: int,
    along: float,
    far_image: Float[np.ndarray, "d 2"],
    far_view: Int[np.ndarray, "d 5"],
    far_node: int,
    scratch: Scratch,
    rank: Float[np.ndarray, "k 5"],
    who: Int[np.ndarray, "k 3"],
    where: Float[np.ndarray, " k1"],
    count: int,
) -> int:
    """Enter a path into the list, and how far along its rim it is into `where`; the list's new length."""
    m, length, power = _lay(
        layers,
        setting,
        tx,
        rx,
        image,
        view,
        node,
        edge,
        along,
        far_image,
        far_view,
        far_node,
        scratch,
    )
    if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
        return count
    new, p = np.empty(5), scratch.point
    new[0], new[1] = power, length
    new[2] = np.arctan2(p[1, 1] - p[0, 1], p[1, 0] - p[0, 0]) + (p[1, 2] - p[0, 2]) / length
    new[3] = np.arctan2(p[m, 1] - p[m + 1, 1], p[m, 0] - p[m + 1, 0]) + (p[m, 2] - p[m + 1, 2]) / length
    new[4] = 1000 * m + (500 if edge >= 0 else 0)
    before = count
    count, place = enter(rank, who, count, new)
    if place >= 0:
        for j in range(min(before, len(where) - 1), place, -1):
            where[j] = where[j - 1]
        who[place, 0], who[place, 1], who[place, 2], where[place] = node, edge, far_node, along
    return count


@compiled
def trace_layers(
    layers: Layers,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    around_tx: Int[np.ndarray, " s"],
    rx: Float[np.ndarray, "r 3"],
    target_start: Int[np.ndarray, " t1"],
    target_list: Int[np.ndarray, " tr"],
    far: LayerViews,
    span_m: Float[np.ndarray, "2 2"],
) -> Table:
    """Strongest paths from one transmitter to many receivers.

    Args:
        layers: Walls, corners, triangles and openings.
        setting: Physics and limits.
        tx: Position of the transmitter, around the layers' origin [m].
        around_tx: Triangles that it lies in.
        rx: Positions of receivers.
        target_start: Where each triangle's receivers begin in target_list, and an end.
        target_list: Receivers by triangle.
        far: Views of the receivers onto edges.
        span_m: See `wireless.geometry.layer_beams.cast_layers`.
    """
    plan, n_rx, keep, table = layers.plan, len(rx), setting.keep, make_table(setting, len(rx), len(rx))
    n_corners, k = len(plan.corner_vertex), setting.wavenumber
    image, view, hit, corner_hit, corner_slope, rim_hit, rim_part = cast_layers(
        layers,
        around_tx,
        tx,
        rx,
        target_start,
        target_list,
        setting.max_reflections,
        setting.side_reflections,
        span_m,
    )
    hit_start, hit_view = by_first(hit, n_rx)
    near_start, near_hit = _sorted(corner_hit, n_corners)
    near_sight = np.empty((len(near_hit), 2))
    for j in range(len(near_hit)):
        c, v = corner_hit[near_hit[j]]
        near_sight[j] = corner_sight(plan, c, image[v, 0], image[v, 1])
    over_start, over_hit = _sorted(rim_hit, len(layers.rim))
    over_sight = np.empty((len(over_hit), 3))
    for j in range(len(over_hit)):
        e, v = rim_hit[over_hit[j]]
        over_sight[j] = _rim_sight(layers, e, image[v, 0], image[v, 1], tx[2])
    scratch, rank, who = make_scratch(setting), np.empty((keep, 5)), np.empty((keep, 3), np.int64)
    where = np.empty(keep)
    row = 0
    for i in range(n_rx):
        count = 0
        v = far.view_start[i]
        far_image, far_view = far.image[v : far.view_start[i + 1]], far.chain[v : far.view_start[i + 1]]
        rise = rx[i, 2] - tx[2]
        for j in range(hit_start[i], hit_start[i + 1]):
            node = hit_view[j]
            if view[node, 2] > setting.max_met:
                continue
            if count == keep:
                length = np.hypot(image[node, 0] - rx[i, 0], image[node, 1] - rx[i, 1])
                if (2 * k * np.hypot(length, rise)) ** -2 < rank[count - 1, 0]:
                    continue
            count = _try(
                layers,
                setting,
                tx,
                rx[i],
                image,
                view,
                node,
                -1,
                0.0,
                far_image,
                far_view,
                0,
                scratch,
                rank,
                who,
                where,
                count,
            )
        for h in range(far.corner_start[i], far.corner_start[i + 1]):
            corner, far_node = far.corner_hit[h]
            if near_start[corner] == near_start[corner + 1]:
                continue
            after, phi = corner_sight(plan, corner, far_image[far_node, 0], far_image[far_node, 1])
            if after < NOWHERE_M:
                continue
            for j in range(near_start[corner], near_start[corner + 1]):
                one = near_hit[j]
                node, before = corner_hit[one, 1], near_sight[j, 0]
                reflections = view[node, 2] + far_view[far_node, 2]
                if reflections > setting.edge_reflections or 1 + reflections > setting.max_met:
                    continue
                if before < NOWHERE_M:
                    continue
                slope = rise / (before + after)
                if not (corner_slope[one, 0] - _SLOPE <= slope <= corner_slope[one, 1] + _SLOPE):
                    continue
                if not (far.corner_slope[h, 0] - _SLOPE <= -slope <= far.corner_slope[h, 1] + _SLOPE):
                    continue
                if count == keep:
                    gap = plan.corner_gap_rad[corner]
                    if edge_bound(phi, near_sight[j, 1], gap, k, before, after) < rank[count - 1, 0]:
                        continue
                count = _try(
                    layers,
                    setting,
                    tx,
                    rx[i],
                    image,
                    view,
                    node,
                    corner,
                    0.0,
                    far_image,
                    far_view,
                    far_node,
                    scratch,
                    rank,
                    who,
                    where,
                    count,
                )
        for h in range(far.rim_start[i], far.rim_start[i + 1]):
            rim, far_node = far.rim_hit[h]
            if over_start[rim] == over_start[rim + 1]:
                continue
            far_s, after, phi = _rim_sight(
                layers, rim, far_image[far_node, 0], far_image[far_node, 1], rx[i, 2]
            )
            if after < NOWHERE_M:
                continue
            for j in range(over_start[rim], over_start[rim + 1]):
                one = over_hit[j]
                node, before = rim_hit[one, 1], over_sight[j, 1]
                reflections = view[node, 2] + far_view[far_node, 2]
                if reflections > setting.edge_reflections or 1 + reflections > setting.max_met:
                    continue
                if before < NOWHERE_M:
                    continue
                along = (over_sight[j, 0] * after + far_s * before) / (before + after)
                if not (rim_part[one, 0] - NEAR_M <= along <= rim_part[one, 1] + NEAR_M):
                    continue
                if not (far.rim_part[h, 0] - NEAR_M <= along <= far.rim_part[h, 1] + NEAR_M):
                    continue
                if count == keep:
                    gap = layers.rim_gap_rad[rim]
                    if edge_bound(phi, over_sight[j, 2], gap, k, before, after) < rank[count - 1, 0]:
                        continue
                count = _try(
                    layers,
                    setting,
                    tx,
                    rx[i],
                    image,
                    view,
                    node,
                    n_corners + rim,
                    along,
                    far_image,
                    far_view,
                    far_node,
                    scratch,
                    rank,
                    who,
                    where,
                    count,
                )
        table.found[i] = count
        table = with_room(setting, table, row + count)
        for j in range(count):
            node, edge, far_node = who[j]
            m, length, power = _lay(
                layers,
                setting,
                tx,
                rx[i],
                image,
                view,
                node,
                edge,
                where[j],
                far_image,
                far_view,
                far_node,
                scratch,
            )
            write_row(table, row + j, length, power, m, scratch)
        row += count
    return table


@compiled
def _sorted(pairs: Int[np.ndarray, "h 2"], n: int) -> tuple[Int[np.ndarray, " n1"], Int[np.ndarray, " h"]]:
    """Numbers of pairs by their first entry, and where each entry's begin."""
    numbered = np.empty_like(pairs)
    for i in range(len(pairs)):
        numbered[i, 0], numbered[i, 1] = pairs[i, 0], i
    return by_first(numbered, n)
