"""The strongest paths of links in a floor plan: views of both ends, joined at corners, weighed.

Reflections come from the views of the transmitter. Diffracted paths are joined where a view of the
transmitter and a view of the receiver share a corner. Seen from above a path is unfolded into a straight
line, along which the height changes evenly; floor and ceiling fold the height only. What cannot enter a
link's list is not computed: a reflection by its length, a diffraction by a bound on cot(u / 2n) F
(`wireless.em.diffraction`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.em.diffraction import edge_bound
from wireless.em.fields import DIFFRACTION, NOWHERE_M, REFLECTION, TRANSMISSION
from wireless.geometry.beams import Sight, cast, views_onto
from wireless.geometry.growing import longer, longer_ints
from wireless.geometry.plan import Plan
from wireless.support.compiled import compiled
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


class Views(NamedTuple):
    """Views of many points, one after the other, without their targets."""

    view_start: Int[np.ndarray, " r1"]
    """Where each point's views begin, and an end."""
    image: Float[np.ndarray, "b 2"]
    """See `wireless.geometry.beams.Sight`."""
    chain: Int[np.ndarray, "b 5"]
    """See `wireless.geometry.beams.Sight`; views before count from the point's first one."""
    hit_start: Int[np.ndarray, " r1"]
    """Where each point's corners begin, and an end."""
    corner_hit: Int[np.ndarray, "c 2"]
    """Pairs of corner and view."""


@compiled
def views_of(
    plan: Plan,
    points: Float[np.ndarray, "r 2"],
    start: Int[np.ndarray, " r1"],
    start_list: Int[np.ndarray, " s"],
    corner_order: int,
    max_through: int,
) -> Views:
    """Views of many points onto corners.

    Args:
        plan: Walls, corners and triangles.
        points: Positions [m] around the plan's origin.
        start: Where each point's triangles begin in start_list, and an end.
        start_list: Triangles around points.
        corner_order: Most reflections on the way to a corner.
        max_through: Most walls to pass on the way.
    """
    n = len(points)
    view_start, hit_start = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    image, view = np.empty((1024, 2)), np.empty((1024, 5), np.int64)
    hits, nobody = np.empty((1024, 2), np.int64), np.zeros(len(plan.tri_vertex), np.bool_)
    for i in range(n):
        around = start_list[start[i] : start[i + 1]]
        found = cast(plan, around, points[i], nobody, 0, -1, corner_order, max_through)
        one, one_view, one_hit = found.image, found.chain, found.corner_hit
        v, h = view_start[i], hit_start[i]
        view_start[i + 1], hit_start[i + 1] = v + len(one), h + len(one_hit)
        while len(image) < v + len(one):
            image, view = longer(image), longer_ints(view)
        while len(hits) < h + len(one_hit):
            hits = longer_ints(hits)
        # Number by number: for rows numba would compile a message for shapes that differ, too.
        for j in range(len(one)):
            for k in range(2):
                image[v + j, k] = one[j, k]
            for k in range(5):
                view[v + j, k] = one_view[j, k]
        for j in range(len(one_hit)):
            for k in range(2):
                hits[h + j, k] = one_hit[j, k]
    return Views(view_start, image[: view_start[n]], view[: view_start[n]], hit_start, hits[: hit_start[n]])


@compiled
def _mirror_point(
    plan: Plan, wall: int, image: Float[np.ndarray, "2"], tx: float, ty: float
) -> tuple[float, float]:
    """Where the way from an image to a target meets the wall it was mirrored at."""
    nx, ny = -plan.wall_along[wall, 1], plan.wall_along[wall, 0]
    px, py = plan.wall_point[wall, 0], plan.wall_point[wall, 1]
    a = (image[0] - px) * nx + (image[1] - py) * ny
    b = (tx - px) * nx + (ty - py) * ny
    f = a / (a - b) if a != b else 1.0
    return image[0] + (tx - image[0]) * f, image[1] + (ty - image[1]) * f


@compiled
def lay_flat(
    plan: Plan,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "b 2"],
    view: Int[np.ndarray, "b 5"],
    node: int,
    corner: int,
    far_image: Float[np.ndarray, "d 2"],
    far_view: Int[np.ndarray, "d 5"],
    far_node: int,
    scratch: Scratch,
) -> int:
    """Points of a path seen from above; its number of interactions."""
    x, y = rx[0], rx[1]
    if corner >= 0:
        x, y = plan.vertex[plan.corner_vertex[corner], 0], plan.vertex[plan.corner_vertex[corner], 1]
    return lay_over(plan, tx, rx, image, view, node, corner, x, y, far_image, far_view, far_node, scratch)


