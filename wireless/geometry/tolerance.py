"""Coplanar surfaces: the tolerance of a mesh, and the planes and lines that its triangles lie in.

Files round coordinates, mostly to 32 bits, so the triangles of one flat wall are not quite in one plane. Here is the
only place that decides what is flat: `tolerance_of` estimates how far rounding moves corners, and triangles whose
corners all lie within that of one plane are one surface. Its plane is fitted to all of them, each weighted by its
area, and how far its corners are off the plane is known (`Fits.off_m`). Exact meshes have planes that are exact to
rounding in double precision, whatever the tolerance; decisions about paths (sight, reflection points, edges)
uses `NEAR_M` plus the deviation that was found, and not the tolerance.

Groups grow from the largest triangle outwards, and are fitted again with each ring: a small triangle says nothing of
a plane far away. Only corners count, so that slivers, whose normals are arbitrary, join the plane that they lie in.
Sides of triangles are grouped into lines likewise.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Point, Points, Polygon
from wireless.geometry.boxes import Boxes, make_boxes

#: Corners of triangles or segments [m].
Shapes = Float[np.ndarray, "n k 3"]
#: A number for each of them.
Numbers = Int[np.ndarray, " n"]
#: Their areas or lengths.
Sizes = Float[np.ndarray, " n"]


#: Resolution of double precision in a building [m]: tolerance of a mesh that is exact.
NEAR_M = 1e-9
#: Tolerance in steps of coordinates: rounding moves corners by up to 0.87, and planes of small triangles by more.
_STEPS = 4
#: Coarsest and finest step [m] that coordinates are looked at for, as powers of two: 32-bit numbers up to 32 km.
_COARSEST, _FINEST = -9, -22
#: A mesh this many times farther from zero than it is long was moved there; its numbers had their steps before.
_FAR = 100.0
#: Steps of 32-bit numbers above this move walls visibly, and merge surfaces that are apart [m].
_MOST_STEP_M = 0.003
#: A triangle farther off a group, in lengths of it, is another group, since its plane is uncertain there. A single
#: triangle looks one length around.
_REACH = 10.0


class Fits(NamedTuple):
    """Planes or lines, each fitted to a group of triangles or of sides."""

    group: Int[np.ndarray, " n"]
    """Group of each triangle or side; -1 for what has no size."""
    point: Float[np.ndarray, "g 3"]
    """A point of each plane or line [m]."""
    axis: Float[np.ndarray, "g 3"]
    """Unit normal of each plane, or unit vector along each line."""
    off_m: Float[np.ndarray, " g"]
    """How far the corner that deviates most is off it [m]."""


def tolerance_of(vertex: Float[np.ndarray, "v 3"], snap_m: float) -> float:
    """How far corners of one flat surface may be off its plane [m].

    That is four steps of 32-bit numbers as large as the coordinates; at least `snap_m`; and more if all coordinates
    lie on a coarser lattice, as those of a mesh do that was rounded far from zero and then moved back (up to 2 mm,
    32-bit numbers at 32 km). Only a mesh that was rounded far away, moved and then turned needs a larger `snap_m`.
    """
    span, reach = float(np.ptp(vertex, axis=0).max()), float(np.abs(vertex).max())
    step = float(np.spacing(np.float32(reach if reach <= _FAR * span else span)))
    for x in (vertex - vertex[0]).T:
        for power in range(_COARSEST + 1, _FINEST, -1):
            if np.abs(x / 2.0**power - np.rint(x / 2.0**power)).max() < 1e-3:
                if power <= _COARSEST:  # whole centimetres and the like are designed, not rounded
                    step = max(step, 2.0**power)
                break
    return max(snap_m, _STEPS * step)


def check_rounding(vertex: Float[np.ndarray, "*n 3"], unit_m: float = 1.0) -> None:
    """Raise ValueError for a mesh whose corners were rounded to coarse 32-bit numbers, as it lies far from zero.

    An axis was rounded if all its coordinates are 32-bit numbers, and some of them odd multiples of the spacing of
    these numbers there: 3 cm or 6 cm at an easting of UTM, 50 cm at a northing. Whole metres are even multiples.
    """
    farthest = np.abs(vertex.reshape(-1, 3)).max(axis=0)
    for axis in np.argsort(-farthest):
        x, reach = vertex[..., axis], float(farthest[axis])
        step = float(np.spacing(np.float32(reach)))
        if step * unit_m <= _MOST_STEP_M or reach < 2 * np.ptp(x) or (x.astype(np.float32) != x).any():
            continue
        if (np.rint(x / step) % 2 == 1).any():
            raise ValueError(
                f"{'xyz'[axis]} is rounded to {step * unit_m:.2g} m, the spacing of 32-bit numbers at "
                f"{reach * unit_m:.9g} m; move the mesh near zero before it is saved, or save it with 64 bits, as OBJ"
            )


def fit_planes(triangle: Float[np.ndarray, "n 3 3"], tolerance_m: float) -> Fits:
    """Planes of triangles, largest first; triangles without area belong to none."""
    cross = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    return _fits(triangle, cross, tolerance_m)


def fit_lines(ends: Float[np.ndarray, "n 2 3"], tolerance_m: float) -> Fits:
    """Lines of segments, longest first; segments without length belong to none."""
    return _fits(ends, ends[:, 1] - ends[:, 0], tolerance_m)


def exact_m(vertex: Float[np.ndarray, "*n 3"]) -> float:
    """Return the rounding of double precision at the size of coordinates, but at least `NEAR_M` [m]."""
    return float(NEAR_M + 4 * np.spacing(np.abs(vertex).max()))


def _fits(corner: Shapes, axis: Points, tolerance_m: float) -> Fits:
    size = np.linalg.norm(axis, axis=1)
    real = np.flatnonzero(size > 0)
    corner, axis, order = corner[real], axis[real] / size[real, None], np.argsort(-size[real], kind="stable")
    boxes = make_boxes(corner.min(axis=1), corner.max(axis=1))
    group = np.full(len(size), -1)
    group[real], point, axis, off = _grow(corner, axis, size[real], order, boxes, tolerance_m)
    return Fits(group, point, axis, off)


@compiled
def _distance(corner: Polygon, point: Point, axis: Point) -> float:
    """How far the farthest of three corners is off a plane, or of two off a line [m]."""
    farthest = 0.0
    for k in range(len(corner)):
        along, size = 0.0, 0.0
        for i in range(3):
            along += axis[i] * (corner[k, i] - point[i])
        if len(corner) == 3:
            farthest = max(farthest, abs(along))
            continue
        for i in range(3):
            size += (corner[k, i] - point[i] - along * axis[i]) ** 2
        farthest = max(farthest, np.sqrt(size))
    return farthest


@compiled
def _fit(corner: Shapes, size: Sizes, members: Int[np.ndarray, " m"], axis: Point) -> tuple[Point, Point]:
    """Point and axis of the plane or line fitted to members, close to an axis that is close already."""
    # Least squares over areas or lengths: the product of two linear functions integrates over a simplex of k corners to
    # (sum of f g + sum of f times sum of g) / (k (k + 1)). What the axis is off by is small, so it is found exactly.
    k, total = corner.shape[1], 0.0
    centre, first = np.zeros(3), corner[members[0], 0]
    for m in members:
        total += size[m]
        for i in range(3):
            for c in range(k):
                centre[i] += size[m] * (corner[m, c, i] - first[i]) / k
    centre = first + centre / total
    least = np.argmin(np.abs(axis))
    across = np.zeros(3)
    across[(least + 1) % 3], across[(least + 2) % 3] = -axis[(least + 2) % 3], axis[(least + 1) % 3]
    across /= np.sqrt((across**2).sum())
    frame = np.stack((across, np.cross(axis, across), axis))
    product, place, sums = np.zeros((3, 3)), np.empty((k, 3)), np.empty(3)
    for m in members:
        for a in range(3):
            sums[a] = 0.0
            for c in range(k):
                place[c, a] = 0.0
                for i in range(3):
                    place[c, a] += frame[a, i] * (corner[m, c, i] - centre[i])
                sums[a] += place[c, a]
        for a in range(3):
            for b in range(3):
                inner = sums[a] * sums[b]
                for c in range(k):
                    inner += place[c, a] * place[c, b]
                product[a, b] += size[m] * inner
    if k == 2:
        turn = product[2] / product[2, 2]
    else:
        det = product[0, 0] * product[1, 1] - product[0, 1] ** 2
        if det <= 1e-14 * (product[0, 0] + product[1, 1]) ** 2:  # a line: no plane is better than that
            return centre, axis
        turn = np.zeros(3)
        turn[0] = -(product[1, 1] * product[0, 2] - product[0, 1] * product[1, 2]) / det
        turn[1] = -(product[0, 0] * product[1, 2] - product[0, 1] * product[0, 2]) / det
    turned = axis + turn[0] * frame[0] + turn[1] * frame[1]
    return centre, turned / np.sqrt((turned**2).sum())


@compiled
def _collect(
    corner: Shapes,
    boxes: Boxes,
    state: Numbers,
    me: int,
    around: tuple[Point, Point],
    fit: tuple[Point, Point],
    near_m: float,
    members: Numbers,
    count: int,
) -> int:
    """Append what lies in a plane or on a line, is in part within a box, and is neither grouped nor rejected."""
    (low, high), (point, axis) = around, fit
    stack, depth, line = np.empty(64, np.int64), 1, corner.shape[1] == 2
    # A line meets a box from its last entry between opposite sides to its first exit; twice as near covers rounding.
    inverse, wide = np.empty(3), 2 * near_m
    for i in range(3):
        inverse[i] = 1 / axis[i] if axis[i] != 0 else 1e300
    stack[0] = 0
    while depth > 0:
        depth -= 1
        box = stack[depth]
        apart, along, reach, enter, leave = False, 0.0, near_m, -np.inf, np.inf
        for i in range(3):
            least, greatest = boxes.low[box, i], boxes.high[box, i]
            apart = apart or least > high[i] or greatest < low[i]
            if line:
                a, b = (least - wide - point[i]) * inverse[i], (greatest + wide - point[i]) * inverse[i]
                enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            else:
                half = (greatest - least) / 2
                along += axis[i] * (least + half - point[i])
                reach += abs(axis[i]) * half
        if apart or enter > leave or abs(along) > reach:
            continue
        first, other = boxes.child[box]
        if first >= 0:
            stack[depth], stack[depth + 1] = first, other
            depth += 2
            continue
        for j in range(-1 - first, -1 - first + other):
            t = boxes.number[j]
            if state[t] < 0 and state[t] != -2 - me:
                if _distance(corner[t], point, axis) > near_m:
                    continue
                outside = False
                for i in range(3):
                    least, greatest = np.inf, -np.inf
                    for k in range(corner.shape[1]):
                        least, greatest = min(least, corner[t, k, i]), max(greatest, corner[t, k, i])
                    outside = outside or least > high[i] or greatest < low[i]
                if not outside:
                    state[t], members[count] = me, t
                    count += 1
    return count


@compiled
def _settle(
    corner: Shapes,
    size: Sizes,
    members: Numbers,
    before: int,
    count: int,
    point: Point,
    axis: Point,
    off: float,
    near_m: float,
) -> tuple[int, Point, Point, float]:
    """Fit a group with its new members, without those that then are off: how many it has, and its fit."""
    # Members that are left out come last. If a member from before would be off, all new ones are left out.
    while count > before:
        at, to = _fit(corner, size, members[:count], axis)
        farthest, near, good = 0.0, before, True
        for j in range(count):
            away = _distance(corner[members[j]], at, to)
            farthest = max(farthest, away)
            if j < before:
                good = good and away <= near_m
            elif away <= near_m:
                members[near], members[j] = members[j], members[near]
                near += 1
        if farthest <= near_m:
            return count, at, to, farthest
        count = near if good else before
    return before, point, axis, off


@compiled
def _grow(
    corner: Shapes, own_axis: Points, size: Sizes, order: Numbers, boxes: Boxes, near_m: float
) -> tuple[Numbers, Float[np.ndarray, "g 3"], Float[np.ndarray, "g 3"], Float[np.ndarray, " g"]]:
    """Groups, and point, axis and deviation of each; see `Fits`."""
    n = len(corner)
    # Group of each; -1 for none; -2 - g for none if group g rejected it last.
    state, members, count = np.full(n, -1), np.empty(n, np.int64), 0
    points, axes, offs = np.empty((n, 3)), np.empty((n, 3)), np.zeros(n)
    low, high = np.empty(3), np.empty(3)
    for s in order:
        if state[s] >= 0:
            continue
        state[s], members[0], m = count, s, 1
        point, axis, off = corner[s, 0].copy(), own_axis[s].copy(), 0.0
        for i in range(3):
            low[i], high[i] = corner[s, :, i].min(), corner[s, :, i].max()
        length = (high - low).max()
        while True:
            # As far again as the group is long, and farther if there is nothing.
            span, before = (high - low).max(), m
            if span > (_REACH if m > 1 else 1.0) * length:
                break
            for i in range(3):
                low[i] -= span
                high[i] += span
            m = _collect(corner, boxes, state, count, (low, high), (point, axis), near_m, members, m)
            if m == before:
                continue
            n_members = m
            m, point, axis, off = _settle(corner, size, members, before, n_members, point, axis, off, near_m)
            for j in range(m, n_members):
                state[members[j]] = -2 - count
            for i in range(3):
                low[i], high[i] = np.inf, -np.inf
                for j in range(m):
                    for k in range(corner.shape[1]):
                        low[i] = min(low[i], corner[members[j], k, i])
                        high[i] = max(high[i], corner[members[j], k, i])
            length = (high - low).max()
        points[count], axes[count], offs[count] = point, axis, off
        count += 1
    return state, points[:count].copy(), axes[:count].copy(), offs[:count].copy()
