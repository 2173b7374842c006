"""Straight walls under the steps of a raster.

A plan that is only a raster shows a slanted wall as a staircase. Which staircases are straight lines is known: those
that a line can pass between the centres of all the free cells on one side and all the others on the other (digital
straight segments; Klette and Rosenfeld 2004, "Digital straightness: a review", Discrete Applied Mathematics 139). The
lines that do so for one segment form a convex polygon in the plane of slope and offset (its preimage; Dorst and
Smeulders 1984, IEEE Trans. PAMI 6(4)), whose centroid is the wall. So no wall moves by more than half a cell, measured
along the grid, and the cells beside it keep their side; at corners, one may be cut by the walls that meet there.

The longest segments go first. A single step is a corner of the building and stays; so do walls along the grid, and
points where walls touch. Neighbouring walls are drawn on to where they meet.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from robosim.building.rings import polygons_of, rings_of
from wireless.support.compiled import compiled

#: A slanted wall has more steps to one side than this, or as many and so many cells along it.
_STEPS, _CELLS = 2, 6
#: A line passes centres of cells by more than this, in cells.
_LEAST = 1e-9
#: How far from the edges of cells the place may be where two walls meet, in cells.
_NEAR = 1.0
#: Walls are not shorter than this, in cells.
_SHORT = 0.1
#: Around a place where straight walls cross, none is made within so many cells; how often that is tried.
_APART, _TRIES = 3.0, 20

#: Corners of all slopes and offsets that a line through an edge may have.
_SQUARE = np.array([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])


class Ring(NamedTuple):
    """A closed line along edges of cells, edge by edge."""

    point: Int[np.ndarray, "n 2"]
    """Where each edge begins."""
    step: Int[np.ndarray, "n 2"]
    """Where it leads: a unit vector along the grid."""
    fixed: Bool[np.ndarray, " n"]
    """Whether it stays as it is."""


class Wall(NamedTuple):
    """A straight wall: the edges [first, end) that it stands for, and the line that it is on."""

    first: int
    end: int
    place: Float[np.ndarray, "2"]
    along: Float[np.ndarray, "2"]
    slanted: bool


def straightened(free: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Polygons along edges of cells with straight walls for staircases, and the same topology.

    Args:
        free: Valid polygons whose corners have whole coordinates and whose edges run along the grid.
    """
    outlines, owner = rings_of(free)
    rings = _rings([shapely.get_coordinates(outline).astype(np.int64) for outline in outlines])
    corners, astray = ([np.empty((0, 2))] * len(rings) for _ in range(2))
    changed = list(range(len(rings)))
    for attempt in range(_TRIES):
        for i in changed:
            corners[i] = _corners(rings[i])
            astray[i] = _left_out(rings[i], corners[i])
        wrong = np.concatenate([_crossings(corners), *astray])
        if not len(wrong):
            straight = polygons_of(corners, owner)
            return straight if shapely.is_valid(straight) else free
        changed = _fix(rings, KDTree(wrong), _APART * (1 + attempt))
    return free


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
    """Where closed lines cross themselves or each other; places near all of these, that is."""
    ends = np.concatenate([np.stack([points, np.roll(points, -1, axis=0)], axis=1) for points in corners])
    walls = shapely.linestrings(ends)
    one, other = shapely.STRtree(walls).query(walls, predicate="intersects")
    some = one < other
    one, other = one[some], other[some]
    common = shapely.intersection(walls[one], walls[other])
    at = ends[:, :, 0] + 1j * ends[:, :, 1]
    apart = (at[one][:, :, None] != at[other][:, None, :]).all(axis=(1, 2))
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