@compiled
def lay_over(
    plan: Plan,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "b 2"],
    view: Int[np.ndarray, "b 5"],
    node: int,
    corner: int,
    x: float,
    y: float,
    far_image: Float[np.ndarray, "d 2"],
    far_view: Int[np.ndarray, "d 5"],
    far_node: int,
    scratch: Scratch,
) -> int:
    """The same with a diffraction, if there is one (corner >= 0), at (x, y)."""
    flat, kind, primitive = scratch.flat, scratch.flat_kind, scratch.flat_primitive
    n = view[node, 2] + view[node, 3]
    if corner >= 0:
        flat[n + 1, 0], flat[n + 1, 1] = x, y
        kind[n], primitive[n] = DIFFRACTION, corner
    cx, cy = x, y
    for j in range(n, 0, -1):
        x, y = _mirror_point(plan, view[node, 0], image[node], x, y)
        flat[j, 0], flat[j, 1] = x, y
        kind[j - 1], primitive[j - 1] = TRANSMISSION if view[node, 4] else REFLECTION, view[node, 0]
        node = view[node, 1]
    if corner >= 0:
        n += 1
        x, y = cx, cy
        while far_view[far_node, 1] >= 0:
            x, y = _mirror_point(plan, far_view[far_node, 0], far_image[far_node], x, y)
            flat[n + 1, 0], flat[n + 1, 1] = x, y
            kind[n], primitive[n] = (
                TRANSMISSION if far_view[far_node, 4] else REFLECTION,
                far_view[far_node, 0],
            )
            far_node = far_view[far_node, 1]
            n += 1
    flat[0, 0], flat[0, 1] = tx[0], tx[1]
    flat[n + 1, 0], flat[n + 1, 1] = rx[0], rx[1]
    return n


@compiled
def raise_flat(
    plan: Plan, setting: Setting, tx_z: float, rx_z: float, n: int, bounce: int, scratch: Scratch
) -> int:
    """Give heights to the n interactions of a flat path and fold them at floor and ceiling; new number.

    Args:
        plan: Walls and corners.
        setting: Heights and materials.
        tx_z: Height of the transmitter.
        rx_z: Height of the receiver.
        n: Number of interactions seen from above.
        bounce: Reflections at floor and ceiling; positive if the ceiling comes first, negative for the floor.
        scratch: Has the flat path, gets the path.
    """
    flat, point = scratch.flat, scratch.point
    height = setting.high_m - setting.low_m
    z = tx_z - setting.low_m
    end = rx_z - setting.low_m
    if bounce % 2:
        end = height - end
    end += bounce * height
    total = 0.0
    for j in range(n + 1):
        total += np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
    point[0, 0], point[0, 1], point[0, 2] = flat[0, 0], flat[0, 1], tx_z
    m, done, way = 0, 0, 0.0
    for j in range(n + 1):
        step = np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
        until = (way + step) / total if total > 0 else 1.0
        if j == n:
            until = 1.0
        since = way / total if total > 0 else 0.0
        while done < abs(bounce):
            level = (done + 1) * height if bounce > 0 else -done * height
            at = (level - z) / (end - z)
            if at > until:
                break
            part = min(max((at - since) / (until - since), 0.0), 1.0) if until > since else 0.0
            up = (done % 2 == 0) == (bounce > 0)
            for i in range(2):
                point[m + 1, i] = flat[j, i] + part * (flat[j + 1, i] - flat[j, i])
            point[m + 1, 2] = setting.high_m if up else setting.low_m
            scratch.kind[m], scratch.primitive[m] = REFLECTION, len(setting.walls) - (1 if up else 2)
            scratch.normal[m, 0], scratch.normal[m, 1], scratch.normal[m, 2] = 0.0, 0.0, 1.0
            scratch.walls[m] = setting.walls[scratch.primitive[m]]
            m += 1
            done += 1
        way += step
        if j == n:
            break
        level = z + until * (end - z)
        folds = np.floor(level / height) if bounce != 0 else 0.0
        level -= folds * height
        if folds % 2 != 0:
            level = height - level
        point[m + 1, 0], point[m + 1, 1], point[m + 1, 2] = (
            flat[j + 1, 0],
            flat[j + 1, 1],
            setting.low_m + level,
        )
        scratch.kind[m], scratch.primitive[m] = scratch.flat_kind[j], scratch.flat_primitive[j]
        if scratch.kind[m] != DIFFRACTION:
            wall = scratch.primitive[m]
            scratch.normal[m, 0], scratch.normal[m, 1] = -plan.wall_along[wall, 1], plan.wall_along[wall, 0]
            scratch.normal[m, 2] = 0.0
            scratch.walls[m] = setting.walls[wall]
        m += 1
    point[m + 1, 0], point[m + 1, 1], point[m + 1, 2] = flat[n + 1, 0], flat[n + 1, 1], rx_z
    return m


