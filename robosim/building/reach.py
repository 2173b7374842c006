"""Places that a robot's hull can reach, the distances to drive, and rooms that it cannot enter.

The hull is a disk: its centre may be on the free floor shrunk by the hull's radius. That set is sampled at the centres
of the plan's cells, and the hull can drive within its 4-connected parts.
Distances are travel times of a front that moves at unit speed from a cell through such a part (fast
marching, exact to a fraction of a cell). Left out: turning, and passages narrower than a cell beyond the
hull, which the sampling may close.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from robosim.building.building import Building
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.outside import outside_of
from robosim.support.checks import RADIUS_M, check_number
from robosim_support.compiled import compiled
from slam.planning.marching import march

#: Smaller pieces of floor are nooks between furniture rather than rooms [m2].
ROOM_AREA_M2 = 0.5
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
    radius_m: float
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
    """Those of them with something above."""

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
        wide = np.zeros(self.plan.shape, bool)
        cells = self.parts > 0
        wide[cells] = _within(self.free, self.radius_m + TURNING_M, self.plan.centres(cells))
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

    def part_near(self, point: Float[np.ndarray, "2"], distance_m: float) -> int:
        """Number of the part that comes within a distance of a point, the nearest one, or 0."""
        centres = self.plan.centres(self.parts > 0)
        if not len(centres):
            return 0
        gap = np.hypot(*(centres - point).T)
        nearest = int(np.argmin(gap))
        return int(self.parts[self.parts > 0][nearest]) if gap[nearest] <= distance_m else 0

    def widest(self) -> Float[np.ndarray, "2"]:
        """The place of the largest part that is farthest from its edge, in `map` [m]."""
        self.check_room()
        depth = ndimage.distance_transform_edt(self.parts == 1)
        row, column = np.unravel_index(int(depth.argmax()), depth.shape)
        return self.plan.to_map(np.array([column + 0.5, row + 0.5]))

    def swept(self, part: int) -> Bool[np.ndarray, "ny nx"]:
        """Free cells within the building that some place of the hull within a part covers: the area that it can visit.

        Of a part that is wholly outside, the cells there.
        """
        gap = ndimage.distance_transform_edt(self.parts != part) * self.plan.resolution_m
        covered = (gap <= self.radius_m + self.plan.resolution_m) & self.floor
        inside = covered & ~self.outside
        return inside if inside.any() else covered

    def travel_m(self, point: Float[np.ndarray, "2"]) -> Float[np.ndarray, "ny nx"]:
        """Length of the shortest drive of the hull's centre from a point to each cell [m].

        Infinite where the hull cannot be. A point outside every part counts from the nearest cell of one.
        """
        cells = np.argwhere(self.parts > 0)
        if not len(cells):
            return np.full(self.plan.shape, np.inf)
        column, row = self.plan.to_cells(np.asarray(point, float)) - 0.5
        start = cells[np.argmin(np.hypot(cells[:, 0] - row, cells[:, 1] - column))]
        inside = self.parts == self.parts[tuple(start)]
        rows, columns = (np.flatnonzero(inside.any(axis)) for axis in (1, 0))
        window = np.s_[
            max(rows[0] - 1, 0) : rows[-1] + 2,
            max(columns[0] - 1, 0) : columns[-1] + 2,
        ]
        corner = (window[0].start, window[1].start)
        local = (int(start[0] - corner[0]), int(start[1] - corner[1]))
        travel = np.full(self.plan.shape, np.inf)
        travel[window] = march(inside[window].astype(float), local, self.plan.resolution_m)
        return travel

    def remaining_m(self, travel: Float[np.ndarray, "ny nx"], point: Float[np.ndarray, "2"]) -> float:
        """Travel at a point between cell centres: the shortest over a cell within two cells of it [m].

        If none of them is reached, in a passage that the sampling has closed, over the nearest one that is.
        """
        column, row = self.plan.to_cells(np.asarray(point, float)) - 0.5
        best = _over_near_cells(travel, float(column), float(row), self.plan.resolution_m)
        if np.isinf(best) and len(cells := np.argwhere(np.isfinite(travel))):
            gaps = np.hypot(cells[:, 0] - row, cells[:, 1] - column)
            nearest = int(np.argmin(gaps))
            best = float(travel[tuple(cells[nearest])] + gaps[nearest] * self.plan.resolution_m)
        return best

    def cut_off(self, part: int) -> list[CutOff]:
        """Rooms that the hull cannot enter from a part, largest first."""
        # A rim of cells that are not free, so that floor at the plan's edge is as deep as it looks.
        labels, n = ndimage.label(np.pad(self.floor & ~self.outside & ~self.swept(part), 1))
        numbers = np.arange(1, n + 1)
        depth_m = ndimage.distance_transform_edt(labels > 0) * self.plan.resolution_m
        areas = np.bincount(labels.ravel(), minlength=n + 1)[1:] * self.plan.resolution_m**2
        rooms = []
        for area, deepest in zip(areas, ndimage.maximum_position(depth_m, labels, numbers), strict=True):
            # Free floor along the walls is not swept either: only parts with room for the hull count.
            if area >= ROOM_AREA_M2 and depth_m[deepest] > self.radius_m:
                rooms.append(CutOff(float(area), self.plan.to_map(np.array(deepest[::-1]) - 0.5)))
        return sorted(rooms, key=lambda room: -room.area_m2)


def reach(building: Building, radius_m: float, height_m: float | None = None) -> Reach:
    """Where the centre of a disk-shaped hull can be in a building.

    Args:
        building: The walls and furnishings.
        radius_m: Radius of the hull [m].
        height_m: Height of the robot [m], which drives under higher things; None for that of the ceiling.
    """
    check_number("radius_m", radius_m, *RADIUS_M)
    plan, free = building.plan, building.floor(building.height_m if height_m is None else height_m)
    inside = np.zeros(plan.shape, bool)
    inside[plan.free] = _within(free, radius_m, plan.centres(plan.free))
    labels, n = ndimage.label(inside)
    outside = outside_of(plan)
    size = np.bincount(labels[~outside], minlength=n + 1)[1:]
    rank = np.zeros(n + 1, int)
    rank[1 + np.argsort(-size, kind="stable")] = np.arange(1, n + 1)
    floor, overhung = plan.free, np.zeros(plan.shape, bool)
    if building.furnishings:
        floor, open_above = (_contains(plan, one) for one in (free, building.floor(building.height_m)))
        overhung = floor & ~open_above
    return Reach(plan, radius_m, rank[labels], free, outside, floor, overhung)


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


def _contains(plan: FloorPlan, floor: shapely.Geometry) -> Bool[np.ndarray, "ny nx"]:
    """Free cells whose centre is on some floor."""
    cells = plan.free.copy()
    shapely.prepare(floor)
    cells[cells] = shapely.contains_xy(floor, plan.centres(cells))
    return cells


def _within(
    free: shapely.Geometry, margin_m: float, points: Float[np.ndarray, "n 2"]
) -> Bool[np.ndarray, " n"]:
    """Which points lie in free space and farther than a margin from its edge."""
    places = free.buffer(-margin_m)
    shapely.prepare(places)
    return np.asarray(shapely.contains_xy(places, points))