def _rings(outlines: list[Int[np.ndarray, "_ 2"]]) -> list[Ring]:
    """Closed lines of corners edge by edge; edges at points that lines have in common are fixed."""
    points, steps = [], []
    for corners in outlines:
        way = np.diff(corners, axis=0)
        length = np.abs(way).sum(axis=1)
        steps.append(np.repeat(way // length[:, None], length, axis=0))
        points.append(corners[0] + np.cumsum(steps[-1], axis=0) - steps[-1])
    every = np.concatenate(points)
    _, where, count = np.unique(every[:, 0] + 1j * every[:, 1], return_inverse=True, return_counts=True)
    shared = np.split(count[where] > 1, np.cumsum([len(p) for p in points])[:-1])
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
    way, point = ring.step[edge], ring.point[edge].astype(float)
    begins = np.flatnonzero((way[1:] != way[:-1]).any(axis=1)) + 1
    cuts = [0, *begins.tolist(), len(edge)] if len(edge) else []
    return [Wall(first + a, first + b, point[a], way[a].astype(float), False) for a, b in pairwise(cuts)]


def _corners(ring: Ring) -> Float[np.ndarray, "m 2"]:
    """Where the straight walls of a ring meet, in order."""
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
        for wall in (before, after):  # they go on beside each other
            corners.append(wall.place + wall.along * ((joint - wall.place) @ wall.along))
            on_grid.append(1 - wall.slanted)
    return _merged(np.array(corners), on_grid)


def _merged(corners: Float[np.ndarray, "n 2"], on_grid: list[int]) -> Float[np.ndarray, "m 2"]:
    """Corners without walls of no length; of the ends of such a wall the one of more walls along the grid stays."""
    kept = list(range(len(corners)))
    while True:
        gaps = np.abs(corners[kept] - corners[np.roll(kept, 1)]).max(axis=1)
        i = int(gaps.argmin())
        if gaps[i] >= _SHORT or len(kept) == 1:
            return corners[kept]
        del kept[i if on_grid[kept[i]] <= on_grid[kept[i - 1]] else i - 1]


def _meeting(ring: Ring, before: Wall, after: Wall) -> Float[np.ndarray, "2"] | None:
    """Where two walls in a row meet; None if that is nowhere near both."""
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
        for i in range(n):
            ends[axis, i] = _reach(step, fixed, i, i + n, axis)[0]
            ends[axis, n + i] = ends[axis, i] + n
    spans, lines = np.empty((n, 3), np.int64), np.empty((n, 2))
    found = 0
    open_first, open_end = [0], [2 * n]
    while len(open_first):
        low, high = open_first.pop(), open_end.pop()
        longest, first, axis = 0, 0, 0
        for way in range(2):
            for i in range(low, min(high, low + n)):
                end = min(ends[way, i], high)
                if end > i and step[end - 1, way] == 0:
                    end -= 1
                steps = bends[way, end] - bends[way, i]
                enough = steps > _STEPS or (steps == _STEPS and end - i - steps >= _CELLS)
                if enough and end - i > longest:
                    longest, first, axis = end - i, i, way
        if longest == 0:
            continue
        end, slope, offset = _reach(step, fixed, first, first + longest, axis)
        spans[found, 0], spans[found, 1], spans[found, 2] = first, end, axis
        lines[found, 0], lines[found, 1] = slope, offset
        found += 1
        if high - low == 2 * n:  # the first one: the rest of the ring goes from its end to its beginning
            open_first.append(end)
            open_end.append(first + n)
        else:
            open_first += [low, end]
            open_end += [first, high]
    return spans[:found], lines[:found]


@compiled
def _reach(
    step: Int[np.ndarray, "n2 2"], fixed: Bool[np.ndarray, " n2"], first: int, last: int, axis: int
) -> tuple[int, float, float]:
    """How far one line can go from an edge on, and the middle of all that can.

    From an edge before whose step more edges lie than after it, a longer line begins later: it is left out.

    Returns:
        The edge after its last one; slope and offset as `_segments` has them.
    """
    forth = step[first, axis]
    if forth == 0 or fixed[first]:
        return first, 0.0, 0.0
    run = first + 1
    while run < last and step[run, axis] == forth:
        run += 1
    after = run + 1
    while after < last and step[after, axis] == forth:
        after += 1
    if run - first > after - run:  # one of the next run's edges is the step
        return first, 0.0, 0.0
    # Corners of the preimage, in order; an offset is that in the middle of the first edge.
    kept, new, half = np.empty((16, 2)), np.empty((16, 2)), np.empty((16, 2))
    for i in range(4):
        kept[i, 0], kept[i, 1] = _SQUARE[i, 0], _SQUARE[i, 1]
    count, end, edges, level, side, stepped = 4, first + 1, 0, 0, 0, False
    for i in range(first + 1, last):
        across = step[i, 1 - axis]
        if fixed[i] or (across != 0 and (stepped or across == -side)) or step[i, axis] == -forth:
            break
        if across != 0:
            side, stepped = across, True
            continue
        edges += 1
        level += side if stepped else 0
        some = _clip(kept[:count], edges, 1.0, level - 0.5, half)
        some = _clip(half[:some], edges, -1.0, -level - 0.5, new)
        if some < 3:
            break
        kept, new = new, kept
        count, end, stepped = some, i + 1, False
    area, slope, offset = 0.0, 0.0, 0.0
    for i in range(2, count):
        a0, a1 = kept[i - 1, 0] - kept[0, 0], kept[i - 1, 1] - kept[0, 1]
        b0, b1 = kept[i, 0] - kept[0, 0], kept[i, 1] - kept[0, 1]
        part = a0 * b1 - a1 * b0
        area += part
        slope += part * (a0 + b0) / 3
        offset += part * (a1 + b1) / 3
    return end, kept[0, 0] + slope / area, kept[0, 1] + offset / area


@compiled
def _clip(
    polygon: Float[np.ndarray, "n 2"], edges: int, sign: float, least: float, out: Float[np.ndarray, "m 2"]
) -> int:
    """The part of a preimage whose lines lie to one side of a cell's centre, and how many corners it has."""
    n, found = len(polygon), 0
    for i in range(n):
        slope, offset = polygon[i, 0], polygon[i, 1]
        next_slope, next_offset = polygon[(i + 1) % n, 0], polygon[(i + 1) % n, 1]
        gap = sign * (slope * edges + offset) - least
        next_gap = sign * (next_slope * edges + next_offset) - least
        if gap > _LEAST:
            out[found, 0], out[found, 1] = slope, offset
            found += 1
        if (gap > _LEAST) != (next_gap > _LEAST):
            way = (gap - _LEAST) / (gap - next_gap)
            out[found, 0] = slope + (next_slope - slope) * way
            out[found, 1] = offset + (next_offset - offset) * way
            found += 1
    return found
