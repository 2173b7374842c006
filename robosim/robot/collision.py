"""Walls as few convex solids, with which the robot's hull collides.

A wall is a line, the boundary of free space; anything behind it may be solid. So the solid along the walls is covered
by convex pieces whose faces lie on the wall lines exactly, that reach into no free space, and that may overlap, since
walls do not collide with each other. Time per physics step grows with the number of pieces.

Outlines of cells are solved on their lattice, as below. Any other outline gets one rectangle behind each wall, as
thick as there is room for, and where the solid is too narrow for one, at sharp corners, the triangle that the
constrained Delaunay triangulation has there. MuJoCo knows the distance of a sphere from a box in closed form, so
rectangles are preferred.

Furnishings are convex pieces of the floor that they take from a robot of some height, as high as walls: what is lower
than the robot stops its whole hull, and what is higher does not touch it.
Left out: the solid further inside, which nothing can reach.

The lattice: walls of a plan that was not simplified are axis-aligned, and with walls through the centres of cells
also at 45 degrees, along diagonals of its squares. Each square is then free, solid, or half solid. Solid squares next
to free space are covered greedily by rectangles that grow as far as the solid goes. The half squares along a slope
become one rotated rectangle, half a diagonal thick, if the solid behind them allows; it always does if walls come
from cells.

Units are squares of the lattice throughout. Left out: the fewest possible rectangles.
"""

import logging
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, UInt8

from robosim.building.building import Building
from robosim.building.extrusion import wall_segments
from robosim.plans.floorplan import FloorPlan
from robosim.support.index_ranges import index_ranges
from slam.hull import Hull
from slam.poses import to_map

# Both diagonals cut a square into four quarters, named by the side that they touch.
EAST, NORTH, WEST, SOUTH = range(4)
_CENTROIDS = np.array([[0.75, 0.5], [0.5, 0.75], [0.25, 0.5], [0.5, 0.25]])

#: Rectangles grow by at most this many squares to a side, which bounds the time to find them.
_MAX_GROWTH = 256


def lattice_solids(
    walls: Int[np.ndarray, "n 2 2"], margin: int
) -> tuple[Float[np.ndarray, "_ 5"], list[Float[np.ndarray, "_ 2"]]] | None:
    """Rectangles and triangles on the solid side of walls along a lattice.

    Args:
        walls: Ends of the straight pieces of the boundary of free space, in any order; closed rings.
        margin: Squares of solid to assume around everything.

    Returns:
        Rectangles as centre x, y, half length along and across, yaw of the length; and triangles, counter-clockwise,
        for half squares that a rectangle would not fit behind. None if a square is neither free, solid nor half solid.
    """
    lowest = walls.min(axis=(0, 1)) - margin
    size = walls.max(axis=(0, 1)) - lowest + margin
    solid = 15 ^ free_quarters(walls - lowest, (int(size[1]), int(size[0])))
    full = solid == 15
    halves = {corner: solid == _half(corner) for corner in product((0, 1), (0, 1))}
    if not np.isin(np.arange(16), [0, 15, *map(_half, halves)])[solid].all():
        return None
    slopes = [_slopes(solid, corner, half) for corner, half in halves.items() if half.any()]
    boxes = np.vstack([_cover(full, _next_to_free(solid)), *(boxes for boxes, _ in slopes)])
    boxes[:, :2] += lowest
    return boxes, [triangle + lowest for _, triangles in slopes for triangle in triangles]


def free_quarters(walls: Int[np.ndarray, "n 2 2"], shape: tuple[int, int]) -> UInt8[np.ndarray, "ny nx"]:
    """Bits of free quarters of (rows, columns) of squares: their centroids see an odd number of walls to the left."""
    walls = walls[walls[:, 0, 1] != walls[:, 1, 1]]
    (x0, y0), (x1, y1) = walls[:, 0].T, walls[:, 1].T
    length = np.abs(y1 - y0)
    wall, row = index_ranges(np.minimum(y0, y1), length)
    slope = ((x1 - x0) / (y1 - y0))[wall]
    odd = np.zeros(shape, np.uint8)
    for quarter, (x, y) in enumerate(_CENTROIDS):
        crossing = x0[wall] + slope * (row + y - y0[wall])
        column = np.floor(crossing - x).astype(int) + 1
        np.bitwise_xor.at(odd, (row, column), np.uint8(1 << quarter))
    return np.bitwise_xor.accumulate(odd, axis=1, out=odd)


