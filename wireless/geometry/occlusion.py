"""Whether two points see each other past triangles, in double precision: a box tree walked per segment.

A triangle hides what lies strictly on both sides of its plane, if the way between meets it or passes within
the tree's `near_m` of it. So ways may start, end and turn on triangles, or run in their planes, whatever the length,
and cracks below `near_m` are shut. Triangles of one surface are looked at in the plane fitted to all of them
(`wireless.geometry.tolerance`), so that none hides what ends on another. Single-precision ray engines need an offset
for this, which is what loses short ways and leaks far from the origin.

Embree answers 6 to 7 times as many segments per second (8 against 1.2 million a core), and is wrong on 1 in 4000
to 6000 with ends moved by 0.1 mm, on 1 in 7 without, and on 1 in 7 in either case 10 km from the origin; the
tree is on none (`tests/benchmarks`). Sight takes 1 to 18 % of the time of tracing in space, so that a
faster engine in front of it would save no more; views of floor plans decide 60 million pairs without asking.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from wireless.geometry.boxes import make_boxes
from wireless.geometry.tolerance import NEAR_M
from wireless.support.compiled import compiled

#: What `sight` tells.
FREE, TOUCHED, HIDDEN = 0, 1, 2
#: Walls that are passed closer to each other than this [m] are one.
SAME_M = 1e-6
#: One over the part of a way along an axis that it is at right angles to.
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
    """What number each triangle had before it was sorted into the tree."""
    triangle: Float[np.ndarray, "t 3 3"]
    """Corners of triangles, in the tree's order [m]."""
    normal: Float[np.ndarray, "t 3"]
    """Unit normals."""
    level: Float[np.ndarray, " t"]
    """Where each plane is along its normal [m]."""
    inward: Float[np.ndarray, "t 3 3"]
    """Unit vectors in the plane, into the triangle from each side (corner k to k + 1)."""
    near_m: float
    """What passes a triangle by less than this [m] is hidden by it; what is nearer to its plane is on it."""


def inward_of(
    triangle: Float[np.ndarray, "t 3 3"], normal: Float[np.ndarray, "t 3"]
) -> Float[np.ndarray, "t 3 3"]:
    """Unit vectors in the plane of each normal, into each triangle from its three sides."""
    side = np.roll(triangle, -1, axis=1) - triangle
    inward = np.cross(normal[:, None], side)
    turn = np.where(np.einsum("ij,ij->i", inward[:, 0], side[:, 1]) < 0, -1.0, 1.0)
    length = np.linalg.norm(
        inward, axis=2
    )  # none: a sliver's side at right angles to the plane, which bounds nothing
    return inward * (turn[:, None] / np.where(length > 0, length, 1))[..., None]


def make_tree(
    triangle: Float[np.ndarray, "t 3 3"],
    plane: Float[np.ndarray, "t 4"] | None = None,
    near_m: float = NEAR_M,
) -> Tree:
    """Sort triangles into boxes.

    Args:
        triangle: Corners [m].
        plane: Unit normal and level of the plane that each is taken to lie in; None for its own.
        near_m: What is closer than this touches.
    """
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
def box_holds(tree: Tree, box: int, p: Float[np.ndarray, "3"], slack_m: float) -> bool:
    """Whether a point lies in a box of the tree, or outside of it by at most so much."""
    inside = True
    for i in range(3):
        inside = inside and tree.low[box, i] - slack_m <= p[i] <= tree.high[box, i] + slack_m
    return inside


