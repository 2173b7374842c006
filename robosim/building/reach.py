"""Places that a robot's hull can reach, the distances to drive, and rooms that it cannot enter.

The centre of a disk may be on the free floor shrunk by its radius. That set is sampled at the centres of the plan's
cells, and the hull can drive within its 4-connected parts. The middle of the axle of a hull with an outline may be
where no wall meets the outline, at some of `HEADINGS` headings: exactly, where it is not in the convex hulls of the
walls' ends moved by the reversed outline (Lozano-Perez 1983). Parts are connected over places and headings: a
differential drive can follow any path through open space as closely as it likes, if need be by manoeuvres (Laumond et
al. 1998).
Distances are travel times of a front that moves at unit speed from a cell through such a part (fast
marching, exact to a fraction of a cell). Left out: turning, and passages narrower than a cell beyond the
hull, or than the next heading needs, which the sampling may close.
References: Lozano-Perez, Spatial planning: a configuration space approach, IEEE Trans. Computers 32(2), 1983; Laumond,
Sekhavat and Lamiraux, Guidelines in nonholonomic motion planning for mobile robots, in Robot Motion Planning and
Control, Springer, 1998.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from robosim.building.building import Building
from robosim.building.extrusion import wall_segments
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.outside import outside_of
from robosim.support.checks import RADIUS_M, check_number
from robosim.support.compiled import compiled
from slam.hull import Hull, Outline
from slam.planning.marching import march
from slam.poses import to_map

#: Headings at which a hull with an outline is placed.
HEADINGS = 72
#: Smaller pieces of floor are nooks between furniture rather than rooms [m2].
ROOM_AREA_M2 = 0.5
#: Cells whose places are computed at once, which bounds memory.
_CELLS_AT_ONCE = 1_000_000
#: Space around the hull that a robot needs to turn on the spot, since it also moves aside a little [m].
TURNING_M = 0.1


@dataclass(frozen=True)
class CutOff:
    """A piece of floor that the hull cannot reach."""

    area_m2: float
    centre: Float[np.ndarray, "2"]
    """A point of it, as far from its walls as there is, in `map` [m]."""


@dataclass(frozen=True, eq=False)
class Reach:
    """The places of a hull of one radius in one building."""

    plan: FloorPlan
    hull: Hull
    parts: Int[np.ndarray, "ny nx"]
    """0 where the hull's centre cannot be, else the number of the connected part, largest first from 1; floor outside
    of the building does not count."""
    free: shapely.Geometry
    """The floor between the walls, and between what stops the robot, in `map` [m]."""
    outside: Bool[np.ndarray, "ny nx"]
    """Free cells around the building."""
    floor: Bool[np.ndarray, "ny nx"]
    """Free cells on which nothing stops the robot."""
    overhung: Bool[np.ndarray, "ny nx"]
    """Cells of the floor with something above."""

    @property
    def radius_m(self) -> float:
        """Radius of the hull, or half its width [m]."""
        return self.hull.radius_m

    @cached_property
    def n_parts(self) -> int:
        """Count of connected parts."""
        return int(self.parts.max())

    @cached_property
    def indoors(self) -> Bool[np.ndarray, "ny nx"]:
        """Cells where the hull's centre can be within the building; all where it can be nowhere but around it."""
        inside = (self.parts > 0) & ~self.outside
        return inside if inside.any() else self.parts > 0

    @cached_property
    def roomy(self) -> Bool[np.ndarray, "ny nx"]:
        """Cells where the hull's centre can be with room to turn; all where it can be if there are none."""
        cells = self.parts > 0
        wide = _on(self.plan, cells, self.free.buffer(-self.hull.turning_m - TURNING_M))
        return wide if wide.any() else cells

    def check_room(self) -> None:
        """Raise MapError if the hull fits nowhere."""
        if not self.n_parts:
            raise MapError(
                f"{self.plan.name}: a hull of radius {self.radius_m} m fits nowhere. Check the resolution, or choose a "
                "smaller robot."
            )

    def part_at(self, point: Float[np.ndarray, "2"]) -> int:
        """Number of the part that holds a point of `map`, or 0."""
        ix, iy = np.floor(self.plan.to_cells(point)).astype(int)
        ny, nx = self.plan.shape
        return int(self.parts[iy, ix]) if 0 <= iy < ny and 0 <= ix < nx else 0

    def nearest_cell(self, point: Float[np.ndarray, "2"]) -> tuple[tuple[int, int], float]:
        """Row and column of the nearest cell of a part, and its distance from a point [m]; inf if there is no part."""
        return _nearest_cell(self.plan, self.parts > 0, point)

    def part_near(self, point: Float[np.ndarray, "2"], distance_m: float) -> int:
        """Number of the part that comes within a distance of a point, the nearest one, or 0."""
        cell, gap_m = self.nearest_cell(point)
        return int(self.parts[cell]) if gap_m <= distance_m else 0

    def widest(self) -> Float[np.ndarray, "2"]:
        """The place of the largest part that is farthest from its edge, in `map` [m]."""
        self.check_room()
        depth = ndimage.distance_transform_edt(self.parts == 1)
        row, column = np.unravel_index(int(depth.argmax()), depth.shape)
        return self.plan.to_map(np.array([column + 0.5, row + 0.5]))

    def swept(self, component: int) -> Bool[np.ndarray, "ny nx"]:
        """Free cells within the building that some place of the hull within a part covers: the area that it can visit.

        Of a part that is wholly outside, the cells there.
        """
        cell_m = self.plan.resolution_m
        reach_m = self.radius_m + cell_m
        along = np.arange(-int(reach_m / cell_m) - 1, int(reach_m / cell_m) + 2) * 1.0
        disk = (np.hypot(along, along[:, None]) * cell_m <= reach_m).astype(np.uint8)
        covered = (cv2.dilate((self.parts == component).astype(np.uint8), disk) > 0) & self.floor
        inside = covered & ~self.outside
        return inside if inside.any() else covered

    def travel_m(self, point: Float[np.ndarray, "2"]) -> Float[np.ndarray, "ny nx"]:
        """Length of the shortest drive of the hull's centre from a point to each cell [m].

        Infinite where the hull cannot be. A point outside every part counts from the nearest cell of one.
        """
        start, gap_m = self.nearest_cell(point)
        if gap_m == np.inf:
            return np.full(self.plan.shape, np.inf)
        return march(self.parts == self.parts[start], start, self.plan.resolution_m)

    def remaining_m(self, travel: Float[np.ndarray, "ny nx"], point: Float[np.ndarray, "2"]) -> float:
        """Travel at a point between cell centres: the shortest over a cell within two cells of it [m].

        If none of them is reached, in a passage that the sampling has closed, over the nearest one that is.
        """
        column, row = self.plan.to_cells(np.asarray(point, float)) - 0.5
        best = _over_near_cells(travel, float(column), float(row), self.plan.resolution_m)
        if np.isinf(best):
            cell, gap_m = _nearest_cell(self.plan, np.isfinite(travel), point)
            best = float(travel[cell]) + gap_m
        return best

    def cut_off(self, component: int) -> list[CutOff]:
        """Rooms that the hull cannot enter from a part, largest first."""
        # A rim of cells that are not free, so that floor at the plan's edge is as deep as it looks.
        labels, n = ndimage.label(np.pad(self.floor & ~self.outside & ~self.swept(component), 1))
        depth_m = (
            cv2.distanceTransform((labels > 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            * self.plan.resolution_m
        )
        areas = np.bincount(labels.ravel(), minlength=n + 1) * self.plan.resolution_m**2
        # Free floor along the walls is not swept either: only parts with room for the hull count.
        deep = np.nonzero((depth_m > self.radius_m) & (areas >= ROOM_AREA_M2)[labels])
        numbers = np.unique(labels[deep])
        if not len(numbers):
            return []
        rooms = []
        for number, (deepest,) in zip(
            numbers, ndimage.maximum_position(depth_m[deep], labels[deep], numbers), strict=True
        ):
            row, column = (axis[deepest] for axis in deep)
            rooms.append(CutOff(float(areas[number]), self.plan.to_map(np.array([column, row]) - 0.5)))
        return sorted(rooms, key=lambda room: -room.area_m2)


def reach(
    building: Building, radius_m: float, height_m: float | None = None, outline_m: Outline = ()
) -> Reach:
    """Find the places in a building that the middle of a hull's axle can be at.

    Args:
        building: The walls and furnishings.
        radius_m: Radius of the hull, or half its width [m].
        height_m: Height of the robot [m], which drives under higher things; None for that of the ceiling.
        outline_m: Corners of the hull, see `slam.hull`; empty for a disk.
    """
    check_number("radius_m", radius_m, *RADIUS_M)
    plan, free = building.plan, building.floor(building.height_m if height_m is None else height_m)
    hull = Hull(radius_m, outline_m)
    labels = (
        _parts_of_outline(plan, free, hull)
        if outline_m
        else ndimage.label(_on(plan, plan.free, free.buffer(-radius_m)))[0]
    )
    outside = outside_of(plan)
    n = int(labels.max())
    size = np.zeros(n + 1, int)
    for row, is_outside in zip(labels, outside, strict=True):  # whole plans would be copied to long integers
        size += np.bincount(row[~is_outside], minlength=n + 1)
    rank = np.zeros(n + 1, labels.dtype)
    rank[1 + np.argsort(-size[1:], kind="stable")] = np.arange(1, n + 1)
    for row in labels:
        row[:] = rank[row]
    floor, overhung = plan.free, np.zeros(plan.shape, bool)
    if building.furnishings:
        floor, open_above = (_on(plan, plan.free, area) for area in (free, building.floor(building.height_m)))
        overhung = floor & ~open_above
    return Reach(plan, hull, labels, free, outside, floor, overhung)


def _parts_of_outline(plan: FloorPlan, free: shapely.Geometry, hull: Hull) -> Int[np.ndarray, "ny nx"]:
    """Number of the largest part, over places and headings, that each cell belongs to; 0 where the hull cannot be."""
    inner = _on(plan, plan.free, free.buffer(-hull.inner_m))
    open_floor = inner & _on(plan, inner, free.buffer(-hull.turning_m))  # there it fits at every heading
    node, n_open = ndimage.label(open_floor)
    # Pieces are numbered in the order of their first cells.
    starts = np.flatnonzero(np.diff(np.maximum.accumulate(node.ravel()), prepend=0))
    n_cells = np.bincount(node.ravel())
    # Pieces of open floor are nodes of a graph, and each tight cell is one, at each heading.
    is_tight = inner & ~open_floor
    tight, walls = np.flatnonzero(is_tight), wall_segments(free)
    node.ravel()[tight] = np.arange(n_open + 1, n_open + 1 + len(tight))
    n_cells, first = np.append(n_cells, np.ones_like(tight)), np.concatenate([[node.size], starts, tight])
    sides = [(node[1:], node[:-1]), (node[:, 1:], node[:, :-1])]
    edges = np.hstack([np.stack([a[m], b[m]]) for a, b in sides for m in [(a != b) & (a > 0) & (b > 0)]])
    tree = shapely.STRtree(shapely.points(plan.centres(is_tight)))
    fits = np.tile(np.arange(len(first)) > 0, (HEADINGS, 1))
    labels, n = np.zeros(fits.shape, np.int32), 0
    for k, yaw in enumerate(np.arange(HEADINGS) * 2 * np.pi / HEADINGS):
        reversed_outline = -to_map(np.array([0.0, 0.0, yaw]), hull.corners)
        swept = (walls[:, :, None] + reversed_outline).reshape(len(walls), -1, 2)
        meets = tree.query(
            shapely.convex_hull(shapely.multipoints(list(swept))), predicate="contains_properly"
        )[1]
        fits[k, n_open + 1 + meets] = False
        count, label = _components(edges[:, fits[k][edges].all(axis=0)], len(first))
        labels[k], n = label + n, n + count
    # The last heading is next to the first.
    pairs = [np.stack([labels[k], labels[k - 1]])[:, fits[k] & fits[k - 1]] for k in range(HEADINGS)]
    n, component = _components(np.concatenate(pairs, axis=1), n)
    size, begin = np.zeros(n), np.full(n, HEADINGS * node.size)
    for k, label in enumerate(labels):
        size += np.bincount(component[label], fits[k] * n_cells, n)
        np.minimum.at(begin, component[label[fits[k]]], (first + k * node.size)[fits[k]])
    # By falling size, so that the least number of a cell is that of its largest part.
    rank = np.empty(n, np.int32)
    rank[np.lexsort([begin, -size])] = np.arange(1, n + 1)
    number = np.where(fits, rank[component[labels]], n + 1).min(axis=0) % (n + 1)
    for row in node:
        row[:] = number[row]
    return node


def _components(edges: Int[np.ndarray, "2 m"], n: int) -> tuple[int, Int[np.ndarray, " n"]]:
    """Count of connected components of a graph with n nodes, and the component of each."""
    graph = coo_matrix((np.ones(edges.shape[1], bool), edges), shape=(n, n))
    count, component = connected_components(graph, directed=False)
    return int(count), component


@compiled
def _over_near_cells(
    travel: Float[np.ndarray, "ny nx"], column: float, row: float, resolution_m: float
) -> float:
    """Least travel over a cell within two cells of a place, with the distance to its centre [m]."""
    best = math.inf
    iy, ix = round(row), round(column)
    for i in range(max(iy - 2, 0), min(iy + 3, travel.shape[0])):
        for j in range(max(ix - 2, 0), min(ix + 3, travel.shape[1])):
            best = min(best, travel[i, j] + math.hypot(i - row, j - column) * resolution_m)
    return best


def _nearest_cell(
    plan: FloorPlan, cells: Bool[np.ndarray, "ny nx"], point: Float[np.ndarray, "2"]
) -> tuple[tuple[int, int], float]:
    """Row and column of the cell of some whose centre is nearest to a point of `map` [m], and the distance [m].

    The distance is infinite if there is no cell.
    """
    column, row = (float(value) for value in plan.to_cells(np.asarray(point, float)) - 0.5)
    around = 2
    while True:
        corner = max(round(row) - around, 0), max(round(column) - around, 0)
        near = cells[
            corner[0] : max(round(row) + around + 1, 0), corner[1] : max(round(column) + around + 1, 0)
        ]
        near_cells = np.argwhere(near) + corner
        gaps = np.hypot(near_cells[:, 0] - row, near_cells[:, 1] - column)
        # A place farther than the window's edge may have a nearer one beyond that edge.
        if near.shape == cells.shape or (len(gaps) and gaps.min() <= around - 1):
            break
        around *= 4
    if not len(gaps):
        return (0, 0), math.inf
    best = int(np.argmin(gaps))
    return (int(near_cells[best, 0]), int(near_cells[best, 1])), float(gaps[best]) * plan.resolution_m


def _on(
    plan: FloorPlan, cells: Bool[np.ndarray, "ny nx"], floor: shapely.Geometry
) -> Bool[np.ndarray, "ny nx"]:
    """Mask of those cells whose centre lies on a floor.

    Only cells near its edge are compared with it, and one of each run of others in a row, which lie on one side.
    """
    edge = np.zeros(plan.shape, np.uint8)
    rings = [
        np.round(256 * (plan.to_cells(shapely.get_coordinates(ring)) - 0.5)).astype(np.int32)
        for ring in shapely.get_rings(shapely.get_parts(floor))
    ]
    cv2.polylines(edge, rings, isClosed=True, color=1, thickness=5, shift=8)
    mask = np.zeros(plan.shape, bool)
    shapely.prepare(floor)
    at_once = 1 + _CELLS_AT_ONCE // plan.shape[1]
    for first in range(0, plan.shape[0], at_once):
        rows = np.s_[first : first + at_once]
        near = edge[rows] > 0
        compared = near.copy()
        compared[:, 0] = True
        compared[:, 1:] |= near[:, :-1]
        compared &= cells[rows] | ~near
        iy, ix = np.nonzero(compared)
        inside = shapely.contains_xy(floor, plan.to_map(np.column_stack([ix, iy + first]) + 0.5))
        # Each cell takes the value of the last one before it that was compared.
        mask[rows] = np.append(inside, False)[np.cumsum(compared).reshape(near.shape) - 1] & cells[rows]
    return mask
