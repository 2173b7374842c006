"""Occlusion of the line of sight between two points by triangles, in double precision: a box tree per segment.

A triangle hides what lies strictly on both sides of its plane, if the segment between meets it or passes within
the tree's `near_m` of it. So segments may start, end and turn on triangles, or run in their planes, whatever the
length, and cracks below `near_m` are closed. Triangles of one surface are treated as lying in the plane fitted to all
of them (`wireless.geometry.tolerance`), so that none hides what ends on another. Single-precision ray engines need an
offset for this, which loses short segments and leaks far from the origin.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Point, Points, Triangles
from wireless.geometry.boxes import make_boxes
from wireless.geometry.tolerance import NEAR_M

#: Results of `sight`.
FREE, TOUCHED, HIDDEN = 0, 1, 2
#: Walls that are passed closer to each other than this [m] are one.
SAME_M = 1e-6
#: Inverse of the extent of a segment along an axis that it is at right angles to.
_STEEP = 1e300


class Tree(NamedTuple):
    """Boxes of triangles, each with two boxes inside or a few triangles."""

    low: Float[np.ndarray, "b 3"]
    """Lowest corner of each box [m]."""
    high: Float[np.ndarray, "b 3"]
    """Highest corner of each box [m]."""
    child: Int[np.ndarray, "b 2"]
    """Two boxes; or -1 minus the first triangle, and the number of triangles."""
    number: Int[np.ndarray, " t"]
    """Number of each triangle before it was sorted into the tree."""
    triangle: Float[np.ndarray, "t 3 3"]
    """Corners of triangles, in the tree's order [m]."""
    normal: Float[np.ndarray, "t 3"]
    """Unit normals."""
    level: Float[np.ndarray, " t"]
    """Where each plane is along its normal [m]."""
    inward: Float[np.ndarray, "t 3 3"]
    """Unit vectors in the plane, into the triangle from each side (corner k to k + 1)."""
    near_m: float
    """Tolerance [m]: a segment that passes a triangle by less is occluded; a point nearer to its plane is on it."""


def inward_of(triangle: Triangles, normal: Float[np.ndarray, "t 3"]) -> Triangles:
    """Unit vectors in the plane of each normal, into each triangle from its three sides."""
    side = np.roll(triangle, -1, axis=1) - triangle
    inward = np.cross(normal[:, None], side)
    turn = np.where(np.einsum("ij,ij->i", inward[:, 0], side[:, 1]) < 0, -1.0, 1.0)
    # None: a sliver's side at right angles to the plane, which bounds nothing.
    length = np.linalg.norm(inward, axis=2)
    return inward * (turn[:, None] / np.where(length > 0, length, 1))[..., None]


def make_tree(
    triangle: Triangles, plane: Float[np.ndarray, "t 4"] | None = None, near_m: float = NEAR_M
) -> Tree:
    """Sort triangles into boxes, each in its `plane`, or its own if None; `near_m` is the tolerance of contact."""
    if plane is None:
        normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
        normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        plane = np.column_stack([normal, np.einsum("ij,ij->i", normal, triangle[:, 0])])
    boxes = make_boxes(triangle.min(axis=1) - near_m * 4, triangle.max(axis=1) + near_m * 4)
    triangle, plane = triangle[boxes.number], plane[boxes.number]
    normal = plane[:, :3].copy()
    return Tree(
        low=boxes.low,
        high=boxes.high,
        child=boxes.child,
        number=boxes.number,
        triangle=triangle,
        normal=normal,
        level=plane[:, 3].copy(),
        inward=inward_of(triangle, normal),
        near_m=near_m,
    )


@compiled
def leaf_around(
    tree: Tree, p: Point, slack_m: float, stack: Int[np.ndarray, " k"], depth: int
) -> tuple[int, int, int]:
    """Next leaf that holds a point: first triangle, end, and depth of the remaining stack, -1 without a leaf."""
    while depth > 0:
        depth -= 1
        box = stack[depth]
        inside = True
        for i in range(3):
            inside = inside and tree.low[box, i] - slack_m <= p[i] <= tree.high[box, i] + slack_m
        if inside:
            left, other = tree.child[box, 0], tree.child[box, 1]
            if left < 0:
                return -1 - left, -1 - left + other, depth
            stack[depth], stack[depth + 1] = left, other
            depth += 2
    return 0, 0, -1