def _next_to_free(solid: UInt8[np.ndarray, "ny nx"]) -> Bool[np.ndarray, "ny nx"]:
    """Solid squares with a free quarter across one of their sides."""
    free = np.pad(15 ^ solid, 1)
    across = free[1:-1, 2:] & 1 << WEST | free[2:, 1:-1] & 1 << SOUTH
    across |= free[1:-1, :-2] & 1 << EAST | free[:-2, 1:-1] & 1 << NORTH
    return (across > 0) & (solid == 15)


def _half(corner: tuple[int, int]) -> int:
    """Solid quarters, one bit each, of a square whose half at `corner` is solid."""
    x, y = corner
    return (1 << EAST if x else 1 << WEST) | (1 << NORTH if y else 1 << SOUTH)


def _cover(solid: Bool[np.ndarray, "ny nx"], wanted: Bool[np.ndarray, "ny nx"]) -> Float[np.ndarray, "_ 5"]:
    """Rectangles inside of the solid that cover all wanted squares, found greedily row by row."""
    todo, rectangles = wanted.copy(), []
    for iy, ix in np.argwhere(wanted).tolist():
        if not todo[iy, ix]:
            continue
        wide = _grow(solid, iy, ix, "xy")
        tall = _grow(solid, iy, ix, "yx")
        best = max(wide, tall, key=lambda box: int(todo[box].sum()))
        todo[best] = False
        rectangles.append((best[1].start, best[0].start, best[1].stop, best[0].stop))
    x0, y0, x1, y1 = np.array(rectangles, float).reshape(-1, 4).T
    return np.column_stack([(x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0) / 2, (y1 - y0) / 2, np.zeros_like(x0)])


def _grow(solid: Bool[np.ndarray, "ny nx"], iy: int, ix: int, order: str) -> tuple[slice, slice]:
    """Largest solid rectangle around a square that is first grown along one axis, then along the other."""
    rows, columns = slice(iy, iy + 1), slice(ix, ix + 1)
    for axis in order:
        if axis == "x":
            strip = np.logical_and.reduce(solid[rows], axis=0)
            columns = slice(ix - _run(strip[ix::-1]) + 1, ix + _run(strip[ix:]))
        else:
            strip = np.logical_and.reduce(solid[:, columns], axis=1)
            rows = slice(iy - _run(strip[iy::-1]) + 1, iy + _run(strip[iy:]))
    return rows, columns


def _run(strip: Bool[np.ndarray, " _"]) -> int:
    """Number of true elements that a strip begins with, up to the growth allowed."""
    strip = strip[:_MAX_GROWTH]
    return len(strip) if strip.all() else int(strip.argmin())


def _slopes(
    solid: UInt8[np.ndarray, "ny nx"], corner: tuple[int, int], half: Bool[np.ndarray, "ny nx"]
) -> tuple[Float[np.ndarray, "_ 5"], list[Float[np.ndarray, "_ 2"]]]:
    """Rotated rectangles behind the slopes of half squares, solid at a corner only, and triangles if none fits."""
    x, y = corner
    iy, ix = np.nonzero(half)
    # A rectangle also fills the quarters on the far side of the two legs of the half square.
    fits = (
        solid[iy, ix + (1 if x else -1)] >> (WEST if x else EAST)
        & solid[iy + (1 if y else -1), ix] >> (SOUTH if y else NORTH)
        & 1
    ).astype(bool)
    ends = np.array([(x, 1 - y), (1 - x, y)])
    alone = np.column_stack([ix, iy])[~fits]
    triangle = np.array([corner, *ends]) if x != y else np.array([corner, *ends[::-1]])
    triangles = [square + triangle.astype(float) for square in alone]

    ix, iy = ix[fits], iy[fits]
    if len(ix) == 0:
        return np.empty((0, 5)), triangles
    climb = -1 if x == y else 1
    line = iy - climb * ix
    by_line = np.lexsort([ix, line])
    ix, iy, line = ix[by_line], iy[by_line], line[by_line]
    first = np.flatnonzero(np.diff(line, prepend=-1 << 30) | (np.diff(ix, prepend=-1 << 30) != 1))
    last = np.append(first[1:], len(ix)) - 1
    left, right = ends[np.argsort(ends[:, 0])]
    start = np.column_stack([ix[first], iy[first]]) + left
    slope = np.column_stack([ix[last], iy[last]]) + right - start
    centre = start + slope / 2 + (np.array(corner) - 0.5) / 2
    n = len(first)
    sizes = np.column_stack(
        [np.hypot(*slope.T) / 2, np.full(n, np.sqrt(2) / 4), np.full(n, climb * np.pi / 4)]
    )
    return np.hstack([centre, sizes]), triangles


