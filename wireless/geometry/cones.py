"""View cones of an image through its window in space: their clipping, and their occlusion by walls.

An image looks through a convex piece of the facet that it was mirrored at, its window. What it may reach is
the cone behind that window: sides through the image and each side of the window. Polygons are clipped to the
cone; the part of one that a wall hides is cut off, piece by piece, until a piece is found that is seen or
none is left.

This only saves work: everything not certainly out of view counts as in view, and paths are checked
leg by leg later. So cones are wider by `SLACK_M`, sides that rounding could turn are left out, and a
polygon that needs too many cuts is seen.

Reference: P. S. Heckbert and P. Hanrahan, Beam tracing polygonal objects, SIGGRAPH 1984.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Planes, Point, Polygon
from wireless.geometry.boxes import Boxes
from wireless.geometry.occlusion import Tree, find_blocker

#: Most corners of a polygon; a polygon that would get more stays unchanged.
MAX_CORNERS = 24
#: How much wider cones are [m].
SLACK_M = 1e-7
#: Sides of windows that are shorter, or whose line is nearer to the image, bound nothing [m].
_FIRM_M = 1e-4
#: Most pieces that wait, and most rays sent, before a polygon counts as seen.
PIECES, _RAYS = 16, 12


class Walls(NamedTuple):
    """Convex pieces of facets, each of which hides as one."""

    of_triangle: Int[np.ndarray, " t"]
    """Wall of each triangle, in the order of the tree that they are sorted into."""
    corner: Float[np.ndarray, "w k 3"]
    """Corners of each [m]; zeros beyond the last."""
    corners: Int[np.ndarray, " w"]
    """Number of corners of each."""


@compiled
def clip(polygon: Polygon, n: int, normal: Point, level: float, out: Polygon) -> int:
    """The part of a convex polygon (or of a segment) where normal . x >= level.

    Returns its number of corners, in `out`; 0 if there is none; -1 if it has more than `out` has room for.
    """
    m = 0
    before = -1.0
    for j in range(n + 1 if n > 2 else n):
        k = j % n
        depth = -level
        for i in range(3):
            depth += normal[i] * polygon[k, i]
        if j > 0 and (depth >= 0) != (before >= 0):
            if m == len(out):
                return -1
            f = before / (before - depth)
            for i in range(3):
                out[m, i] = polygon[j - 1, i] + f * (polygon[k, i] - polygon[j - 1, i])
            m += 1
        if depth >= 0 and j < n:
            if m == len(out):
                return -1
            for i in range(3):
                out[m, i] = polygon[k, i]
            m += 1
        before = depth
    return m if m >= min(n, 3) else 0


@compiled
def side_planes(apex: Point, window: Polygon, n: int, plane: Planes) -> int:
    """Unit normals into the cone and levels of the planes through an apex and sides of a window; their number.

    Sides that rounding could turn are left out.
    """
    centre, normal, m = np.zeros(3), np.empty(3), 0
    for k in range(n):
        for i in range(3):
            centre[i] += window[k, i] / n
    for k in range(n):
        j = (k + 1) % n
        length, size, depth = 0.0, 0.0, 0.0
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            normal[i] = (window[k, a] - apex[a]) * (window[j, b] - apex[b]) - (window[k, b] - apex[b]) * (
                window[j, a] - apex[a]
            )
            size += normal[i] ** 2
            length += (window[j, i] - window[k, i]) ** 2
            depth += normal[i] * (centre[i] - apex[i])
        size = np.sqrt(size)
        if length < _FIRM_M**2 or size < _FIRM_M * np.sqrt(length):
            continue
        if depth < 0:
            size = -size
        plane[m, 3] = 0.0
        for i in range(3):
            plane[m, i] = normal[i] / size
            plane[m, 3] += plane[m, i] * apex[i]
        m += 1
    return m


@compiled
def things_within(boxes: Boxes, plane: Planes, n: int, things: Int[np.ndarray, " m"]) -> int:
    """Things whose boxes reach the inner side of each plane, up to `SLACK_M`; their number."""
    stack, count = np.empty(64, np.int64), 0
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        box = stack[depth]
        out = False
        for k in range(n):
            bound = SLACK_M - plane[k, 3]
            for i in range(3):
                bound += plane[k, i] * (boxes.high[box, i] if plane[k, i] > 0 else boxes.low[box, i])
            if bound < 0:
                out = True
                break
        if out:
            continue
        left, other = boxes.child[box]
        if left >= 0:
            stack[depth], stack[depth + 1] = left, other
            depth += 2
            continue
        for t in range(-1 - left, -1 - left + other):
            things[count] = boxes.number[t]
            count += 1
    return count


@compiled
def clip_to_planes(
    polygon: Polygon,
    n: int,
    plane: Planes,
    n_planes: int,
    clipped: Float[np.ndarray, "m 3"],
    other: Float[np.ndarray, "m 3"],
) -> int:
    """The part of a polygon within planes, up to `SLACK_M`, in `clipped`; its number of corners, 0 if none."""
    _copy(polygon, n, clipped)
    for k in range(n_planes):
        inside = True
        for j in range(n):
            depth = SLACK_M - plane[k, 3]
            for i in range(3):
                depth += plane[k, i] * clipped[j, i]
            inside = inside and depth >= 0
        if inside:
            continue
        m = clip(clipped, n, plane[k, :3], plane[k, 3] - SLACK_M, other)
        if m == 0:
            return 0
        if m > 0:  # else there is no room: wider is fine
            _copy(other, m, clipped)
            n = m
    return n


@compiled
def _cut(
    apex: Point,
    wall: Polygon,
    n_wall: int,
    plane: Planes,
    piece: Float[np.ndarray, "s m 3"],
    corners: Int[np.ndarray, " s"],
    count: int,
    spare: Float[np.ndarray, "m 3"],
    near_m: float,
) -> int:
    """Replace the last piece by its parts that a convex wall does not hide; new count, -1 if it is unclear."""
    if side_planes(apex, wall, n_wall, plane) < n_wall:
        return -1
    normal, size, off, level = np.empty(3), 0.0, 0.0, 0.0
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        normal[i] = (wall[1, a] - wall[0, a]) * (wall[2, b] - wall[0, b]) - (wall[1, b] - wall[0, b]) * (
            wall[2, a] - wall[0, a]
        )
        size += normal[i] ** 2
    size = np.sqrt(size)
    if size < _FIRM_M**2:
        return -1
    for i in range(3):
        normal[i] /= size
        off += normal[i] * (apex[i] - wall[0, i])
    if abs(off) < _FIRM_M:
        return -1
    if off < 0:
        normal *= -1.0
    for i in range(3):
        level += normal[i] * wall[0, i]
    current, away, back, level_away = count - 1, np.empty(3), np.empty(3), 0.0
    for k in range(n_wall + 1):
        if k < n_wall:  # outside of one side: a wall hides what passes it by less than near_m
            into, j = 0.0, (k + 1) % n_wall
            sx, sy, sz = wall[j, 0] - wall[k, 0], wall[j, 1] - wall[k, 1], wall[j, 2] - wall[k, 2]
            into = (
                plane[k, 0] * (normal[1] * sz - normal[2] * sy)
                + plane[k, 1] * (normal[2] * sx - normal[0] * sz)
                + plane[k, 2] * (normal[0] * sy - normal[1] * sx)
            )
            into = abs(into) / np.sqrt(sx * sx + sy * sy + sz * sz)
            for i in range(3):
                away[i], back[i] = -plane[k, i], plane[k, i]
            level_away = -plane[k, 3] + 0.5 * near_m * into
        else:  # before the wall
            for i in range(3):
                away[i], back[i] = normal[i], -normal[i]
            level_away = level - 10 * near_m
        m = clip(piece[current], corners[current], away, level_away, spare)
        if m == 0:
            continue
        if m < 0 or count == len(piece):
            return -1
        _copy(spare, m, piece[count])
        corners[count] = m
        count += 1
        m = clip(piece[current], corners[current], back, -level_away, spare)
        if m < 0:
            return -1
        if m == 0:
            break
        _copy(spare, m, piece[current])
        corners[current] = m
    for j in range(current, count - 1):
        _copy(piece[j + 1], corners[j + 1], piece[j])
        corners[j] = corners[j + 1]
    return count - 1


@compiled
def _copy(polygon: Polygon, n: int, to: Float[np.ndarray, "m 3"]) -> None:
    """Copy n corners; number by number, which for so few takes a tenth of what slices take."""
    for j in range(n):
        for i in range(3):
            to[j, i] = polygon[j, i]


@compiled
def may_see(
    tree: Tree,
    walls: Walls,
    apex: Point,
    behind: Float[np.ndarray, "4"],
    polygon: Float[np.ndarray, "m 3"],
    n: int,
    piece: Float[np.ndarray, "s m 3"],
) -> bool:
    """Whether an image may see some of a polygon (or of a segment); if unclear, True."""
    corners, plane = np.empty(len(piece), np.int64), np.empty((MAX_CORNERS, 4))
    spare, near, middle = np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3)), np.empty(3)
    start = apex.copy()
    _copy(polygon, n, piece[0])
    corners[0], count = n, 1
    for _ in range(_RAYS):
        current = count - 1
        middle[:] = 0.0
        for k in range(corners[current]):
            for i in range(3):
                middle[i] += piece[current, k, i] / corners[current]
        if behind[0] != 0 or behind[1] != 0 or behind[2] != 0:
            a, b = -behind[3], -behind[3]
            for i in range(3):
                a += behind[i] * apex[i]
                b += behind[i] * middle[i]
            if b - a < tree.near_m:
                return True
            for i in range(3):
                start[i] = apex[i] - a / (b - a) * (middle[i] - apex[i])
        t = find_blocker(tree, start, middle)
        if t < 0:
            return True
        w = walls.of_triangle[t]
        m = clip(walls.corner[w], walls.corners[w], behind[:3], behind[3], near)
        if m < 3:
            return True
        count = _cut(apex, near, m, plane, piece, corners, count, spare, tree.near_m)
        if count < 0:
            return True
        if count == 0:
            return False
    return True
