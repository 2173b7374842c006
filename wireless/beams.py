"""What a point sees of a floor plan, directly and over mirrors: views walked through a triangulation.

A view starts in the triangle around its source and goes on through the sides that are no walls, narrowed to
what is seen through each (triangular expansion). Where it meets a wall, the window that is seen becomes the
view of the mirrored source through that window. So nothing has to be tested for being hidden: what a view
reaches is a path, and whatever it does not reach is none, in each order. There is no sampling, and each
decision errs by rounding only: a target counts as seen if it is out of view by less than `NEAR_M`, so
touching is seeing.

Reference: F. Bungiu et al., Efficient computation of visibility polygons, EuroCG 2014.
"""

import numpy as np
from jaxtyping import Float, Int

from wireless.compiled import compiled
from wireless.plan import Plan

#: Targets out of view by less than this [m] are seen.
NEAR_M = 1e-9
#: Views narrower than this [rad] end: no target fits in.
NARROW_RAD = 1e-13


@compiled
def _longer_ints(a: Int[np.ndarray, "n k"]) -> Int[np.ndarray, "m k"]:
    return np.concatenate((a, np.empty_like(a)))


@compiled
def _longer(a: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "m k"]:
    return np.concatenate((a, np.empty_like(a)))


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


@compiled
def _push(pairs: Int[np.ndarray, "n 2"], n: int, first: int, second: int) -> Int[np.ndarray, "m 2"]:
    """The same array, or a longer copy, with a new row n."""
    if n == len(pairs):
        pairs = _longer_ints(pairs)
    pairs[n, 0], pairs[n, 1] = first, second
    return pairs


@compiled
def _narrowed(
    plan: Plan,
    t: int,
    e: int,
    i: int,
    sight: Float[np.ndarray, "4"],
    x: float,
    y: float,
    out: Float[np.ndarray, "4"],
) -> bool:
    """What a view that came into triangle t by side e sees of side i, into `out`; False for nothing."""
    right, left = plan.vertex[plan.tri_vertex[t, (i + 1) % 3]], plan.vertex[plan.tri_vertex[t, (i + 2) % 3]]
    out[0], out[1], out[2], out[3] = right[0], right[1], left[0], left[1]
    if e >= 0:  # one end of this side is the tip, the other one an end of the side we came by
        tip = plan.vertex[plan.tri_vertex[t, e]]
        _, from_right, from_left = _within(sight, x, y, tip[0], tip[1])
        if i == (e + 1) % 3:  # from the tip to the right
            if from_right <= 0:
                return False
            out[0], out[1] = sight[0], sight[1]
            if from_left < 0:
                out[2], out[3] = sight[2], sight[3]
        else:
            if from_left <= 0:
                return False
            out[2], out[3] = sight[2], sight[3]
            if from_right < 0:
                out[0], out[1] = sight[0], sight[1]
    ax, ay, bx, by = out[0] - x, out[1] - y, out[2] - x, out[3] - y
    wide = ax * by - ay * bx
    return wide > 0 and wide * wide > NARROW_RAD**2 * (ax * ax + ay * ay) * (bx * bx + by * by)


@compiled
def _side_to(plan: Plan, u: int, t: int) -> int:
    """Side of triangle u behind which triangle t lies."""
    side = 0
    while plan.tri_next[u, side] != t:
        side += 1
    return side


@compiled
def _mirrored(plan: Plan, wall: int, x: float, y: float) -> tuple[float, float, float]:
    """A point mirrored at a wall's line, and its distance from there."""
    nx, ny = -plan.wall_along[wall, 1], plan.wall_along[wall, 0]
    off = (x - plan.wall_point[wall, 0]) * nx + (y - plan.wall_point[wall, 1]) * ny
    return x - 2 * off * nx, y - 2 * off * ny, abs(off)