logger = logging.getLogger(__name__)

#: Thickness of the walls around the outline of cells [m].
OUTER_M = 0.3
#: How much a hull may stand in a wall at first [m]: walls are offset by polygons in place of circles.
FIT_M = 1e-3
#: Depths tried for a rectangle behind a wall that follows no lattice [m].
DEPTHS_M = (0.3, 0.1, 0.03, 0.01)
#: How far vertices may be off the lattice [cells], and pieces from the wall lines [m].
_EXACT = 1e-6


@dataclass(frozen=True, eq=False)
class WallSolids:
    """Convex pieces of wall, all upright prisms, in `map`."""

    boxes: Float[np.ndarray, "n 5"]
    """Rectangles: centre x, y [m], half length along and across [m], yaw of the length [rad]."""
    prisms: list[Float[np.ndarray, "_ 2"]] = field(default_factory=list)
    """Other convex polygons: corners x, y [m], counter-clockwise."""

    def __len__(self) -> int:
        return len(self.boxes) + len(self.prisms)

    def polygons(self) -> list[shapely.Polygon]:
        """All pieces, seen from above."""
        return [*shapely.polygons(_corners(self.boxes)), *map(shapely.Polygon, self.prisms)]


def solids(building: Building, height_m: float) -> WallSolids:
    """Convex pieces of all that stops a robot of some height [m] in a building: walls, and what is placed."""
    walls, placed = wall_solids(building.free, building.plan), placed_solids(building, height_m)
    return WallSolids(np.vstack([walls.boxes, placed.boxes]), walls.prisms + placed.prisms)


def placed_solids(building: Building, height_m: float) -> WallSolids:
    """Convex pieces of the floor that placed things take from a robot of some height [m]."""
    things = building.taken(height_m)
    if things.is_empty:
        return WallSolids(np.empty((0, 5)))
    pieces = _behind_walls(things, wall_segments(things)[:, ::-1])  # free floor is on the left of them
    logger.info(f"{building.plan.name}: {len(pieces.boxes)} boxes and {len(pieces.prisms)} prisms placed")
    return pieces


def wall_solids(free: shapely.MultiPolygon, plan: FloorPlan) -> WallSolids:
    """Convex pieces that cover the solid side of each wall line around free space [m], and no free space.

    The plan's cells are the lattice, if the outline still follows them.
    """
    segments = wall_segments(free)
    solids = _along_lattice(segments, plan) or _behind_walls(_around(free).difference(free), segments)
    logger.info(f"{plan.name}: walls made of {len(solids.boxes)} boxes and {len(solids.prisms)} prisms")
    return solids


def check_pose(free: shapely.Geometry, pose: Float[np.ndarray, "3"], hull: Hull) -> None:
    """Raise ValueError if a hull would be in a wall by more than `FIT_M` at a pose, or the pose is not finite."""
    if not np.isfinite(pose).all():
        raise ValueError(f"pose = {pose}, expected finite x [m], y [m], yaw [rad].")
    where = f"pose = ({pose[0]:.3f}, {pose[1]:.3f}"
    if hull.outline_m:
        if not shapely.covers(free, hull_at(hull, pose).buffer(-FIT_M)):
            raise ValueError(
                f"{where}, {pose[2]:.3f}) has a part of the hull in a wall, expected it on free floor. Draw poses from "
                "what the hull can reach, with room to turn."
            )
        return
    centre = shapely.Point(pose[0], pose[1])
    gap_m = (
        shapely.distance(centre, shapely.boundary(free)) if shapely.intersects_xy(free, *pose[:2]) else 0.0
    )
    if gap_m < hull.radius_m - FIT_M:
        gap = f"{gap_m:.3f} m from the nearest wall" if gap_m else "not in free space"
        raise ValueError(
            f"{where}) is {gap}, expected at least the hull's radius, {hull.radius_m:g} m. Draw poses from what the "
            "hull can reach."
        )


def hull_at(hull: Hull, pose: Float[np.ndarray, "3"]) -> shapely.Polygon:
    """The polygon of a hull with an outline at a pose x [m], y [m], yaw [rad]."""
    return shapely.Polygon(to_map(pose, hull.corners))