@compiled
def _most_on_a_side(m: int, scratch: Scratch) -> int:
    """Reflections before the edge of the path in `scratch`, or after it if these are more."""
    before = after = 0
    for j in range(m):
        if scratch.kind[j] == DIFFRACTION:
            before, after = after, 0
        elif scratch.kind[j] == REFLECTION:
            after += 1
    return max(before, after)


@compiled
def weigh_flat(plan: Plan, setting: Setting, corner: int, m: int, scratch: Scratch) -> tuple[float, float]:
    """Length and power of the path in `scratch`, gain set; length -1 if it is none."""
    n = 1.0
    if corner >= 0:
        ax, ay = plan.corner_along[corner, 0], plan.corner_along[corner, 1]
        scratch.wedge[0, 2] = 1.0
        scratch.wedge[1, 0], scratch.wedge[1, 1] = ax, ay
        scratch.wedge[2, 0], scratch.wedge[2, 1] = -ay, ax
        n = plan.corner_gap_rad[corner] / np.pi
        for i in range(2):
            scratch.wedge_walls[i] = setting.walls[plan.corner_walls[corner, i]]
    return weigh(setting, m, n, scratch)


@compiled
def _try_bounces(
    plan: Plan,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "b 2"],
    view: Int[np.ndarray, "b 5"],
    node: int,
    corner: int,
    far_image: Float[np.ndarray, "d 2"],
    far_view: Int[np.ndarray, "d 5"],
    far_node: int,
    scratch: Scratch,
    rank: Float[np.ndarray, "k 5"],
    who: Int[np.ndarray, "k 4"],
    count: int,
) -> int:
    """Enter a flat path into the list, with each allowed number of reflections at floor and ceiling."""
    n = lay_flat(plan, tx, rx, image, view, node, corner, far_image, far_view, far_node, scratch)
    most = setting.max_reflections - view[node, 2]
    if corner >= 0:
        most = setting.edge_reflections - view[node, 2] - far_view[far_node, 2]
    up = min(most, 1 if not setting.has_floor else most) if setting.has_ceiling else 0
    down = min(most, 1 if not setting.has_ceiling else most) if setting.has_floor else 0
    new = np.empty(5)
    for bounce in range(-down, up + 1):
        m = raise_flat(plan, setting, tx[2], rx[2], n, bounce, scratch)
        if m > setting.max_met:
            continue
        if corner >= 0 and bounce != 0 and _most_on_a_side(m, scratch) > setting.side_reflections:
            continue
        length, power = weigh_flat(plan, setting, corner, m, scratch)
        if length < 0 or (count == len(rank) and power <= rank[count - 1, 0]):
            continue
        new[0], new[1] = power, length
        p = scratch.point
        new[2] = np.arctan2(p[1, 1] - p[0, 1], p[1, 0] - p[0, 0])
        new[3] = np.arctan2(p[m, 1] - p[m + 1, 1], p[m, 0] - p[m + 1, 0])
        new[4] = 1000 * m + bounce + (500 if corner >= 0 else 0)
        count, place = enter(rank, who, count, new)
        if place >= 0:
            who[place, 0], who[place, 1], who[place, 2], who[place, 3] = node, corner, far_node, bounce
    return count


@compiled
def corner_sight(plan: Plan, corner: int, x: float, y: float) -> tuple[float, float]:
    """Distance of a point from a corner, and its angle from the first wall."""
    v = plan.corner_vertex[corner]
    dx, dy = x - plan.vertex[v, 0], y - plan.vertex[v, 1]
    ax, ay = plan.corner_along[corner, 0], plan.corner_along[corner, 1]
    angle = np.arctan2(ax * dy - ay * dx, ax * dx + ay * dy)
    return np.hypot(dx, dy), angle if angle >= 0 else angle + 2 * np.pi


