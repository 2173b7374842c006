"""Steps by which views are followed through triangles: what a view passes, what is in it, and which views it begins.

`wireless.geometry.visibility` says what views are. Functions here take few arrays, as handing on all of a plan takes
longer than most of them; lists that they add to have room, which the caller sees to.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.convex import cut_to_left
from wireless.geometry.layers import Layers, Openings
from wireless.geometry.plan import NEAR_M
from wireless.geometry.view_bounds import (
    Bounds,
    Eye,
    cut_behind,
    cut_side,
    cut_to_seen,
    distance2,
    is_within,
    put_sector,
    seen_part,
    seen_slopes,
)
from wireless.geometry.view_lists import EdgeList, Stack, Trail, ViewList, VisitList

#: Views narrower than this [rad] end: no target fits in.
NARROW_RAD = 1e-13


class Limits(NamedTuple):
    """How far a source is followed."""

    target_order: int
    """Most reflections before a target; -1 if only edges are looked for."""
    edge_order: int
    """Most reflections before a corner or rim."""
    max_through: int
    """Most walls to pass."""
    most_visits: int
    """So many visits of triangles without targets are stored too."""
    span_m: Float[np.ndarray, "2 2"]
    """Lowest and highest place of targets, and of corners and rims of interest; for storeys only."""


class TriangleSides(NamedTuple):
    """Triangles, as far as views pass them; see `wireless.geometry.plan.Plan`."""

    vertex: Float[np.ndarray, "v 2"]
    tri_vertex: Int[np.ndarray, "t 3"]
    tri_next: Int[np.ndarray, "t 3"]
    tri_wall: Int[np.ndarray, "t 3"]


class MirrorWalls(NamedTuple):
    """Walls, as far as views are mirrored at them or pass them."""

    point: Float[np.ndarray, "n 2"]
    along: Float[np.ndarray, "n 2"]
    tri_wall: Int[np.ndarray, "t 3"]
    tri_open: Bool[np.ndarray, "t 3"]
    tri_next: Int[np.ndarray, "t 3"]


@compiled
def look_through(eye: Eye, views: ViewList, window: Float[np.ndarray, "w 2"]) -> tuple[float, bool]:
    """Square of how far a view reaches through its window [m2], in its layer and to heights of interest.

    And whether the window bounds the triangle that it opens into: its sides are put into the view's sector.
    """
    if eye.corners == 0:
        return np.inf, False
    far, number = 0.0, eye.number
    for k in range(eye.first, eye.first + eye.corners):
        far = max(far, (window[k, 0] - eye.x) ** 2 + (window[k, 1] - eye.y) ** 2)
    end = min(eye.high_m, eye.span_m[1]) if eye.rise_m > 0 else max(eye.low_m, eye.span_m[0])
    corners = window[eye.first : eye.first + eye.corners]
    aside = views.begin[number, 1] < 0 and put_sector(corners, eye.x, eye.y, views.sector[number])
    return far * (end / eye.rise_m) ** 2 + NEAR_M, aside


@compiled
def eye_of(views: ViewList, view: int, levels_m: tuple[float, float], limits: Limits, height_m: float) -> Eye:
    """The view to follow, in a layer between two heights."""
    order, low_m, high_m = views.chain[view, 2], np.inf, -np.inf
    if order <= limits.target_order:
        low_m, high_m = limits.span_m[0, 0], limits.span_m[0, 1]
    if order <= limits.edge_order:
        low_m, high_m = min(low_m, limits.span_m[1, 0]), max(high_m, limits.span_m[1, 1])
    return Eye(
        views.image[view, 0],
        views.image[view, 1],
        view,
        order,
        views.window_span[view, 0],
        views.window_span[view, 1],
        views.rise_m[view],
        levels_m[0] - height_m,
        levels_m[1] - height_m,
        (low_m - height_m, high_m - height_m),
    )


@compiled
def _side_of(vertex: Float[np.ndarray, "v 2"], tri_vertex: Int[np.ndarray, "t 3"], t: int, i: int) -> Bounds:
    """The side of a triangle opposite to point i."""
    right, left = tri_vertex[t, (i + 1) % 3], tri_vertex[t, (i + 2) % 3]
    return vertex[right, 0], vertex[right, 1], vertex[left, 0], vertex[left, 1]


@compiled
def _is_out_of_reach(x: float, y: float, side: Bounds, reach2: float) -> bool:
    """Whether a view through a window does not reach a side, or does not leave its triangle there."""
    away = (side[0] - x) * (side[3] - y) - (side[1] - y) * (side[2] - x) > 0
    return not away or distance2(x, y, side) > reach2


@compiled
def _is_wide(x: float, y: float, bounds: Bounds) -> bool:
    """Whether anything is in view between two bounds."""
    ax, ay, bx, by = bounds[0] - x, bounds[1] - y, bounds[2] - x, bounds[3] - y
    wide = ax * by - ay * bx
    return wide > 0 and wide * wide > NARROW_RAD**2 * (ax * ax + ay * ay) * (bx * bx + by * by)


@compiled
def _behind(tri_next: Int[np.ndarray, "t 3"], t: int, i: int) -> tuple[int, int]:
    """The triangle behind a side of another, and which of its own sides that is."""
    u, back = tri_next[t, i], 0
    while tri_next[u, back] != t:
        back += 1
    return u, back


@compiled
def follow(
    sides: TriangleSides,
    eye: Eye,
    starts: Int[np.ndarray, " s"],
    enters: int,
    begin: Float[np.ndarray, "4"],
    aside: bool,
    reach2: float,
    trail: Trail,
    room: Stack,
) -> tuple[int, int]:
    """Follow one view through triangles to walls.

    Args:
        sides: Triangles.
        eye: The view.
        starts: Triangles that it begins with.
        enters: The side that it enters by; -1 for all of the triangles.
        begin: Sector in view there.
        aside: Whether that matters where it enters by no side.
        reach2: Square of how far it reaches [m2].
        trail: Takes what it passes.
        room: Takes triangles that are yet to be passed.

    Returns:
        Numbers of steps and of walls met; -1 if the trail has no room for these.
    """
    n, m, depth, first, begins = 0, 0, 0, 0, len(starts) if enters < 0 else 0
    x, y, vertex, tri_vertex = eye.x, eye.y, sides.vertex, sides.tri_vertex
    stack, stack_sector, sector = room.place, room.sector, room.last_sector
    if enters >= 0:
        stack[0, 0], stack[0, 1], depth = starts[0], enters, 1
    for k in range(4):
        sector[k] = stack_sector[0, k] = begin[k]
    while depth > 0 or first < begins:
        if n == len(trail.step) or m + 3 > len(trail.hit) or depth + 3 > len(stack):
            return -1, 0
        if depth == 0:
            t, e = starts[first], -1
            first += 1
        else:
            depth -= 1
            t, e = stack[depth, 0], stack[depth, 1]
            for k in range(4):
                sector[k] = stack_sector[depth, k]
        trail.step[n, 0], trail.step[n, 1] = t, e
        for k in range(4):
            trail.sector[n, k] = sector[k]
        for i in range(3):
            if i == e:
                continue
            if eye.corners > 0 and _is_out_of_reach(x, y, _side_of(vertex, tri_vertex, t, i), reach2):
                continue
            if e >= 0:
                tip = tri_vertex[t, e]
                bounds = cut_behind(x, y, vertex[tip, 0], vertex[tip, 1], i == (e + 1) % 3, sector)
            else:
                bounds = _side_of(vertex, tri_vertex, t, i)
                if aside:
                    bounds = cut_side(x, y, bounds, sector)
            if not _is_wide(x, y, bounds):
                continue
            if sides.tri_wall[t, i] >= 0:
                trail.hit[m, 0], trail.hit[m, 1] = n, i
                for k in range(4):
                    trail.bounds[m, k] = bounds[k]
                m += 1
            elif sides.tri_next[t, i] >= 0:
                stack[depth, 0], stack[depth, 1] = _behind(sides.tri_next, t, i)
                for k in range(4):
                    stack_sector[depth, k] = bounds[k]
                depth += 1
        n += 1
    return n, m


@compiled
def add_visits(
    visits: VisitList,
    count: int,
    trail: Trail,
    steps: int,
    view: int,
    has_target: Bool[np.ndarray, " t"],
    n_max: int,
) -> tuple[int, bool]:
    """Store triangles that a view passes, at most so many without targets; the new number, and whether all are in."""
    visit, sector, last, whole = visits.visit, visits.sector, visits.last, True
    for n in range(steps):
        t = trail.step[n, 0]
        if not has_target[t] and count >= n_max:
            whole = False
            continue
        visit[count, 0], visit[count, 1], visit[count, 2] = view, last[t], trail.step[n, 1] < 0
        for k in range(4):
            sector[count, k] = trail.sector[n, k]
        last[t] = count
        count += 1
    return count, whole


@compiled
def add_corners(
    vertex: Float[np.ndarray, "v 2"],
    tri_vertex: Int[np.ndarray, "t 3"],
    tri_corner: Int[np.ndarray, "t 3"],
    trail: tuple[Int[np.ndarray, "n 2"], Float[np.ndarray, "n 4"], int],
    eye: Eye,
    window: Float[np.ndarray, "w 2"],
    edges: EdgeList,
    count: int,
) -> int:
    """Add the corners that are seen on the trail of a view (its steps, sectors and their number); the new number."""
    stamp, (step, sector, steps) = edges.stamp, trail
    for n in range(steps):
        t, e = step[n, 0], step[n, 1]
        for i in range(3):
            c = tri_corner[t, i]
            if c < 0 or stamp[c] == eye.number or not (e < 0 or i == e):
                continue
            v = tri_vertex[t, i]
            px, py = vertex[v, 0], vertex[v, 1]
            if e >= 0 and not is_within(sector, n, eye.x, eye.y, px, py):
                continue
            low, high = seen_slopes(eye, window, px, py) if len(window) else (-np.inf, np.inf)
            if low <= high:
                stamp[c] = eye.number
                edges.hit[count, 0], edges.hit[count, 1] = c, eye.number
                edges.seen_range[count, 0], edges.seen_range[count, 1] = low, high
                count += 1
    return count


@compiled
def add_rims(
    layers: Layers,
    trail: Trail,
    steps: int,
    eye: Eye,
    window: Float[np.ndarray, "w 2"],
    reach2: float,
    aside: bool,
    edges: EdgeList,
    count: int,
) -> int:
    """Add the rims that are seen on the trail of a view, as far as they are seen; the new number of edges."""
    plan, point, wedge = layers.plan, layers.outline.edge_point, layers.outline.edge_wedge
    for n in range(steps):
        t, e = trail.step[n, 0], trail.step[n, 1]
        for i in range(3):
            if i == e or (layers.tri_rim[t, i, 0] < 0 and layers.tri_rim[t, i, 1] < 0):
                continue
            side, tip = _side_of(plan.vertex, plan.tri_vertex, t, i), plan.vertex[plan.tri_vertex[t, e]]
            if eye.corners > 0 and _is_out_of_reach(eye.x, eye.y, side, reach2):
                continue
            bounds = side
            if e >= 0:
                bounds = cut_behind(eye.x, eye.y, tip[0], tip[1], i == (e + 1) % 3, trail.sector[n])
            elif aside:
                bounds = cut_side(eye.x, eye.y, side, trail.sector[n])
            if not _is_wide(eye.x, eye.y, bounds):
                continue
            for up in range(2):
                edge = layers.tri_rim[t, i, up]
                if edge < 0 or (eye.corners > 0 and (eye.rise_m > 0) != (up == 1)):
                    continue
                low, high = seen_part(eye, window, eye.high_m if up else eye.low_m, side, bounds)
                if low > high:
                    continue
                ex, ey = wedge[edge, 0, 0], wedge[edge, 0, 1]
                base = (side[0] - point[edge, 0]) * ex + (side[1] - point[edge, 1]) * ey
                step = (side[2] - side[0]) * ex + (side[3] - side[1]) * ey
                begin, other = base + low * step, base + high * step
                edges.hit[count, 0], edges.hit[count, 1] = edge, eye.number
                edges.seen_range[count, 0], edges.seen_range[count, 1] = min(begin, other), max(begin, other)
                count += 1
    return count


@compiled
def _pass_openings(
    openings: Openings,
    views: ViewList,
    window: Float[np.ndarray, "w 2"],
    count: tuple[int, int],
    eye: Eye,
    t: int,
    sector: Float[np.ndarray, "4"],
    bounded: bool,
) -> tuple[int, int]:
    """Add the views through openings below and above a triangle; the new numbers of views and of windows' corners."""
    n_views, n_corners = count
    # A window has at most the corners of the pieces that were passed, and two of a sector at each.
    polygon, spare = np.empty((openings.most_corners, 2)), np.empty((openings.most_corners, 2))
    for up in range(2):
        bound_m = eye.high_m if up else eye.low_m
        if eye.corners > 0 and (eye.rise_m > 0) != (up == 1):
            continue
        if bound_m >= eye.span_m[1] if up else bound_m <= eye.span_m[0]:
            continue
        for h in range(openings.start[2 * t + up], openings.start[2 * t + up + 1]):
            n = openings.corners[h]
            polygon[:n] = openings.corner[h, :n]
            if bounded:
                n = cut_to_left(polygon, n, eye.x, eye.y, sector[0], sector[1], spare)
                n = cut_to_left(polygon, n, sector[2], sector[3], eye.x, eye.y, spare)
            n = cut_to_seen(eye, window, bound_m, polygon, n, spare)
            if n == 0:
                continue
            views.image[n_views], views.chain[n_views] = views.image[eye.number], views.chain[eye.number]
            views.begin[n_views, 0], views.begin[n_views, 1] = openings.behind[h], -1
            views.rise_m[n_views], views.window_span[n_views, 0], views.window_span[n_views, 1] = (
                bound_m,
                n_corners,
                n,
            )
            window[n_corners : n_corners + n] = polygon[:n]
            n_views, n_corners = n_views + 1, n_corners + n
    return n_views, n_corners


