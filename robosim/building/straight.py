"""Straight walls under the steps of a raster.

A plan that is only a raster shows a slanted wall as a staircase. Which staircases are straight lines is known: those
that a line can pass between the centres of all the free cells on one side and all the others on the other (digital
straight segments; Klette and Rosenfeld 2004, "Digital straightness: a review", Discrete Applied Mathematics 139). The
lines that do so for one segment form a convex polygon in the plane of slope and offset (its preimage; Dorst and
Smeulders 1984, IEEE Trans. PAMI 6(4)), whose centroid is the wall. So no wall moves by more than half a cell, measured
along the grid, and the cells next to it keep their side; at corners, one may be cut by the walls that meet there.

The longest segments go first. A single step is a corner of the building and stays; so do walls along the grid, and
the places where straight walls would cross. Neighbouring walls are drawn on to where they meet.

The two sides of a slanted wall one cell thick touch at each of its steps, and one outline may pass a corner twice
there. The two sides become straight lines like any others (`robosim.building.outline`); other points where walls touch
stay.

The time is nearly proportional to the length of the outlines: the farthest ends of segments rise along an outline, so
that only maximal segments are measured (their tangential cover; Feschet and Tougne 1999), and the longest comes from a
priority queue.
"""

from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from robosim.building.extrusion import polygons_of, together
from robosim.support.compiled import compiled

#: A slanted wall has more steps to one side than the first, or as many and at least the second of cells along it.
_STEPS, _CELLS = 2, 6
#: A line passes centres of cells by more than this, in cells.
_LEAST = 1e-9
#: How far from the edges of cells the place may be where two walls meet, in cells.
_NEAR = 1.0
#: Walls are not shorter than this, in cells.
_SHORT = 0.1
#: Around a place where straight walls cross, none is made within this distance [cells]; number of attempts.
_APART, _TRIES = 3.0, 20

#: Most corners of a preimage: it has few, but rounding makes several of one where many lines meet. From half of that
#: on, those nearer to each other than this are merged.
_CORNERS, _SAME = 64, 1e-12

#: Corners of all slopes and offsets that a line through an edge may have.
_SQUARE = np.array([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])


class Ring(NamedTuple):
    """A closed line along edges of cells, edge by edge."""

    point: Int[np.ndarray, "n 2"]
    """Start of each edge."""
    step: Int[np.ndarray, "n 2"]
    """Direction of each edge: a unit vector along the grid."""
    fixed: Bool[np.ndarray, " n"]
    """Whether it stays as it is."""


class Wall(NamedTuple):
    """A straight wall: the edges [first, end) that it stands for, and the line that it is on."""

    first: int
    end: int
    place: Float[np.ndarray, "2"]
    along: Float[np.ndarray, "2"]
    slanted: bool


def straightened(
    outlines: list[Int[np.ndarray, "_ 2"]], owner: Int[np.ndarray, " n"], thin: Int[np.ndarray, "m 2"]
) -> shapely.MultiPolygon | None:
    """Polygons along edges of cells with straight walls for staircases, and the same topology; None if none are valid.

    Args:
        outlines: Corners of closed lines along the grid, free space on the left. They may touch at corners.
        owner: Which polygon each line belongs to; its outer line comes first.
        thin: Corners at which the two sides of slanted walls one cell thick touch. Edges at other corners that lines
            have in common stay as they are.
    """
    rings = _rings(outlines, thin)
    corners, astray = ([np.empty((0, 2))] * len(rings) for _ in range(2))
    changed = list(range(len(rings)))
    for attempt in range(_TRIES):
        for i in changed:
            corners[i] = _corners(rings[i])
            astray[i] = _left_out(rings[i], corners[i])
        wrong = np.concatenate([_crossings(corners), *astray])
        if not len(wrong):
            straight = polygons_of(corners, owner)
            if not shapely.is_valid(straight):  # lines that still pass a corner twice are parted there
                parts = shapely.make_valid(shapely.get_parts(straight), method="structure")
                straight = together(shapely.get_parts(parts))
            return straight if len(straight.geoms) == owner[-1] + 1 else None
        changed = _fix(rings, KDTree(wrong), _APART * (1 + attempt))
    return None