@compiled
def by_first(pairs: Int[np.ndarray, "h 2"], n: int) -> tuple[Int[np.ndarray, " n1"], Int[np.ndarray, " h"]]:
    """Second entries sorted by the first ones (in order among equals), and where each begins."""
    start = np.zeros(n + 1, np.int64)
    for i in range(len(pairs)):
        start[pairs[i, 0] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    fill, second = start.copy(), np.empty(len(pairs), np.int64)
    for i in range(len(pairs)):
        second[fill[pairs[i, 0]]] = pairs[i, 1]
        fill[pairs[i, 0]] += 1
    return start, second


@compiled
def trace_links(
    plan: Plan,
    setting: Setting,
    tx: Float[np.ndarray, "3"],
    sight: Sight,
    rx: Float[np.ndarray, "r 3"],
    start: Int[np.ndarray, " r1"],
    start_list: Int[np.ndarray, " s"],
    far: Views,
) -> Table:
    """Strongest paths from one transmitter to many receivers.

    Args:
        plan: Walls, corners and triangles.
        setting: Physics and limits.
        tx: Position of the transmitter, around the plan's origin [m].
        sight: What it sees.
        rx: Positions of receivers.
        start: Where each receiver's triangles begin in start_list, and an end.
        start_list: Triangles around receivers.
        far: Views of the receivers onto corners.
    """
    n_rx, keep, table = len(rx), setting.keep, make_table(setting, len(rx), len(rx))
    image, view = sight.image, sight.chain
    hit_start, hit_view = views_onto(sight, rx[:, :2].copy(), start, start_list)
    near_start, near_view = by_first(sight.corner_hit, len(plan.corner_vertex))
    near_sight = np.empty((len(near_view), 2))
    for c in range(len(plan.corner_vertex)):
        for j in range(near_start[c], near_start[c + 1]):
            away, turn = corner_sight(plan, c, image[near_view[j], 0], image[near_view[j], 1])
            near_sight[j, 0], near_sight[j, 1] = away, turn
    scratch, rank, who = make_scratch(setting), np.empty((keep, 5)), np.empty((keep, 4), np.int64)
    row = 0
    for i in range(n_rx):
        count = 0
        v = far.view_start[i]
        far_image, far_view = far.image[v : far.view_start[i + 1]], far.chain[v : far.view_start[i + 1]]
        for j in range(hit_start[i], hit_start[i + 1]):
            node = hit_view[j]
            if view[node, 2] + view[node, 3] > setting.max_met:
                continue
            if count == keep:
                length = np.hypot(image[node, 0] - rx[i, 0], image[node, 1] - rx[i, 1])
                if (2 * setting.wavenumber * length) ** -2 < rank[count - 1, 0]:
                    continue
            count = _try_bounces(
                plan, setting, tx, rx[i], image, view, node, -1, image, view, 0, scratch, rank, who, count
            )
        for h in range(far.hit_start[i], far.hit_start[i + 1]):
            corner, far_node = far.corner_hit[h, 0], far.corner_hit[h, 1]
            if near_start[corner] == near_start[corner + 1]:
                continue
            after, phi = corner_sight(plan, corner, far_image[far_node, 0], far_image[far_node, 1])
            for j in range(near_start[corner], near_start[corner + 1]):
                node = near_view[j]
                if view[node, 2] + far_view[far_node, 2] > setting.edge_reflections:
                    continue
                through = view[node, 3] + far_view[far_node, 3]
                if through > setting.max_through:
                    continue
                if 1 + view[node, 2] + far_view[far_node, 2] + through > setting.max_met:
                    continue
                before = near_sight[j, 0]
                if before < NOWHERE_M or after < NOWHERE_M:
                    continue
                if count == keep:
                    gap, k = plan.corner_gap_rad[corner], setting.wavenumber
                    if edge_bound(phi, near_sight[j, 1], gap, k, before, after) < rank[count - 1, 0]:
                        continue
                count = _try_bounces(
                    plan,
                    setting,
                    tx,
                    rx[i],
                    image,
                    view,
                    node,
                    corner,
                    far_image,
                    far_view,
                    far_node,
                    scratch,
                    rank,
                    who,
                    count,
                )
        table.found[i] = count
        table = with_room(setting, table, row + count)
        for j in range(count):
            node, corner, far_node, bounce = who[j, 0], who[j, 1], who[j, 2], who[j, 3]
            n = lay_flat(plan, tx, rx[i], image, view, node, corner, far_image, far_view, far_node, scratch)
            m = raise_flat(plan, setting, tx[2], rx[i, 2], n, bounce, scratch)
            length, power = weigh_flat(plan, setting, corner, m, scratch)
            write_row(table, row + j, length, power, m, scratch)
        row += count
    return table