@compiled
def _met(tree: Tree, point: Float[np.ndarray, "n 3"], legs: int, deep_m: float) -> tuple[int, bool]:
    """A triangle that the way over points meets so deep, in the tree's order, or -1; and whether any was met.

    Written out number by number, and for all legs at once, as most of the time of tracing in space is spent here,
    and to hand a tree on takes as long as a look.
    """
    low, high, child, near_m = tree.low, tree.high, tree.child, tree.near_m
    normal, level, triangle, inward = tree.normal, tree.level, tree.triangle, tree.inward
    stack, touched = np.empty(64, np.int64), False
    for leg in range(legs - 1, -1, -1):  # what a transmitter sees is known better than what a receiver does
        px, py, pz = point[leg, 0], point[leg, 1], point[leg, 2]
        qx, qy, qz = point[leg + 1, 0], point[leg + 1, 1], point[leg + 1, 2]
        dx, dy, dz = qx - px, qy - py, qz - pz
        # A way in a plane of a box is either between its sides or far out of it.
        ix = 1 / dx if dx != 0 else _STEEP
        iy = 1 / dy if dy != 0 else _STEEP
        iz = 1 / dz if dz != 0 else _STEEP
        stack[0], depth = 0, 1
        while depth > 0:
            depth -= 1
            box = stack[depth]
            a, b = (low[box, 0] - px) * ix, (high[box, 0] - px) * ix
            enter, leave = max(0.0, min(a, b)), min(1.0, max(a, b))
            a, b = (low[box, 1] - py) * iy, (high[box, 1] - py) * iy
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            a, b = (low[box, 2] - pz) * iz, (high[box, 2] - pz) * iz
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            if enter > leave + 1e-12:
                continue
            one, other = child[box, 0], child[box, 1]
            if one >= 0:
                stack[depth], stack[depth + 1] = one, other
                depth += 2
                continue
            for t in range(-1 - one, -1 - one + other):
                dp = normal[t, 0] * px + normal[t, 1] * py + normal[t, 2] * pz - level[t]
                dq = normal[t, 0] * qx + normal[t, 1] * qy + normal[t, 2] * qz - level[t]
                if abs(dp) < near_m or abs(dq) < near_m or (dp > 0) == (dq > 0):
                    continue
                f, least = dp / (dp - dq), np.inf
                x, y, z = px + f * dx, py + f * dy, pz + f * dz
                for k in range(3):
                    into = (
                        inward[t, k, 0] * (x - triangle[t, k, 0])
                        + inward[t, k, 1] * (y - triangle[t, k, 1])
                        + inward[t, k, 2] * (z - triangle[t, k, 2])
                    )
                    least = min(least, into)
                if least >= deep_m:
                    return t, True
                touched = touched or least >= -near_m
    return -1, touched


@compiled
def blocker(tree: Tree, p: Float[np.ndarray, "3"], q: Float[np.ndarray, "3"]) -> int:
    """A triangle between p and q, in the tree's order; -1 if there is none."""
    ends = np.empty((2, 3))
    for i in range(3):
        ends[0, i], ends[1, i] = p[i], q[i]
    return _met(tree, ends, 1, -tree.near_m)[0]


@compiled
def sight_along(tree: Tree, point: Float[np.ndarray, "n 3"], legs: int) -> int:
    """What so many legs from point to point are: `HIDDEN` if one is, `TOUCHED` if one only meets sides, or `FREE`."""
    t, touched = _met(tree, point, legs, tree.near_m)
    return HIDDEN if t >= 0 else TOUCHED if touched else FREE


@compiled
def sight(tree: Tree, p: Float[np.ndarray, "3"], q: Float[np.ndarray, "3"]) -> int:
    """`FREE` if no triangle is between p and q, `TOUCHED` if the way only meets sides of some, or `HIDDEN`."""
    ends = np.empty((2, 3))
    for i in range(3):
        ends[0, i], ends[1, i] = p[i], q[i]
    return sight_along(tree, ends, 1)


@compiled
def crosses(
    tree: Tree, p: Float[np.ndarray, "3"], at: Float[np.ndarray, "3"], q: Float[np.ndarray, "3"]
) -> bool:
    """Whether a way from p to q changes sides of a triangle that it turns on."""
    low, high, child, near_m = tree.low, tree.high, tree.child, tree.near_m
    normal, level, triangle, inward = tree.normal, tree.level, tree.triangle, tree.inward
    x, y, z = at[0], at[1], at[2]
    stack = np.empty(64, np.int64)
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        box = stack[depth]
        if (
            x < low[box, 0] - near_m
            or x > high[box, 0] + near_m
            or y < low[box, 1] - near_m
            or y > high[box, 1] + near_m
            or z < low[box, 2] - near_m
            or z > high[box, 2] + near_m
        ):
            continue
        one, other = child[box, 0], child[box, 1]
        if one >= 0:
            stack[depth], stack[depth + 1] = one, other
            depth += 2
            continue
        for t in range(-1 - one, -1 - one + other):
            off, dp, dq, least = -level[t], -level[t], -level[t], np.inf
            for i in range(3):
                off += normal[t, i] * at[i]
                dp += normal[t, i] * p[i]
                dq += normal[t, i] * q[i]
            if abs(off) >= near_m or abs(dp) < near_m or abs(dq) < near_m or (dp > 0) == (dq > 0):
                continue
            for k in range(3):
                into = 0.0
                for i in range(3):
                    into += inward[t, k, i] * (at[i] - triangle[t, k, i])
                least = min(least, into)
            if least >= -near_m:
                return True
    return False