def depth_in(walls: shapely.Geometry, hull: Hull, pose: Float[np.ndarray, "3"]) -> float:
    """How deep walls reach into a hull with an outline at a pose [m]."""
    polygon = hull_at(hull, pose)
    corners = shapely.get_coordinates(shapely.intersection(walls, polygon))
    return float(shapely.distance(shapely.points(corners), polygon.exterior).max(initial=0.0))


def _along_lattice(segments: Float[np.ndarray, "n 2 2"], plan: FloorPlan) -> WallSolids | None:
    """Pieces for walls along the edges of cells or through their centres; None for other walls."""
    in_cells = plan.to_cells(segments)
    for shift in (0.0, 0.5):
        steps = np.round(in_cells - shift)
        extent = np.abs(steps[:, 1] - steps[:, 0])
        straight = (extent.min(axis=1) == 0) | (extent[:, 0] == extent[:, 1])
        if straight.all() and np.abs(in_cells - shift - steps).max() < _EXACT:
            break
    else:
        return None
    pieces = lattice_solids(steps.astype(int), margin=1 + int(OUTER_M / plan.resolution_m))
    if pieces is None:
        return None
    boxes, prisms = pieces
    centres = plan.to_map(boxes[:, :2] + shift)
    sizes = boxes[:, 2:4] * plan.resolution_m
    boxes = np.column_stack([centres, sizes, boxes[:, 4] + plan.origin[2]])
    return WallSolids(boxes, [plan.to_map(prism + shift) for prism in prisms])


def _behind_walls(solid: shapely.Geometry, segments: Float[np.ndarray, "n 2 2"]) -> WallSolids:
    """A rectangle behind each wall, on its right, or a triangle of the solid where none fits."""
    shapely.prepare(solid)
    boxes, left = [], segments[np.hypot(*(segments[:, 1] - segments[:, 0]).T) > _EXACT]
    for depth_m in DEPTHS_M:
        behind = _rectangles(left, depth_m)
        fits = shapely.covers(solid, shapely.polygons(_corners(behind - [0, 0, _EXACT, _EXACT, 0])))
        boxes.append(behind[fits])
        left = left[~fits]
    return WallSolids(np.vstack(boxes), _triangles(solid, left))


def _around(free: shapely.Geometry) -> shapely.Polygon:
    """A rectangle around free space with room for what is behind walls."""
    margin = max(DEPTHS_M) + 1
    xmin, ymin, xmax, ymax = free.bounds
    return shapely.box(xmin - margin, ymin - margin, xmax + margin, ymax + margin)


def _rectangles(walls: Float[np.ndarray, "n 2 2"], depth_m: float) -> Float[np.ndarray, "n 5"]:
    """Rectangles of some depth on the right of walls."""
    along = walls[:, 1] - walls[:, 0]
    length = np.hypot(*along.T)
    right = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    centre = walls.mean(axis=1) + right * depth_m / 2
    return np.column_stack(
        [centre, length / 2, np.full_like(length, depth_m / 2), np.arctan2(along[:, 1], along[:, 0])]
    )


def _triangles(solid: shapely.Geometry, walls: Float[np.ndarray, "n 2 2"]) -> list[Float[np.ndarray, "3 2"]]:
    """Triangles of the solid's triangulation that have a side on one of the walls."""
    if len(walls) == 0:
        return []
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(solid))
    corners = shapely.get_coordinates(shapely.orient_polygons(triangles)).reshape(-1, 4, 2)[:, :3]
    ends = np.concatenate([corners, np.roll(corners, -1, axis=1)], axis=2)
    # The triangulation keeps the solid's vertices bit for bit.
    owner = {tuple(side): i for i, three in enumerate(ends.tolist()) for side in three}
    adjacent = dict.fromkeys(owner[(*b, *a)] for a, b in walls.tolist())
    return [corners[i] for i in adjacent]


def _corners(boxes: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, "n 4 2"]:
    """Corners of rectangles, counter-clockwise."""
    c, s = np.cos(boxes[:, 4]), np.sin(boxes[:, 4])
    along = np.column_stack([c, s]) * boxes[:, 2:3]
    across = np.column_stack([-s, c]) * boxes[:, 3:4]
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    offsets = signs[:, :1, None] * along + signs[:, 1:, None] * across  # (4, n, 2)
    return boxes[:, None, :2] + offsets.transpose(1, 0, 2)