def _fix(rings: list[Ring], wrong: KDTree, apart: float) -> list[int]:
    """Fix edges that are near places where something is wrong; which rings that changes."""
    changed = []
    for i, ring in enumerate(rings):
        near = (wrong.query(ring.point + ring.step / 2)[0] <= apart) & ~ring.fixed
        if near.any():
            ring.fixed[near] = True
            changed.append(i)
    return changed


def _crossings(corners: list[Float[np.ndarray, "_ 2"]]) -> Float[np.ndarray, "n 2"]:
    """Places near all crossings of closed lines with themselves or each other."""
    ends = np.concatenate([np.stack([points, np.roll(points, -1, axis=0)], axis=1) for points in corners])
    walls = shapely.linestrings(ends)
    first, other = shapely.STRtree(walls).query(walls, predicate="intersects")
    distinct = first < other
    first, other = first[distinct], other[distinct]
    common = shapely.intersection(walls[first], walls[other])
    at = ends[:, :, 0] + 1j * ends[:, :, 1]
    apart = (at[first][:, :, None] != at[other][:, None, :]).all(axis=(1, 2))
    crossing = apart | (shapely.get_dimensions(common) > 0)  # walls in a row may have their end in common
    return shapely.get_coordinates(shapely.centroid(common[crossing]))


def _left_out(ring: Ring, corners: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "n 2"]:
    """Middles of edges of cells that are far from a new line, and corners of it that are far from the edges."""
    middles = ring.point + ring.step / 2
    if len(corners) < 3:
        return middles
    lines = shapely.linearrings(ring.point), shapely.linearrings(corners)
    shapely.prepare(lines)
    astray, far = (
        ~shapely.dwithin(line, shapely.points(points), _NEAR)
        for line, points in zip(lines, (corners, middles), strict=True)
    )
    return np.concatenate([middles[far], corners[astray]])