@compiled
def _mirror(
    walls: MirrorWalls,
    wall: int,
    bounds: Float[np.ndarray, "m 4"],
    h: int,
    views: ViewList,
    window: Float[np.ndarray, "w 2"],
    count: tuple[int, int],
    eye: Eye,
) -> bool:
    """Put the view mirrored at a wall into `views`, its window into `window`; False if the image is on the wall."""
    new, n_corners = count
    nx, ny, now = -walls.along[wall, 1], walls.along[wall, 0], eye.number
    px, py = walls.point[wall, 0], walls.point[wall, 1]
    off = (eye.x - px) * nx + (eye.y - py) * ny
    if abs(off) < NEAR_M:
        return False
    views.image[new, 0], views.image[new, 1] = eye.x - 2 * off * nx, eye.y - 2 * off * ny
    views.chain[new, 0], views.chain[new, 1], views.chain[new, 2] = wall, now, eye.order + 1
    views.chain[new, 3], views.chain[new, 4] = views.chain[now, 3], 0
    for k in range(2):  # the right end becomes the left one
        x, y = bounds[h, 2 - 2 * k], bounds[h, 3 - 2 * k]
        off = (x - px) * nx + (y - py) * ny
        views.sector[new, 2 * k], views.sector[new, 2 * k + 1] = x - 2 * off * nx, y - 2 * off * ny
    views.rise_m[new], views.window_span[new, 0], views.window_span[new, 1] = (
        eye.rise_m,
        n_corners,
        eye.corners,
    )
    for k in range(eye.corners):  # in reverse order, to turn counter-clockwise again
        old = eye.first + eye.corners - 1 - k
        x, y = window[old, 0], window[old, 1]
        off = (x - px) * nx + (y - py) * ny
        window[n_corners + k, 0], window[n_corners + k, 1] = x - 2 * off * nx, y - 2 * off * ny
    return True