@compiled
def cast(
    plan: Plan,
    start: Int[np.ndarray, "s"],
    source: Float[np.ndarray, "2"],
    target: Float[np.ndarray, "r 2"],
    target_start: Int[np.ndarray, "t1"],
    target_list: Int[np.ndarray, "tr"],
    target_order: int,
    corner_order: int,
    max_through: int,
) -> tuple[Float[np.ndarray, "b 2"], Int[np.ndarray, "b 5"], Int[np.ndarray, "h 2"], Int[np.ndarray, "c 2"]]:
    """All views of one source, with the targets and corners in each.

    Args:
        plan: Walls, corners and triangles.
        start: Triangles around the source.
        source: Position of the source [m].
        target: Positions of targets [m].
        target_start: Where each triangle's targets begin in target_list, and an end.
        target_list: Targets by triangle.
        target_order: Most reflections on the way to a target.
        corner_order: Most reflections on the way to a corner.
        max_through: Most walls to pass on any way.

    Returns:
        image: Mirrored source of each view; the first is the source itself.
        view: Wall that it was mirrored at or passed last, the view before it (-1 for none), its numbers of
            reflections and of walls passed, and 1 if that wall was passed.
        hit: Pairs of target and view.
        corner_hit: Pairs of corner and view.
    """
    image, view = np.empty((64, 2)), np.empty((64, 5), np.int64)
    begin, sector = np.empty((64, 2), np.int64), np.empty((64, 4))
    stack, stack_sector = np.empty((256, 2), np.int64), np.empty((256, 4))
    hit, corner_hit = np.empty((256, 2), np.int64), np.empty((256, 2), np.int64)
    n_views, n_hits, n_corner_hits = 1, 0, 0
    stamp, corner_stamp = np.full(len(target), -1, np.int64), np.full(len(plan.corner_vertex), -1, np.int64)
    sight, seen = np.empty(4), np.empty(4)
    max_order = max(target_order, corner_order)
    image[0], view[0, :2], view[0, 2:] = source, -1, 0
    now = 0
    while now < n_views:
        x, y, order = image[now, 0], image[now, 1], view[now, 2]
        depth = 0
        first = 0  # of the triangles that the source lies in
        if now > 0:
            stack[0], stack_sector[0], depth = begin[now], sector[now], 1
        while depth > 0 or (now == 0 and first < len(start)):
            inside = depth == 0
            if inside:
                t, e = start[first], -1
                first += 1
            else:
                depth -= 1
                t, e = stack[depth]
                sight[:] = stack_sector[depth]
            if order <= target_order:
                for j in range(target_start[t], target_start[t + 1]):
                    p = target_list[j]
                    if stamp[p] != now and (inside or _within(sight, x, y, target[p, 0], target[p, 1])[0]):
                        stamp[p] = now
                        hit = _push(hit, n_hits, p, now)
                        n_hits += 1
            if order <= corner_order:
                for i in range(3):
                    c = plan.tri_corner[t, i]
                    if c < 0 or corner_stamp[c] == now or not (inside or i == e):
                        continue
                    v = plan.vertex[plan.tri_vertex[t, i]]
                    if inside or _within(sight, x, y, v[0], v[1])[0]:
                        corner_stamp[c] = now
                        corner_hit = _push(corner_hit, n_corner_hits, c, now)
                        n_corner_hits += 1
            for i in range(3):
                if i == e or not _narrowed(plan, t, e, i, sight, x, y, seen):
                    continue
                wall, u = plan.tri_wall[t, i], plan.tri_next[t, i]
                if wall < 0:
                    if u >= 0:
                        if depth == len(stack):
                            stack, stack_sector = _longer_ints(stack), _longer(stack_sector)
                        stack[depth, 0], stack[depth, 1] = u, _side_to(plan, u, t)
                        stack_sector[depth] = seen
                        depth += 1
                    continue
                if n_views + 2 > len(image):
                    image, sector = _longer(image), _longer(sector)
                    view, begin = _longer_ints(view), _longer_ints(begin)
                if view[now, 3] < max_through and u >= 0:
                    image[n_views], sector[n_views] = image[now], seen
                    begin[n_views, 0], begin[n_views, 1] = u, _side_to(plan, u, t)
                    view[n_views, 0], view[n_views, 1], view[n_views, 2] = wall, now, order
                    view[n_views, 3], view[n_views, 4] = view[now, 3] + 1, 1
                    n_views += 1
                mx, my, off = _mirrored(plan, wall, x, y)
                if order < max_order and off >= NEAR_M:
                    image[n_views, 0], image[n_views, 1] = mx, my
                    begin[n_views, 0], begin[n_views, 1] = t, i
                    sector[n_views, 0], sector[n_views, 1], _ = _mirrored(plan, wall, seen[2], seen[3])
                    sector[n_views, 2], sector[n_views, 3], _ = _mirrored(plan, wall, seen[0], seen[1])
                    view[n_views, 0], view[n_views, 1], view[n_views, 2] = wall, now, order + 1
                    view[n_views, 3], view[n_views, 4] = view[now, 3], 0
                    n_views += 1
        now += 1
    return image[:n_views], view[:n_views], hit[:n_hits], corner_hit[:n_corner_hits]
