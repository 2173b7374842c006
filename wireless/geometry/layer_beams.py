"""What a point sees of stacked storeys, directly and over walls: views walked through layers.

Walls stand upright, so that seen from above a view is that of a floor plan (`wireless.geometry.beams`), and heights
along each way change evenly, however often it was mirrored. A view that comes to an opening goes on through it as
what is seen through a convex window at that height: a target is in it if the way from the image meets the window,
whose size at another height is that around the image times the ratio of heights. Each triangle is entered through
its own piece of the opening, and from there walked on from as in a plan, so that nothing has to be tested for being
hidden here either.

Corners are seen in a range of slopes, within which the way lies in their layer and meets the window; level edges are
seen in parts. Left out: reflections at floors and ceilings, walls that are passed.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from wireless.geometry.beams import NARROW_RAD, NEAR_M
from wireless.geometry.convex import apart, area_of, kept_left
from wireless.geometry.growing import longer, longer_ints
from wireless.geometry.layers import Layers
from wireless.support.compiled import compiled

#: Windows of less area are none [m2].
_NOTHING_M2 = 1e-16


class Seen(NamedTuple):
    """Views of a point, and what is in each."""

    image: Float[np.ndarray, "b 2"]
    """Mirrored source of each view; the first is the source itself."""
    chain: Int[np.ndarray, "b 5"]
    """As view of `wireless.geometry.beams.cast`; a view through an opening repeats that before it."""
    hit: Int[np.ndarray, "h 2"]
    """Pairs of target and view."""
    corner_hit: Int[np.ndarray, "c 2"]
    """Pairs of corner and view."""
    corner_slope: Float[np.ndarray, "c 2"]
    """Least and most height gained on each metre of the way from above, for which the corner is seen."""
    rim_hit: Int[np.ndarray, "e 2"]
    """Pairs of rim and view."""
    rim_part: Float[np.ndarray, "e 2"]
    """From where to where along the rim it is seen [m]."""


@compiled
def _within(sector: Float[np.ndarray, "4"], x: float, y: float, px: float, py: float) -> bool:
    """Whether a point is in a sector of a view."""
    rx, ry, lx, ly = sector[0] - x, sector[1] - y, sector[2] - x, sector[3] - y
    dx, dy = px - x, py - y
    right, left = rx * dy - ry * dx, dx * ly - dy * lx
    return right >= -NEAR_M * np.sqrt(rx * rx + ry * ry) and left >= -NEAR_M * np.sqrt(lx * lx + ly * ly)


@compiled
def _meets(window: Float[np.ndarray, "w 2"], first: int, count: int, px: float, py: float) -> bool:
    """Whether a point is in a convex window."""
    for k in range(count):
        a, b = window[first + k], window[first + (k + 1) % count]
        dx, dy = b[0] - a[0], b[1] - a[1]
        if dx * (py - a[1]) - dy * (px - a[0]) < -NEAR_M * np.sqrt(dx * dx + dy * dy):
            return False
    return True


@compiled
def _chord(
    window: Float[np.ndarray, "w 2"], first: int, count: int, x: float, y: float, ux: float, uy: float
) -> tuple[float, float]:
    """From where to where a ray is in a convex window; from more to less if it is nowhere."""
    low, high = 0.0, np.inf
    for k in range(count):
        a, b = window[first + k], window[first + (k + 1) % count]
        dx, dy = b[0] - a[0], b[1] - a[1]
        size = np.sqrt(dx * dx + dy * dy)
        inside = (dx * (y - a[1]) - dy * (x - a[0])) / size + NEAR_M if size > 0 else 1.0
        gain = (dx * uy - dy * ux) / size if size > 0 else 0.0
        if gain > 0:
            low = max(low, -inside / gain)
        elif gain < 0:
            high = min(high, -inside / gain)
        elif inside < 0:
            return 1.0, 0.0
    return low, high


@compiled
def _distance2(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance of a point from a segment."""
    dx, dy, px, py = bx - ax, by - ay, x - ax, y - ay
    f = min(max((px * dx + py * dy) / (dx * dx + dy * dy), 0.0), 1.0)
    return (px - f * dx) ** 2 + (py - f * dy) ** 2