def _rings(outlines: list[Int[np.ndarray, "_ 2"]], thin: Int[np.ndarray, "m 2"]) -> list[Ring]:
    """Closed lines of corners edge by edge; edges at points that lines have in common are fixed but at thin walls."""
    points, steps = [], []
    for corners in outlines:
        side = np.diff(corners, axis=0, append=corners[:1])
        length = np.abs(side).sum(axis=1)
        steps.append(np.repeat(side // length[:, None], length, axis=0))
        points.append(corners[0] + np.cumsum(steps[-1], axis=0) - steps[-1])
    every = np.concatenate(points) @ (1, 1j)
    _, where, count = np.unique(every, return_inverse=True, return_counts=True)
    common = (count[where] > 1) & ~np.isin(every, thin @ (1, 1j))
    shared = np.split(common, np.cumsum([len(p) for p in points])[:-1])
    return [
        Ring(point, step, here | np.roll(here, -1))
        for point, step, here in zip(points, steps, shared, strict=True)
    ]


def _walls(ring: Ring, spans: Int[np.ndarray, "m 3"], lines: Float[np.ndarray, "m 2"]) -> list[Wall]:
    """The straight walls of a ring in order, slanted or along the grid; edges are counted on over its end."""
    n = len(ring.step)
    order = np.argsort(spans[:, 0])
    at = start = int(spans[order[0], 0])
    walls: list[Wall] = []
    for i in order:
        first, end, axis = spans[i].tolist()
        slope, offset = lines[i]
        walls += _along_grid(ring, at, first)
        along, place = np.empty(2), ring.point[first % n].astype(float)
        along[axis], along[1 - axis] = ring.step[first % n, axis], slope
        place[axis] += along[axis] / 2
        place[1 - axis] += offset
        walls.append(Wall(first, end, place, along / np.hypot(*along), True))
        at = end
    return walls + _along_grid(ring, at, start + n)


def _along_grid(ring: Ring, first: int, end: int) -> list[Wall]:
    """The straight lines of edges among the edges [first, end)."""
    edge = np.arange(first, end) % len(ring.step)
    step, point = ring.step[edge], ring.point[edge].astype(float)
    begins = np.flatnonzero((step[1:] != step[:-1]).any(axis=1)) + 1
    cuts = [0, *begins.tolist(), len(edge)] if len(edge) else []
    return [Wall(first + a, first + b, point[a], step[a].astype(float), False) for a, b in pairwise(cuts)]


def _corners(ring: Ring) -> Float[np.ndarray, "m 2"]:
    """Corners at which the straight walls of a ring meet, in order."""
    spans, lines = _segments(np.tile(ring.step, (2, 1)), np.tile(ring.fixed, 2))
    if not len(spans):
        turns = (ring.step != np.roll(ring.step, 1, axis=0)).any(axis=1)
        return ring.point[turns].astype(float)
    walls = _walls(ring, spans, lines)
    for i in range(len(walls) - 1, -1, -1):
        # A single edge left over between two walls that meet there belongs to their corner.
        before, wall, after = walls[i - 1], walls[i], walls[(i + 1) % len(walls)]
        left_over = wall.end - wall.first == 1 and not ring.fixed[wall.first % len(ring.step)]
        if left_over and (before.slanted or after.slanted) and _meeting(ring, before, after) is not None:
            del walls[i]
    corners, on_grid = [], []
    for before, after in pairwise([walls[-1], *walls]):
        meeting = _meeting(ring, before, after)
        if meeting is not None:
            corners.append(meeting)
            on_grid.append(2 - before.slanted - after.slanted)
            continue
        joint = ring.point[after.first % len(ring.step)]
        for wall in (before, after):  # they continue in parallel
            corners.append(wall.place + wall.along * ((joint - wall.place) @ wall.along))
            on_grid.append(1 - wall.slanted)
    return _merged(np.array(corners), on_grid)


def _merged(corners: Float[np.ndarray, "n 2"], on_grid: list[int]) -> Float[np.ndarray, "m 2"]:
    """Corners without walls of no length; of the ends of such a wall the one of more walls along the grid stays."""
    count = len(corners)
    before, after = [*range(-1, count - 1)], [*range(1, count), 0]
    before[0] = count - 1
    gaps = np.abs(corners - np.roll(corners, 1, axis=0)).max(axis=1).tolist()
    short = [(gap, i) for i, gap in enumerate(gaps) if gap < _SHORT]
    heapify(short)
    stays = np.ones(count, bool)
    while short and count > 1:
        gap, i = heappop(short)
        if not stays[i] or gap != gaps[i]:
            continue
        removed = i if on_grid[i] <= on_grid[before[i]] else before[i]
        stays[removed], count = False, count - 1
        left, right = before[removed], after[removed]
        after[left], before[right] = right, left
        gaps[right] = float(np.abs(corners[right] - corners[left]).max())
        if gaps[right] < _SHORT:
            heappush(short, (gaps[right], right))
    return corners[stays]


def _meeting(ring: Ring, before: Wall, after: Wall) -> Float[np.ndarray, "2"] | None:
    """Corner at which two consecutive walls meet; None if it is near neither."""
    n = len(ring.step)
    if not (before.slanted or after.slanted):
        return ring.point[after.first % n].astype(float)
    sine = before.along[0] * after.along[1] - before.along[1] * after.along[0]
    if abs(sine) < 1e-9:
        return None
    gap = after.place - before.place
    meeting = before.place + before.along * (gap[0] * after.along[1] - gap[1] * after.along[0]) / sine
    both = ring.point[(before.first + np.arange((after.end - before.first - 1) % n + 2)) % n] - meeting
    ahead = both[0] @ before.along < 0 < both[-1] @ after.along
    return meeting if ahead and np.hypot(*both.T).min() <= _NEAR else None


@compiled
def _segments(
    step: Int[np.ndarray, "n2 2"], fixed: Bool[np.ndarray, " n2"]
) -> tuple[Int[np.ndarray, "m 3"], Float[np.ndarray, "m 2"]]:
    """Slanted walls of a ring that is given twice over, longest first.

    Returns:
        First edge, the one after the last, and the axis (0 x, 1 y) that a wall goes along rather; its slope against
        that axis per step, and its offset from the first edge's line in the middle of that edge.
    """
    n = len(step) // 2
    ends = np.zeros((2, 2 * n), np.int64)
    bends = np.zeros((2, 2 * n + 1), np.int64)
    for axis in range(2):
        for i in range(2 * n):
            bends[axis, i + 1] = bends[axis, i] + (step[i, axis] == 0)
        _farthest(step, fixed, axis, ends[axis])
    spans, lines, count = np.empty((n, 3), np.int64), np.empty((n, 2)), 0
    queue = _longest_first(ends, bends, 0, n, 2 * n)
    # Each open stretch of the ring has a number.
    stretch, lows, highs = np.zeros(2 * n, np.int64), [0], [2 * n]
    while len(queue) > 0:
        negative, axis, i = heappop(queue)
        at = stretch[i]
        if at < 0:
            continue
        length = _length(ends[axis], bends[axis], i, highs[at])
        if length != -negative:  # another wall has taken its end since
            if length > 0:
                heappush(queue, (-length, axis, i))
            continue
        end = i + length
        spans[count, 0], spans[count, 1], spans[count, 2] = i, end, axis
        count += 1
        stretch[i:end] = -1
        if count == 1:  # the rest of the ring goes from the end of the first one to its beginning
            lows[0], highs[0] = end, i + n
            queue = _longest_first(ends, bends, end, i + n, i + n)
        elif i - lows[at] < highs[at] - end:  # the smaller part gets a new number
            stretch[lows[at] : i] = len(lows)
            lows.append(lows[at])
            highs.append(i)
            lows[at] = end
        else:
            stretch[end : highs[at]] = len(lows)
            lows.append(end)
            highs.append(highs[at])
            highs[at] = i
    for k in range(count):
        _, lines[k, 0], lines[k, 1] = _reach(step, fixed, spans[k, 0], spans[k, 1], spans[k, 2], 1)
    return spans[:count], lines[:count]


@compiled
def _longest_first(
    ends: Int[np.ndarray, "2 n2"], bends: Int[np.ndarray, "2 n3"], low: int, stop: int, high: int
) -> list[tuple[int, int, int]]:
    """Priority queue of slanted walls from the edges [low, stop) on: negative length, axis, first edge."""
    queue = [(0, 0, 0)]
    queue.pop()
    for axis in range(2):
        for i in range(low, stop):
            length = _length(ends[axis], bends[axis], i, high)
            if length > 0:
                queue.append((-length, axis, i))
    heapify(queue)
    return queue


@compiled
def _length(end: Int[np.ndarray, " n2"], bends: Int[np.ndarray, " n3"], first: int, high: int) -> int:
    """Edges of the longest segment from an edge on that ends before another; 0 if that is no slanted wall."""
    last = min(end[first], high)
    if last <= first:
        return 0
    if bends[last] > bends[last - 1]:
        last -= 1
    steps = bends[last] - bends[first]
    enough = steps > _STEPS or (steps == _STEPS and last - first - steps >= _CELLS)
    return last - first if enough else 0


@compiled
def _farthest(
    step: Int[np.ndarray, "n2 2"], fixed: Bool[np.ndarray, " n2"], axis: int, end: Int[np.ndarray, " n2"]
) -> None:
    """How far one line can go from each edge of a ring, given twice over, into `end`; as far as the edge if nowhere.

    From an edge before whose step more edges lie than after it, a longer line begins later: it is left out.
    """
    n = len(step) // 2
    run = np.arange(1, 2 * n + 1)  # where the straight line of edges from each one on ends
    for i in range(2 * n - 2, -1, -1):
        if step[i, 0] == step[i + 1, 0] and step[i, 1] == step[i + 1, 1]:
            run[i] = run[i + 1]
    i = 0
    while i < n:
        if step[i, axis] == 0 or fixed[i]:
            end[i], end[n + i] = i, n + i
            i += 1
            continue
        far = _reach(step, fixed, i, i + n, axis, 1)[0]
        # No line from an edge before `begin` goes on to the next edge along the axis: all of them end at `far`.
        begin, following = far, min(far + (step[far, axis] == 0), 2 * n - 1)
        if step[following, axis] != 0 and not fixed[following]:
            begin = _reach(step, fixed, following, i, axis, -1)[0] + 1
        begin = min(begin, n)
        for k in range(i, begin):
            end[k] = k
            if step[k, axis] != 0 and not fixed[k] and k < far:
                turn = min(run[k], k + n)
                after = turn + 1
                if after < k + n and step[after, axis] == step[k, axis]:
                    after = min(run[after], k + n)
                if turn - k <= after - turn:
                    end[k] = far
            end[n + k] = end[k] + n
        i = begin


@compiled
def _reach(
    step: Int[np.ndarray, "n2 2"],
    fixed: Bool[np.ndarray, " n2"],
    first: int,
    last: int,
    axis: int,
    sense: int,
) -> tuple[int, float, float]:
    """How far one line can go from an edge, before `last`, and the middle of all that can.

    It goes along `axis` (0 x, 1 y) rather, towards later edges (`sense` 1) or earlier ones (-1) of a ring, twice over.
    Returned are the edge after its last one, slope and offset as `_segments` has them.
    """
    forth = step[first, axis]
    # Corners of the preimage, in order; an offset is that in the middle of the first edge.
    preimage, new, half = np.empty((_CORNERS, 2)), np.empty((_CORNERS, 2)), np.empty((_CORNERS, 2))
    for i in range(4):
        preimage[i, 0], preimage[i, 1] = _SQUARE[i, 0], _SQUARE[i, 1]
    count, end, edges, level, side, stepped = 4, first + sense, 0, 0, 0, False
    for i in range(first + sense, last, sense):
        across = sense * step[i, 1 - axis]
        if fixed[i] or (across != 0 and (stepped or across == -side)) or step[i, axis] == -forth:
            break
        if across != 0:
            side, stepped = across, True
            continue
        edges += 1
        level += side if stepped else 0
        n_corners = _clip(preimage[:count], edges, 1.0, level - 0.5, half)
        n_corners = _clip(half[:n_corners], edges, -1.0, -level - 0.5, new)
        if n_corners > _CORNERS // 2:
            n_corners = _distinct(new[:n_corners])
        if n_corners < 3:
            break
        preimage, new = new, preimage
        count, end, stepped = n_corners, i + sense, False
    area, slope, offset = 0.0, 0.0, 0.0
    for i in range(2, count):
        a0, a1 = preimage[i - 1, 0] - preimage[0, 0], preimage[i - 1, 1] - preimage[0, 1]
        b0, b1 = preimage[i, 0] - preimage[0, 0], preimage[i, 1] - preimage[0, 1]
        determinant = a0 * b1 - a1 * b0
        area += determinant
        slope += determinant * (a0 + b0) / 3
        offset += determinant * (a1 + b1) / 3
    return end, preimage[0, 0] + slope / area, preimage[0, 1] + offset / area


@compiled
def _clip(
    polygon: Float[np.ndarray, "n 2"], edges: int, sign: float, least: float, out: Float[np.ndarray, "m 2"]
) -> int:
    """The part of a preimage whose lines lie to one side of a cell's centre, and how many corners it has."""
    n, count = len(polygon), 0
    for i in range(n):
        slope, offset = polygon[i, 0], polygon[i, 1]
        next_slope, next_offset = polygon[(i + 1) % n, 0], polygon[(i + 1) % n, 1]
        gap = sign * (slope * edges + offset) - least
        next_gap = sign * (next_slope * edges + next_offset) - least
        if gap > _LEAST:
            out[count, 0], out[count, 1] = slope, offset
            count += 1
        if (gap > _LEAST) != (next_gap > _LEAST):
            share = (gap - _LEAST) / (gap - next_gap)
            out[count, 0] = slope + (next_slope - slope) * share
            out[count, 1] = offset + (next_offset - offset) * share
            count += 1
    return count


@compiled
def _distinct(polygon: Float[np.ndarray, "n 2"]) -> int:
    """Move corners of a preimage that are not at the one before to its beginning, and how many these are."""
    count = 1
    for i in range(1, len(polygon)):
        last, first = polygon[count - 1], polygon[0]
        from_last = max(abs(polygon[i, 0] - last[0]), abs(polygon[i, 1] - last[1]))
        from_first = max(abs(polygon[i, 0] - first[0]), abs(polygon[i, 1] - first[1]))
        if min(from_last, from_first) > _SAME:
            polygon[count, 0], polygon[count, 1] = polygon[i, 0], polygon[i, 1]
            count += 1
    return count