@compiled
def add_views(
    walls: MirrorWalls,
    trail: Trail,
    hits: tuple[int, int],
    eye: Eye,
    views: ViewList,
    window: Float[np.ndarray, "w 2"],
    count: tuple[int, int],
    limits: Limits,
) -> tuple[int, int]:
    """Add the views that a view begins at walls, passing and mirrored; new numbers of views and corners."""
    now, mirrors, (n_views, n_corners) = (
        eye.number,
        eye.order < max(limits.target_order, limits.edge_order),
        count,
    )
    passes = views.chain[now, 3] < limits.max_through
    for h in range(hits[0], hits[1]):
        t, i = trail.step[trail.hit[h, 0], 0], trail.hit[h, 1]
        wall = walls.tri_wall[t, i]
        if passes and walls.tri_open[t, i]:
            views.image[n_views, 0], views.image[n_views, 1] = eye.x, eye.y
            views.chain[n_views, 0], views.chain[n_views, 1], views.chain[n_views, 2] = wall, now, eye.order
            views.chain[n_views, 3], views.chain[n_views, 4] = views.chain[now, 3] + 1, 1
            views.begin[n_views, 0], views.begin[n_views, 1] = _behind(walls.tri_next, t, i)
            for k in range(4):
                views.sector[n_views, k] = trail.bounds[h, k]
            views.window_span[n_views, 1] = 0
            n_views += 1
        if mirrors and _mirror(walls, wall, trail.bounds, h, views, window, (n_views, n_corners), eye):
            views.begin[n_views, 0], views.begin[n_views, 1] = t, i
            n_views, n_corners = n_views + 1, n_corners + eye.corners
    return n_views, n_corners


@compiled
def add_layer_views(
    openings: Openings,
    walls: MirrorWalls,
    trail: Trail,
    size: tuple[int, int],
    eye: Eye,
    views: ViewList,
    window: Float[np.ndarray, "w 2"],
    count: tuple[int, int],
    limits: Limits,
) -> tuple[int, int]:
    """`add_views` of all walls met, with those through openings, in the order of the view's steps.

    Numbers of steps and of walls met are given as size.
    """
    h = 0
    for n in range(size[0]):
        t, bounded, first = trail.step[n, 0], trail.step[n, 1] >= 0, h
        if openings.start[2 * t] < openings.start[2 * t + 2]:
            count = _pass_openings(openings, views, window, count, eye, t, trail.sector[n], bounded)
        while h < size[1] and trail.hit[h, 0] == n:
            h += 1
        count = add_views(walls, trail, (first, h), eye, views, window, count, limits)
    return count