@compiled
def depth_in(triangle: Triangles, inward: Triangles, t: int, x: float, y: float, z: float) -> float:
    """How deep a point of triangle t's plane lies in it, from its nearest side [m]; negative outside."""
    least = np.inf
    for k in range(3):
        into = (
            inward[t, k, 0] * (x - triangle[t, k, 0])
            + inward[t, k, 1] * (y - triangle[t, k, 1])
            + inward[t, k, 2] * (z - triangle[t, k, 2])
        )
        least = min(least, into)
    return least


@compiled
def _inverse(step: float) -> float:
    """Return the inverse of a step; a segment in a plane of a box is either between its sides or far out of it."""
    return 1 / step if step != 0 else _STEEP


@compiled
def _meets_box(
    low: Float[np.ndarray, "b 3"],
    high: Float[np.ndarray, "b 3"],
    box: int,
    start: tuple[float, float, float],
    inverse: tuple[float, float, float],
) -> bool:
    """Whether a segment meets a box, from its start and one over its steps along each axis."""
    enter, leave = 0.0, 1.0
    for k in range(3):
        a, b = (low[box, k] - start[k]) * inverse[k], (high[box, k] - start[k]) * inverse[k]
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter <= leave + 1e-12


@compiled
def _met(tree: Tree, point: Points, legs: int, deep_m: float) -> tuple[int, bool]:
    """A triangle that the path over points meets so deep, in the tree's order, or -1; and whether any was met."""
    low, high, child, near_m = tree.low, tree.high, tree.child, tree.near_m
    normal, level, triangle, inward = tree.normal, tree.level, tree.triangle, tree.inward
    stack, touched = np.empty(64, np.int64), False
    for leg in range(legs - 1, -1, -1):  # what a transmitter sees is known better than what a receiver does
        px, py, pz = point[leg, 0], point[leg, 1], point[leg, 2]
        qx, qy, qz = point[leg + 1, 0], point[leg + 1, 1], point[leg + 1, 2]
        dx, dy, dz = qx - px, qy - py, qz - pz
        start, inverse = (px, py, pz), (_inverse(dx), _inverse(dy), _inverse(dz))
        stack[0], depth = 0, 1
        while depth > 0:
            depth -= 1
            box = stack[depth]
            if not _meets_box(low, high, box, start, inverse):
                continue
            left, other = child[box, 0], child[box, 1]
            if left >= 0:
                stack[depth], stack[depth + 1] = left, other
                depth += 2
                continue
            for t in range(-1 - left, -1 - left + other):
                dp = normal[t, 0] * px + normal[t, 1] * py + normal[t, 2] * pz - level[t]
                dq = normal[t, 0] * qx + normal[t, 1] * qy + normal[t, 2] * qz - level[t]
                if abs(dp) < near_m or abs(dq) < near_m or (dp > 0) == (dq > 0):
                    continue
                f = dp / (dp - dq)
                least = depth_in(triangle, inward, t, px + f * dx, py + f * dy, pz + f * dz)
                if least >= deep_m:
                    return t, True
                touched = touched or least >= -near_m
    return -1, touched


@compiled
def find_blocker(tree: Tree, p: Point, q: Point) -> int:
    """A triangle between p and q, in the tree's order; -1 if there is none."""
    ends = np.empty((2, 3))
    for i in range(3):
        ends[0, i], ends[1, i] = p[i], q[i]
    return _met(tree, ends, 1, -tree.near_m)[0]


@compiled
def find_cover(tree: Tree, point: Points, leg: int) -> int:
    """A triangle that hides a leg of a path, in the tree's order, other than by a side of it; -1 if there is none."""
    return _met(tree, point[leg : leg + 2], 1, tree.near_m)[0]


@compiled
def covers(
    tree: Tree, t: int, p: tuple[float, float, float], q: tuple[float, float, float], m: float
) -> bool:
    """Whether triangle t, in the tree's order, hides p from q also if these and the triangle are m off [m]."""
    normal, level = tree.normal, tree.level
    dp = normal[t, 0] * p[0] + normal[t, 1] * p[1] + normal[t, 2] * p[2] - level[t]
    dq = normal[t, 0] * q[0] + normal[t, 1] * q[1] + normal[t, 2] * q[2] - level[t]
    if abs(dp) < m or abs(dq) < m or (dp > 0) == (dq > 0):
        return False
    f = dp / (dp - dq)
    x, y, z = p[0] + f * (q[0] - p[0]), p[1] + f * (q[1] - p[1]), p[2] + f * (q[2] - p[2])
    return depth_in(tree.triangle, tree.inward, t, x, y, z) >= m