@compiled
def cast_layers(
    layers: Layers,
    start: Int[np.ndarray, " s"],
    source: Float[np.ndarray, "3"],
    target: Float[np.ndarray, "r 3"],
    target_start: Int[np.ndarray, " t1"],
    target_list: Int[np.ndarray, " tr"],
    target_order: int,
    edge_order: int,
    span_m: Float[np.ndarray, "2 2"],
) -> Seen:
    """All views of one source, with the targets, corners and rims in each.

    Args:
        layers: Walls, corners, triangles and openings of all layers.
        start: Triangles around the source, all of one layer.
        source: Position of the source [m].
        target: Positions of targets [m].
        target_start: Where each triangle's targets begin in target_list, and an end.
        target_list: Targets by triangle.
        target_order: Most reflections on the way to a target.
        edge_order: Most reflections on the way to a corner or rim.
        span_m: Lowest and highest place of targets, and of corners and rims of interest.
    """
    # One long function on arrays of its own, as `wireless.geometry.beams.cast` is.
    plan, level = layers.plan, layers.level_m
    vertex, tri_vertex, tri_next, tri_wall = plan.vertex, plan.tri_vertex, plan.tri_next, plan.tri_wall
    tri_corner, wall_point, wall_along = plan.tri_corner, plan.wall_point, plan.wall_along
    tri_layer, tri_rim, rim, rim_wedge = layers.tri_layer, layers.tri_rim, layers.rim, layers.rim_wedge
    piece_start, piece_next, piece = layers.piece_start, layers.piece_next, layers.piece
    piece_corners = layers.piece_corners
    # A window has at most the corners of the pieces that were passed, and two of a sector at each.
    room = (piece.shape[1] + 2) * len(level)
    polygon, spare = np.empty((room, 2)), np.empty((room, 2))
    image, view = np.empty((64, 2)), np.empty((64, 5), np.int64)
    begin, sector = np.empty((64, 2), np.int64), np.empty((64, 4))
    # Height of each view's window, if it has one, and where its corners begin, and their number.
    at, part = np.empty((64, 1)), np.zeros((64, 2), np.int64)
    window, n_window = np.empty((256, 2)), 0
    stack, stack_sector = np.empty((256, 2), np.int64), np.empty((256, 4))
    hit, corner_hit, rim_hit = (
        np.empty((256, 2), np.int64),
        np.empty((256, 2), np.int64),
        np.empty((64, 2), np.int64),
    )
    slope, rim_part = np.empty((256, 2)), np.empty((64, 2))
    n_views, n_hits, n_corner_hits, n_rim_hits = 1, 0, 0, 0
    stamp, corner_stamp = np.full(len(target), -1, np.int64), np.full(len(plan.corner_vertex), -1, np.int64)
    sight = np.empty(4)
    max_order = max(target_order, edge_order)
    height = source[2]
    image[0, 0], image[0, 1], view[0, :2], view[0, 2:] = source[0], source[1], -1, 0
    now = 0
    while now < n_views:
        x, y, order = image[now, 0], image[now, 1], view[now, 2]
        first_corner, n_corners, rise = part[now, 0], part[now, 1], at[now, 0] - height
        layer = tri_layer[start[0] if now == 0 else begin[now, 0]]
        low_m, high_m = np.inf, -np.inf
        if order <= target_order:
            low_m, high_m = span_m[0]
        if order <= edge_order:
            low_m, high_m = min(low_m, span_m[1, 0]), max(high_m, span_m[1, 1])
        up, down = n_corners == 0 or rise > 0, n_corners == 0 or rise < 0
        # How far a view through a window reaches; and the window's sides, if the image is not over it.
        reach, aside = np.inf, False
        wide_right, wide_left = np.zeros(2), np.zeros(2)
        if n_corners > 0:
            end = min(level[layer + 1], high_m) if rise > 0 else max(level[layer], low_m)
            far = 0.0
            for k in range(first_corner, first_corner + n_corners):
                far = max(far, (window[k, 0] - x) ** 2 + (window[k, 1] - y) ** 2)
            reach = far * ((end - height) / rise) ** 2 + NEAR_M
            for k in range(n_corners):
                p, q = window[first_corner + k], window[first_corner + (k + 1) % n_corners]
                aside = aside or (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) < 0
            if aside:
                wide_right[:], wide_left[:] = window[first_corner], window[first_corner]
                for k in range(first_corner + 1, first_corner + n_corners):
                    px, py = window[k, 0] - x, window[k, 1] - y
                    if (wide_right[0] - x) * py - (wide_right[1] - y) * px < 0:
                        wide_right[:] = window[k]
                    if (wide_left[0] - x) * py - (wide_left[1] - y) * px > 0:
                        wide_left[:] = window[k]
        depth = 0
        first = 0  # of the triangles that the source lies in
        fresh = now > 0 and begin[now, 1] < 0  # just through an opening
        if now > 0 and not fresh:
            stack[0], stack_sector[0], depth = begin[now], sector[now], 1
        while depth > 0 or fresh or (now == 0 and first < len(start)):
            inside = depth == 0
            if inside:
                t, e = begin[now, 0] if fresh else start[first], -1
                first, fresh = first + 1, False
            else:
                depth -= 1
                t, e = stack[depth]
                sight[:] = stack_sector[depth]
            if order <= target_order:
                for j in range(target_start[t], target_start[t + 1]):
                    p = target_list[j]
                    if stamp[p] == now or not (inside or _within(sight, x, y, target[p, 0], target[p, 1])):
                        continue
                    if n_corners > 0:
                        climb = target[p, 2] - height
                        if climb * rise <= 0:
                            continue
                        f = rise / climb
                        px, py = x + f * (target[p, 0] - x), y + f * (target[p, 1] - y)
                        if not _meets(window, first_corner, n_corners, px, py):
                            continue
                    stamp[p] = now
                    if n_hits == len(hit):
                        hit = longer_ints(hit)
                    hit[n_hits, 0], hit[n_hits, 1] = p, now
                    n_hits += 1
            if order <= edge_order:
                for i in range(3):
                    c = tri_corner[t, i]
                    if c < 0 or corner_stamp[c] == now or not (inside or i == e):
                        continue
                    v = tri_vertex[t, i]
                    if not (inside or _within(sight, x, y, vertex[v, 0], vertex[v, 1])):
                        continue
                    ux, uy = vertex[v, 0] - x, vertex[v, 1] - y
                    length = np.sqrt(ux * ux + uy * uy)
                    if length < NEAR_M:
                        continue
                    least, most = (level[layer] - height) / length, (level[layer + 1] - height) / length
                    if n_corners > 0:
                        from_m, to_m = _chord(window, first_corner, n_corners, x, y, ux / length, uy / length)
                        if to_m < from_m or to_m <= 0:
                            continue
                        one, other = rise / to_m, rise / from_m if from_m > 0 else np.inf * rise
                        least, most = max(least, min(one, other)), min(most, max(one, other))
                    if (most - least) * length < NEAR_M:  # at best where its layer ends
                        continue
                    corner_stamp[c] = now
                    if n_corner_hits == len(corner_hit):
                        corner_hit, slope = longer_ints(corner_hit), longer(slope)
                    corner_hit[n_corner_hits, 0], corner_hit[n_corner_hits, 1] = c, now
                    slope[n_corner_hits, 0], slope[n_corner_hits, 1] = least, most
                    n_corner_hits += 1
            for side in range(2):
                bound = level[layer + side]
                if not (up and bound < high_m if side == 1 else down and bound > low_m):
                    continue
                grown = (bound - height) / rise if n_corners > 0 else 1.0
                for h in range(piece_start[2 * t + side], piece_start[2 * t + side + 1]):
                    n = piece_corners[h]
                    polygon[:n] = piece[h, :n]
                    if not inside:
                        n = kept_left(polygon, n, x, y, sight[0], sight[1], spare)
                        n = kept_left(polygon, n, sight[2], sight[3], x, y, spare)
                    for k in range(n_corners):
                        if n == 0:
                            break
                        p, q = window[first_corner + k], window[first_corner + (k + 1) % n_corners]
                        n = kept_left(
                            polygon,
                            n,
                            x + grown * (p[0] - x),
                            y + grown * (p[1] - y),
                            x + grown * (q[0] - x),
                            y + grown * (q[1] - y),
                            spare,
                        )
                    n = apart(polygon, n)
                    if n == 0 or area_of(polygon, n) < _NOTHING_M2:
                        continue
                    if n_views == len(image):
                        image, sector, at = longer(image), longer(sector), longer(at)
                        view, begin, part = longer_ints(view), longer_ints(begin), longer_ints(part)
                    while n_window + n > len(window):
                        window = longer(window)
                    image[n_views], view[n_views] = image[now], view[now]
                    begin[n_views, 0], begin[n_views, 1] = piece_next[h], -1
                    at[n_views, 0], part[n_views, 0], part[n_views, 1] = bound, n_window, n
                    window[n_window : n_window + n] = polygon[:n]
                    n_window += n
                    n_views += 1
            for i in range(3):
                if i == e:
                    continue
                right, left = vertex[tri_vertex[t, (i + 1) % 3]], vertex[tri_vertex[t, (i + 2) % 3]]
                rx, ry, lx, ly = right[0], right[1], left[0], left[1]
                if (rx - x) * (ly - y) - (ry - y) * (lx - x) <= 0:
                    continue
                if reach < np.inf and _distance2(x, y, rx, ry, lx, ly) > reach:
                    continue
                from_x, from_y, to_x, to_y = rx, ry, lx, ly
                if not inside:
                    if (rx - x) * (sight[1] - y) - (ry - y) * (sight[0] - x) > 0:
                        rx, ry = sight[0], sight[1]
                    if (lx - x) * (sight[3] - y) - (ly - y) * (sight[2] - x) < 0:
                        lx, ly = sight[2], sight[3]
                elif aside:
                    if (rx - x) * (wide_right[1] - y) - (ry - y) * (wide_right[0] - x) > 0:
                        rx, ry = wide_right[0], wide_right[1]
                    if (lx - x) * (wide_left[1] - y) - (ly - y) * (wide_left[0] - x) < 0:
                        lx, ly = wide_left[0], wide_left[1]
                ax, ay, bx, by = rx - x, ry - y, lx - x, ly - y
                wide = ax * by - ay * bx
                if wide <= 0 or wide * wide <= NARROW_RAD**2 * (ax * ax + ay * ay) * (bx * bx + by * by):
                    continue
                for side in range(2):
                    edge = tri_rim[t, i, side]
                    if edge < 0 or order > edge_order or not (up if side == 1 else down):
                        continue
                    # Of the side from 0 to 1, what is in the sector and behind the window.
                    low, high = 0.0, 1.0
                    dx, dy = to_x - from_x, to_y - from_y
                    for k in range(n_corners + 2):
                        if k < n_corners:
                            grown = (level[layer + side] - height) / rise
                            p, q = window[first_corner + k], window[first_corner + (k + 1) % n_corners]
                            px, py = x + grown * (p[0] - x), y + grown * (p[1] - y)
                            wx, wy = grown * (q[0] - p[0]), grown * (q[1] - p[1])
                        elif k == n_corners:
                            px, py, wx, wy = x, y, ax, ay
                        else:
                            px, py, wx, wy = x, y, -bx, -by
                        size = np.sqrt(wx * wx + wy * wy)
                        if size == 0:
                            continue
                        deep = (wx * (from_y - py) - wy * (from_x - px)) / size + NEAR_M
                        gain = (wx * dy - wy * dx) / size
                        if gain > 0:
                            low = max(low, -deep / gain)
                        elif gain < 0:
                            high = min(high, -deep / gain)
                        elif deep < 0:
                            high = -1.0
                    if low > high:
                        continue
                    if n_rim_hits == len(rim_hit):
                        rim_hit, rim_part = longer_ints(rim_hit), longer(rim_part)
                    ex, ey = rim_wedge[edge, 0, 0], rim_wedge[edge, 0, 1]
                    base = (from_x - rim[edge, 0, 0]) * ex + (from_y - rim[edge, 0, 1]) * ey
                    step = dx * ex + dy * ey
                    rim_hit[n_rim_hits, 0], rim_hit[n_rim_hits, 1] = edge, now
                    one, other = base + low * step, base + high * step
                    rim_part[n_rim_hits, 0], rim_part[n_rim_hits, 1] = min(one, other), max(one, other)
                    n_rim_hits += 1
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
                if order < max_order:
                    nx, ny = -wall_along[w, 1], wall_along[w, 0]
                    off = (x - wall_point[w, 0]) * nx + (y - wall_point[w, 1]) * ny
                    if abs(off) < NEAR_M:
                        continue
                    if n_views == len(image):
                        image, sector, at = longer(image), longer(sector), longer(at)
                        view, begin, part = longer_ints(view), longer_ints(begin), longer_ints(part)
                    while n_window + n_corners > len(window):
                        window = longer(window)
                    image[n_views, 0], image[n_views, 1] = x - 2 * off * nx, y - 2 * off * ny
                    view[n_views, 0], view[n_views, 1], view[n_views, 2] = w, now, order + 1
                    view[n_views, 3], view[n_views, 4] = 0, 0
                    begin[n_views, 0], begin[n_views, 1] = t, i
                    off = (lx - wall_point[w, 0]) * nx + (ly - wall_point[w, 1]) * ny
                    sector[n_views, 0], sector[n_views, 1] = lx - 2 * off * nx, ly - 2 * off * ny
                    off = (rx - wall_point[w, 0]) * nx + (ry - wall_point[w, 1]) * ny
                    sector[n_views, 2], sector[n_views, 3] = rx - 2 * off * nx, ry - 2 * off * ny
                    at[n_views], part[n_views, 0], part[n_views, 1] = at[now], n_window, n_corners
                    for k in range(n_corners):  # the other way round, to turn counter-clockwise again
                        p = window[first_corner + n_corners - 1 - k]
                        off = (p[0] - wall_point[w, 0]) * nx + (p[1] - wall_point[w, 1]) * ny
                        window[n_window + k, 0], window[n_window + k, 1] = (
                            p[0] - 2 * off * nx,
                            p[1] - 2 * off * ny,
                        )
                    n_window += n_corners
                    n_views += 1
        now += 1
    return Seen(
        image[:n_views],
        view[:n_views],
        hit[:n_hits],
        corner_hit[:n_corner_hits],
        slope[:n_corner_hits],
        rim_hit[:n_rim_hits],
        rim_part[:n_rim_hits],
    )
