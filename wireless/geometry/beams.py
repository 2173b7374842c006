"""What a point sees of a floor plan, directly and over mirrors: views walked through a triangulation.

A view starts in the triangle around its source and goes on through the sides that are no walls, narrowed to
what is seen through each (triangular expansion). Where it meets a wall, the window that is seen becomes the
view of the mirrored source through that window. So nothing has to be tested for being hidden: what a view
reaches is a path, and whatever it does not reach is none, in each order. There is no sampling, and each
decision errs by rounding only: a target counts as seen if it is out of view by less than `NEAR_M`, so
touching is seeing. Where views pass is kept by triangle (`Sight`), for targets that come later: a transmitter
that stays is walked from once.

Reference: F. Bungiu et al., Efficient computation of visibility polygons, EuroCG 2014.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from wireless.geometry.growing import longer, longer_ints
from wireless.geometry.plan import Plan
from wireless.support.compiled import compiled

#: Targets out of view by less than this [m] are seen.
NEAR_M = 1e-9
#: Views narrower than this [rad] end: no target fits in.
NARROW_RAD = 1e-13


@compiled
def _within(
    sector: Float[np.ndarray, "4"], x: float, y: float, px: float, py: float
) -> tuple[bool, float, float]:
    """Whether a point is in view; cross products with the right and left bound, positive inside."""
    rx, ry, lx, ly = sector[0] - x, sector[1] - y, sector[2] - x, sector[3] - y
    dx, dy = px - x, py - y
    right, left = rx * dy - ry * dx, dx * ly - dy * lx
    seen = right >= -NEAR_M * np.sqrt(rx * rx + ry * ry) and left >= -NEAR_M * np.sqrt(lx * lx + ly * ly)
    return seen, right, left


class Sight(NamedTuple):
    """All views of a source, with the corners in each, and the triangles that they pass."""

    image: Float[np.ndarray, "b 2"]
    """Mirrored source of each view; the first is the source itself."""
    chain: Int[np.ndarray, "b 5"]
    """Of each view the wall that it was mirrored at or passed last, the view before it (-1 for none), its numbers of
    reflections and of walls passed, and 1 if that wall was passed."""
    corner_hit: Int[np.ndarray, "c 2"]
    """Pairs of corner and view."""
    last_visit: Int[np.ndarray, " t"]
    """Of each triangle, the last visit by a view; -1 for none."""
    visit: Int[np.ndarray, "v 3"]
    """View of each visit, the visit of the same triangle before it (-1 for none), and 1 if all of the triangle is in
    view."""
    sector: Float[np.ndarray, "v 4"]
    """Right and left bound of what is in view there."""
    whole: bool
    """Whether all visits are told; otherwise those of the triangles that were asked for."""


@compiled
def cast(
    plan: Plan,
    start: Int[np.ndarray, " s"],
    source: Float[np.ndarray, "2"],
    wanted: Bool[np.ndarray, " t"],
    most_visits: int,
    target_order: int,
    corner_order: int,
    max_through: int,
) -> Sight:
    """All views of one source.

    Args:
        plan: Walls, corners and triangles.
        start: Triangles around the source.
        source: Position of the source [m].
        wanted: Triangles with targets.
        most_visits: So many visits are told of other triangles too.
        target_order: Most reflections on the way to a target; -1 if nothing but corners is asked for.
        corner_order: Most reflections on the way to a corner.
        max_through: Most walls to pass on any way.
    """
    # One long function on arrays of its own: calls that hand the plan on cost five times as much in counting
    # references to its arrays.
    vertex, tri_vertex, tri_next, tri_wall = plan.vertex, plan.tri_vertex, plan.tri_next, plan.tri_wall
    tri_open = plan.tri_open
    tri_corner, wall_point, wall_along = plan.tri_corner, plan.wall_point, plan.wall_along
    image, view = np.empty((64, 2)), np.empty((64, 5), np.int64)
    begin, sector = np.empty((64, 2), np.int64), np.empty((64, 4))
    stack, stack_sector = np.empty((256, 2), np.int64), np.empty((256, 4))
    room = 256 if target_order < 0 else 4096
    visit, visit_sector = np.empty((room, 3), np.int64), np.empty((room, 4))
    last_visit = np.full(len(tri_vertex), -1, np.int64)
    corner_hit, corner_stamp = np.empty((256, 2), np.int64), np.full(len(plan.corner_vertex), -1, np.int64)
    n_views, n_visits, n_corner_hits = 1, 0, 0
    sight, whole = np.zeros(4), True
    max_order = max(target_order, corner_order)
    # Number by number: for rows numba would compile a message for shapes that differ, too.
    image[0, 0], image[0, 1] = source[0], source[1]
    view[0, 0], view[0, 1], view[0, 2], view[0, 3], view[0, 4] = -1, -1, 0, 0, 0
    now = 0
    while now < n_views:
        x, y, order = image[now, 0], image[now, 1], view[now, 2]
        depth = 0
        first = 0  # of the triangles that the source lies in
        if now > 0:
            stack[0, 0], stack[0, 1], depth = begin[now, 0], begin[now, 1], 1
            for k in range(4):
                stack_sector[0, k] = sector[now, k]
        while depth > 0 or (now == 0 and first < len(start)):
            inside = depth == 0
            if inside:
                t, e = start[first], -1
                first += 1
            else:
                depth -= 1
                t, e = stack[depth, 0], stack[depth, 1]
                for k in range(4):
                    sight[k] = stack_sector[depth, k]
            if order <= target_order and not wanted[t] and n_visits >= most_visits:
                whole = False
            elif order <= target_order:
                if n_visits == len(visit):
                    visit, visit_sector = longer_ints(visit), longer(visit_sector)
                visit[n_visits, 0], visit[n_visits, 1], visit[n_visits, 2] = now, last_visit[t], inside
                last_visit[t] = n_visits
                for k in range(4):
                    visit_sector[n_visits, k] = sight[k]
                n_visits += 1
            if order <= corner_order:
                for i in range(3):
                    c = tri_corner[t, i]
                    if c < 0 or corner_stamp[c] == now or not (inside or i == e):
                        continue
                    v = tri_vertex[t, i]
                    if inside or _within(sight, x, y, vertex[v, 0], vertex[v, 1])[0]:
                        corner_stamp[c] = now
                        if n_corner_hits == len(corner_hit):
                            corner_hit = longer_ints(corner_hit)
                        corner_hit[n_corner_hits, 0], corner_hit[n_corner_hits, 1] = c, now
                        n_corner_hits += 1
            for i in range(3):
                if i == e:
                    continue
                right, left = vertex[tri_vertex[t, (i + 1) % 3]], vertex[tri_vertex[t, (i + 2) % 3]]
                rx, ry, lx, ly = right[0], right[1], left[0], left[1]
                if not inside:  # one end of this side is the tip, the other one an end of the side we came by
                    tip = vertex[tri_vertex[t, e]]
                    _, from_right, from_left = _within(sight, x, y, tip[0], tip[1])
                    if i == (e + 1) % 3:  # from the tip to the right
                        if from_right <= 0:
                            continue
                        rx, ry = sight[0], sight[1]
                        if from_left < 0:
                            lx, ly = sight[2], sight[3]
                        else:
                            lx, ly = tip[0], tip[1]
                    else:
                        if from_left <= 0:
                            continue
                        lx, ly = sight[2], sight[3]
                        if from_right < 0:
                            rx, ry = sight[0], sight[1]
                        else:
                            rx, ry = tip[0], tip[1]
                ax, ay, bx, by = rx - x, ry - y, lx - x, ly - y
                wide = ax * by - ay * bx
                if wide <= 0 or wide * wide <= NARROW_RAD**2 * (ax * ax + ay * ay) * (bx * bx + by * by):
                    continue
                w = tri_wall[t, i]
                if w < 0:
                    u = tri_next[t, i]
                    if u < 0:
                        continue
                    if depth == len(stack):
                        stack, stack_sector = longer_ints(stack), longer(stack_sector)
                    back = 0
                    while tri_next[u, back] != t:
                        back += 1
                    stack[depth, 0], stack[depth, 1] = u, back
                    stack_sector[depth, 0], stack_sector[depth, 1] = rx, ry
                    stack_sector[depth, 2], stack_sector[depth, 3] = lx, ly
                    depth += 1
                    continue
                if view[now, 3] < max_through and tri_open[t, i]:
                    if n_views == len(image):
                        image, sector = longer(image), longer(sector)
                        view, begin = longer_ints(view), longer_ints(begin)
                    u, back = tri_next[t, i], 0
                    while tri_next[u, back] != t:
                        back += 1
                    image[n_views, 0], image[n_views, 1] = image[now, 0], image[now, 1]
                    view[n_views, 0], view[n_views, 1], view[n_views, 2] = w, now, view[now, 2]
                    view[n_views, 3], view[n_views, 4] = view[now, 3] + 1, 1
                    begin[n_views, 0], begin[n_views, 1] = u, back
                    sector[n_views, 0], sector[n_views, 1] = rx, ry
                    sector[n_views, 2], sector[n_views, 3] = lx, ly
                    n_views += 1
                if order < max_order:
                    nx, ny = -wall_along[w, 1], wall_along[w, 0]
                    off = (x - wall_point[w, 0]) * nx + (y - wall_point[w, 1]) * ny
                    if abs(off) < NEAR_M:
                        continue
                    if n_views == len(image):
                        image, sector = longer(image), longer(sector)
                        view, begin = longer_ints(view), longer_ints(begin)
                    image[n_views, 0], image[n_views, 1] = x - 2 * off * nx, y - 2 * off * ny
                    view[n_views, 0], view[n_views, 1], view[n_views, 2] = w, now, order + 1
                    view[n_views, 3], view[n_views, 4] = view[now, 3], 0
                    begin[n_views, 0], begin[n_views, 1] = t, i
                    off = (lx - wall_point[w, 0]) * nx + (ly - wall_point[w, 1]) * ny
                    sector[n_views, 0], sector[n_views, 1] = lx - 2 * off * nx, ly - 2 * off * ny
                    off = (rx - wall_point[w, 0]) * nx + (ry - wall_point[w, 1]) * ny
                    sector[n_views, 2], sector[n_views, 3] = rx - 2 * off * nx, ry - 2 * off * ny
                    n_views += 1
        now += 1
    return Sight(
        image[:n_views],
        view[:n_views],
        corner_hit[:n_corner_hits],
        last_visit,
        visit[:n_visits],
        visit_sector[:n_visits],
        whole,
    )


@compiled
def sight_of(
    plan: Plan,
    start: Int[np.ndarray, " s"],
    source: Float[np.ndarray, "2"],
    wanted: Bool[np.ndarray, " t"],
    most_visits: int,
    target_order: int,
    corner_order: int,
    max_through: int,
) -> Sight:
    """`cast` for callers that are not compiled: a way in from Python of its own would compile all of it again."""
    return cast(plan, start, source, wanted, most_visits, target_order, corner_order, max_through)


@compiled
def views_onto(
    sight: Sight,
    target: Float[np.ndarray, "r 2"],
    start: Int[np.ndarray, " r1"],
    start_list: Int[np.ndarray, " s"],
) -> tuple[Int[np.ndarray, " r1"], Int[np.ndarray, " h"]]:
    """Views that targets are in.

    Args:
        sight: What the source sees.
        target: Positions of targets [m].
        start: Where each target's triangles begin in start_list, and an end.
        start_list: Triangles around targets.

    Returns:
        Where each target's views begin, and an end; views by rising number.
    """
    n, image, visit, bound = len(target), sight.image, sight.visit, np.empty(4)
    first, seen, n_seen = np.zeros(n + 1, np.int64), np.empty((64, 1), np.int64), 0
    stamp = np.full(len(image), -1, np.int64)
    for i in range(n):
        for t in start_list[start[i] : start[i + 1]]:
            j = sight.last_visit[t]
            while j >= 0:
                v = visit[j, 0]
                for k in range(4):
                    bound[k] = sight.sector[j, k]
                if stamp[v] != i and (
                    visit[j, 2] or _within(bound, image[v, 0], image[v, 1], target[i, 0], target[i, 1])[0]
                ):
                    stamp[v] = i
                    if n_seen == len(seen):
                        seen = longer_ints(seen)
                    place = n_seen
                    while place > first[i] and seen[place - 1, 0] < v:
                        seen[place, 0] = seen[place - 1, 0]
                        place -= 1
                    seen[place, 0] = v
                    n_seen += 1
                j = visit[j, 1]
        first[i + 1] = n_seen
        for j in range((n_seen - first[i]) // 2):  # visits are told from the last one on
            a, b = first[i] + j, n_seen - 1 - j
            seen[a, 0], seen[b, 0] = seen[b, 0], seen[a, 0]
    return first, seen[:n_seen, 0].copy()