@compiled
def sight_along(tree: Tree, point: Points, legs: int) -> int:
    """Line of sight along legs: `HIDDEN` if a leg is, `TOUCHED` if a leg only meets sides, or `FREE`."""
    t, touched = _met(tree, point, legs, tree.near_m)
    return HIDDEN if t >= 0 else TOUCHED if touched else FREE


@compiled
def sight(tree: Tree, p: Point, q: Point) -> int:
    """`FREE` if no triangle is between p and q, `TOUCHED` if the segment only meets sides of some, or `HIDDEN`."""
    ends = np.empty((2, 3))
    for i in range(3):
        ends[0, i], ends[1, i] = p[i], q[i]
    return sight_along(tree, ends, 1)


@compiled
def crosses(tree: Tree, p: Point, at: Point, q: Point) -> bool:
    """Whether a path from p to q changes sides of a triangle that it turns on."""
    normal, near_m, stack = tree.normal, tree.near_m, np.zeros(64, np.int64)
    first, last, depth = leaf_around(tree, at, near_m, stack, 1)
    while depth >= 0:
        for t in range(first, last):
            off, dp, dq = -tree.level[t], -tree.level[t], -tree.level[t]
            for i in range(3):
                off += normal[t, i] * at[i]
                dp += normal[t, i] * p[i]
                dq += normal[t, i] * q[i]
            if abs(off) >= near_m or abs(dp) < near_m or abs(dq) < near_m or (dp > 0) == (dq > 0):
                continue
            if depth_in(tree.triangle, tree.inward, t, at[0], at[1], at[2]) >= -near_m:
                return True
        first, last, depth = leaf_around(tree, at, near_m, stack, depth)
    return False


@compiled
def is_hidden(tree: Tree, p: Point, q: Point) -> bool:
    """Whether any triangle is between p and q."""
    return find_blocker(tree, p, q) >= 0


@compiled
def walls_between(
    tree: Tree,
    p: Point,
    q: Point,
    passes: Bool[np.ndarray, " t"],
    max_walls: int,
    share: Float[np.ndarray, " k"],
    which: Int[np.ndarray, " k"],
) -> int:
    """Walls between p and q in order: shares of the segment and triangles.

    Triangles that are met in one point, at a side that they share or doubled, are one wall.

    Returns:
        Number of walls; -1 if they are too many, or one lets nothing through.
    """
    low, high, child, near_m = tree.low, tree.high, tree.child, tree.near_m
    normal, level, triangle, inward = tree.normal, tree.level, tree.triangle, tree.inward
    px, py, pz = p[0], p[1], p[2]
    qx, qy, qz = q[0], q[1], q[2]
    dx, dy, dz = qx - px, qy - py, qz - pz
    start, inverse = (px, py, pz), (_inverse(dx), _inverse(dy), _inverse(dz))
    length, stack = np.sqrt(dx * dx + dy * dy + dz * dz), np.empty(64, np.int64)
    stack[0], depth, count, same_m = 0, 1, 0, SAME_M + 4 * near_m
    while depth > 0:
        depth -= 1
        box = stack[depth]
        if not _meets_box(low, high, box, start, inverse):
            continue
        left, other = child[box, 0], child[box, 1]
        if left >= 0:
            stack[depth], stack[depth + 1] = left, other
            depth += 2
            continue
        for t in range(-1 - left, -1 - left + other):
            dp = normal[t, 0] * px + normal[t, 1] * py + normal[t, 2] * pz - level[t]
            dq = normal[t, 0] * qx + normal[t, 1] * qy + normal[t, 2] * qz - level[t]
            if abs(dp) < near_m or abs(dq) < near_m or (dp > 0) == (dq > 0):
                continue
            f = dp / (dp - dq)
            if depth_in(triangle, inward, t, px + f * dx, py + f * dy, pz + f * dz) < -near_m:
                continue
            if not passes[t]:
                return -1
            place, known = count, False
            for j in range(count):
                known = known or abs(share[j] - f) * length < same_m
            if known:
                continue
            if count == max_walls:
                return -1
            while place > 0 and share[place - 1] > f:
                share[place], which[place] = share[place - 1], which[place - 1]
                place -= 1
            share[place], which[place] = f, t
            count += 1
    return count