@compiled
def hidden(tree: Tree, p: Float[np.ndarray, "3"], q: Float[np.ndarray, "3"]) -> bool:
    """Whether any triangle is between p and q."""
    return blocker(tree, p, q) >= 0


@compiled
def holds(
    triangle: Float[np.ndarray, "t 3 3"],
    inward: Float[np.ndarray, "t 3 3"],
    p: Float[np.ndarray, "3"],
    near_m: float,
) -> bool:
    """Whether a point of a plane lies in one of the plane's triangles; sides count."""
    for t in range(len(triangle)):
        inside = True
        for k in range(3):
            depth = 0.0
            for i in range(3):
                depth += inward[t, k, i] * (p[i] - triangle[t, k, i])
            inside = inside and depth >= -near_m
        if inside:
            return True
    return False


@compiled
def passed(
    tree: Tree,
    p: Float[np.ndarray, "3"],
    q: Float[np.ndarray, "3"],
    passes: Bool[np.ndarray, " t"],
    most: int,
    where: Float[np.ndarray, " k"],
    which: Int[np.ndarray, " k"],
) -> int:
    """Walls between p and q in order: shares of the way and triangles.

    Triangles that are met in one point, at a side that they share or doubled, are one wall.

    Args:
        tree: What there is between.
        p: Where the way begins [m].
        q: Where it ends.
        passes: Triangles that let it through, in the tree's order.
        most: Most walls that are passed.
        where: Room for the shares.
        which: Room for the triangles, in the tree's order.

    Returns:
        Number of walls; -1 if they are too many, or one lets nothing through.
    """
    low, high, child, near_m = tree.low, tree.high, tree.child, tree.near_m
    normal, level, triangle, inward = tree.normal, tree.level, tree.triangle, tree.inward
    px, py, pz = p[0], p[1], p[2]
    qx, qy, qz = q[0], q[1], q[2]
    dx, dy, dz = qx - px, qy - py, qz - pz
    ix = 1 / dx if dx != 0 else _STEEP
    iy = 1 / dy if dy != 0 else _STEEP
    iz = 1 / dz if dz != 0 else _STEEP
    length, stack = np.sqrt(dx * dx + dy * dy + dz * dz), np.empty(64, np.int64)
    stack[0], depth, count, same_m = 0, 1, 0, SAME_M + 4 * near_m
    while depth > 0:
        depth -= 1
        box = stack[depth]
        a, b = (low[box, 0] - px) * ix, (high[box, 0] - px) * ix
        enter, leave = max(0.0, min(a, b)), min(1.0, max(a, b))
        a, b = (low[box, 1] - py) * iy, (high[box, 1] - py) * iy
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        a, b = (low[box, 2] - pz) * iz, (high[box, 2] - pz) * iz
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        if enter > leave + 1e-12:
            continue
        one, other = child[box, 0], child[box, 1]
        if one >= 0:
            stack[depth], stack[depth + 1] = one, other
            depth += 2
            continue
        for t in range(-1 - one, -1 - one + other):
            dp = normal[t, 0] * px + normal[t, 1] * py + normal[t, 2] * pz - level[t]
            dq = normal[t, 0] * qx + normal[t, 1] * qy + normal[t, 2] * qz - level[t]
            if abs(dp) < near_m or abs(dq) < near_m or (dp > 0) == (dq > 0):
                continue
            f, least = dp / (dp - dq), np.inf
            x, y, z = px + f * dx, py + f * dy, pz + f * dz
            for k in range(3):
                into = (
                    inward[t, k, 0] * (x - triangle[t, k, 0])
                    + inward[t, k, 1] * (y - triangle[t, k, 1])
                    + inward[t, k, 2] * (z - triangle[t, k, 2])
                )
                least = min(least, into)
            if least < -near_m:
                continue
            if not passes[t]:
                return -1
            place, known = count, False
            for j in range(count):
                known = known or abs(where[j] - f) * length < same_m
            if known:
                continue
            if count == most:
                return -1
            while place > 0 and where[place - 1] > f:
                where[place], which[place] = where[place - 1], which[place - 1]
                place -= 1
            where[place], which[place] = f, t
            count += 1
    return count


@compiled
def hidden_each(
    tree: Tree, p: Float[np.ndarray, "n 3"], q: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether any triangle is between each p and its q."""
    result = np.empty(len(p), np.bool_)
    for i in range(len(p)):
        result[i] = hidden(tree, p[i], q[i])
    return result
