"""Cost per metre in each cell of a map, for a robot with a round hull, or for the disk of half a hull's width.

The cost is 1 on open floor, higher near walls (so that paths keep to the middle of doors) and in unknown cells. Cells
where the hull does not fit are impassable. A passage that is one or two centimetres too narrow on the map stays
passable, since walls on the map err by as much: it costs as much as some metres, so that it is tried before a long
detour, until something stops the robot there. A box may reach beyond the map: cells there are unknown.
Reference: the inflation of obstacles of Lu, Hershberger and Smart, Layered costmaps, IROS 2014.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from robosim.support.checks import Range, checked
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull
from slam.planning.clearance import Clearance
from slam.planning.travel_time import TravelTime, travel_time

#: Half side of the box in which frontiers of a large map are searched for first [m].
NEAR_M = 15.0
#: Cost per metre of impassable halved cells; more than any other.
_IMPASSABLE = np.float32(1e6)


@dataclass(frozen=True, kw_only=True)
@checked
class CostConfig:
    """Costs of paths."""

    slack_m: Annotated[float, Range(0, 1, "m")] = 0.005
    """Least space on each side of the hull where something has stopped the robot [m]."""
    overlap_m: Annotated[float, Range(0, 1, "m")] = 0.02
    """How far the hull may reach into obstacles of the map [m]: maps err."""
    comfort_m: Annotated[float, Range(0.001, 10, "m")] = 0.12
    """Space on each side above which a wall costs nothing [m]."""
    wall_weight: Annotated[float, Range(0, 1e4)] = 3.0
    """Extra cost per metre with the hull at a wall; falls with the square of the space left."""
    squeeze_m: Annotated[float, Range(0.001, 1, "m")] = 0.025
    """Space on each side below which passing takes many attempts [m]."""
    squeeze_weight: Annotated[float, Range(0, 1e4)] = 20.0
    """Extra cost per metre with no space left at all; falls linearly with the space left."""
    unknown_cost: Annotated[float, Range(1, 1e4)] = 1.5
    """Cost per metre through unknown cells."""
    anticipated_weight: Annotated[float, Range(0, 1e4)] = 20.0
    """Extra cost per metre through unknown cells where the anticipated map is sure of an obstacle; none where it is
    undecided, linear in between."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CostMap:
    """Cost per metre of the cells of a box."""

    frame: GridFrame
    """Frame of the cells."""
    cost: Float32[np.ndarray, "ny nx"]
    """Cost per metre, at least 1."""
    passable: Bool[np.ndarray, "ny nx"]
    """Cells where the hull fits."""

    def reachable_from(self, start: Float[np.ndarray, "2"]) -> "CostMap":
        """Return these costs, with only the cells passable that are reachable from a point (x, y) [m]."""
        # Fast marching passes between cells that share an edge, so components do as well.
        component = cv2.connectedComponents(self.passable.astype(np.uint8), connectivity=4)[1]
        home = self.cell(start)
        reach = component == component[home] if self.passable[home] else np.zeros_like(self.passable)
        reach[home] = True
        return CostMap(frame=self.frame, cost=self.cost, passable=reach)

    def nearest(self, goal: Float[np.ndarray, "2"]) -> tuple[tuple[int, int], Float[np.ndarray, "2"], float]:
        """The passable cell nearest to a goal.

        Returns:
            Row and column, the point (the goal itself if its cell is passable, else the cell's centre) [m], and
            its distance from the goal [m].

        Raises:
            ValueError: If no cell is passable.
        """
        cell = self.cell(goal)
        iy, ix = self.frame.index(goal)
        if self.passable[cell] and (int(iy), int(ix)) == cell:
            return cell, goal, 0.0
        ys, xs = np.nonzero(self.passable)
        if not len(ys):
            raise ValueError("no cell is passable, expected at least the robot's own: see `reachable_from`.")
        centres = self.frame.to_points(np.column_stack([xs, ys]) + 0.5)
        square = ((centres - goal) ** 2).sum(axis=1)
        k = int(np.argmin(square))
        return (int(ys[k]), int(xs[k])), centres[k], math.sqrt(square[k])

    def halved(self, reach_m: float) -> "CostMap":
        """Return these costs on cells twice as large; a large cell is as good as the best of its four.

        No passage opens through walls if places nearer to them than `reach_m` are impassable: they are thicker than a
        large cell then. If the reach is less than 1.25 cells, cells at a wall may be passable, and these costs are
        returned as they are. Passages too narrow for the hull may be bridged, so remove unreachable cells before.
        """
        if reach_m < 1.25 * self.frame.resolution_m:
            return self
        ny, nx = (n + n % 2 for n in self.frame.shape)
        frame = GridFrame(
            origin_xy=self.frame.origin_xy,
            resolution_m=2 * self.frame.resolution_m,
            shape=(ny // 2, nx // 2),
        )
        cost = np.full((ny, nx), _IMPASSABLE, np.float32)
        np.copyto(cost[: self.frame.shape[0], : self.frame.shape[1]], self.cost, where=self.passable)
        # Two passes over halves are several times as fast as one over two axes of a block.
        rows = np.minimum(cost[::2], cost[1::2])
        best = np.minimum(rows[:, ::2], rows[:, 1::2])
        return CostMap(frame=frame, cost=best, passable=best < _IMPASSABLE)

    def cell(self, point: Float[np.ndarray, "2"]) -> tuple[int, int]:
        """Row and column of the cell that holds a point (x, y) [m], or of the border cell next to it."""
        iy, ix = self.frame.index(point)
        ny, nx = self.frame.shape
        return min(max(int(iy), 0), ny - 1), min(max(int(ix), 0), nx - 1)


def near_box(estimate: MapEstimate) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lower-left and upper-right corner (x, y) [m] of the surroundings of the robot, as far as they are on the map."""
    low, high = estimate.frame.to_points(np.array([[0, 0], estimate.frame.shape[::-1]]))
    return np.maximum(low, estimate.pose[:2] - NEAR_M), np.minimum(high, estimate.pose[:2] + NEAR_M)


def known_box(estimate: MapEstimate) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lower-left and upper-right corner (x, y) [m] of the robot and the known cells."""
    (ny, nx), here = estimate.frame.shape, estimate.pose[:2]
    rows = _known_rows(estimate, slice(0, ny), slice(0, nx), axis=0)
    if rows.stop == 0:
        return here, here
    columns = _known_rows(estimate, rows, slice(0, nx), axis=1)
    low, high = estimate.frame.to_points(np.array([[columns.start, rows.start], [columns.stop, rows.stop]]))
    return np.minimum(low, here), np.maximum(high, here)


def _known_rows(estimate: MapEstimate, rows: slice, columns: slice, axis: int) -> slice:
    """First to last row (axis 0) or column (1) with a known cell in a window; stops at 0 if there is none."""
    window, ends = [rows, columns], []
    whole = range(window[axis].start, window[axis].stop)
    for backward in (False, True):
        # Strips from both ends: in large maps, most cells lie between.
        for k in range(0, len(whole), 64):
            strip = whole[::-1][k : k + 64][::-1] if backward else whole[k : k + 64]
            window[axis] = slice(strip.start, strip.stop)
            known = estimate.obstacle_probability[window[0], window[1]] != 0.5
            hits = np.flatnonzero(known.any(axis=1 - axis))
            if len(hits):
                ends.append(strip[hits[-1]] + 1 if backward else strip[hits[0]])
                break
        else:
            return slice(0, 0)
    return slice(*ends)


@dataclass(frozen=True, kw_only=True, eq=False)
class Box:
    """A box of a map estimate; cells beyond the map are unknown."""

    frame: GridFrame
    """Frame of the cells."""
    probability: Float32[np.ndarray, "ny nx"]
    """Probability of an obstacle; 0.5 in unknown cells."""
    explored: Bool[np.ndarray, "ny nx"]
    """Cells that the camera has seen."""
    anticipated: Float32[np.ndarray, "ny nx"]
    """Predicted probability of an obstacle in unseen cells, if the mapper predicts; else 0.5."""
    obstacle: Bool[np.ndarray, "ny nx"]
    """Cells with an obstacle, or where the robot was stopped."""
    blocked: Bool[np.ndarray, "ny nx"]
    """Cells where the robot was stopped, if these count."""
    offset_m: Float32[np.ndarray, "ny nx 2"] | None
    """Surface inside each obstacle cell, from its centre [m]."""
    pose: Float[np.ndarray, "3"]
    """Pose of the robot: x [m], y [m], yaw [rad]."""


def cut_box(
    estimate: MapEstimate,
    low_xy: Float[np.ndarray, "2"],
    high_xy: Float[np.ndarray, "2"],
    *,
    bumps: bool = True,
) -> Box:
    """A copy of part of a map."""
    whole = estimate.frame
    cells = whole.to_cells(np.array([low_xy, high_xy]))
    # A corner on the lattice, up to rounding, does not add a cell.
    ix0, iy0 = np.floor(cells[0] + 1e-6).astype(int)
    ix1, iy1 = np.maximum(np.ceil(cells[1] - 1e-6).astype(int), (ix0 + 1, iy0 + 1))
    x, y = whole.to_points(np.array([ix0, iy0]))
    frame = GridFrame(
        origin_xy=(float(x), float(y)),
        resolution_m=whole.resolution_m,
        shape=(int(iy1 - iy0), int(ix1 - ix0)),
    )
    y0, y1 = np.clip((iy0, iy1), 0, whole.shape[0])
    x0, x1 = np.clip((ix0, ix1), 0, whole.shape[1])
    here, there = np.s_[y0 - iy0 : y1 - iy0, x0 - ix0 : x1 - ix0], np.s_[y0:y1, x0:x1]
    probability, explored = np.full(frame.shape, 0.5, np.float32), np.zeros(frame.shape, bool)
    probability[here], explored[here] = estimate.obstacle_probability[there], estimate.explored[there]
    anticipated = np.full(frame.shape, 0.5, np.float32)
    if estimate.anticipated_probability is not None:
        anticipated[here] = estimate.anticipated_probability[there]
    obstacle, blocked = probability > 0.5, np.zeros(frame.shape, bool)
    if bumps:
        blocked[here] = estimate.blocked[there]
        obstacle |= blocked
    offset = None
    if estimate.surface_offset_m is not None:
        offset = np.zeros((*frame.shape, 2), np.float32)
        offset[here] = estimate.surface_offset_m[there]
    return Box(
        frame=frame,
        probability=probability,
        explored=explored,
        anticipated=anticipated,
        obstacle=obstacle,
        blocked=blocked,
        offset_m=offset,
        pose=estimate.pose,
    )


def cost_map(box: Box, config: CostConfig, hull: Hull) -> CostMap:
    """Cost per metre in each cell of a box, for a hull: where it cannot turn on the spot, walls cost something."""
    space = Clearance(box.frame, box.obstacle, box.offset_m).cells(hull.radius_m) - hull.radius_m
    comfort_m = config.comfort_m + hull.turning_m - hull.radius_m
    cost = np.ones(box.frame.shape, np.float32)
    unknown = box.probability == 0.5
    doubt = np.clip(2 * box.anticipated[unknown] - 1, 0, 1)
    cost[unknown] = config.unknown_cost + config.anticipated_weight * doubt
    tightness = np.clip(1 - space / comfort_m, 0, 1)
    cost += config.wall_weight * tightness * tightness
    cost += config.squeeze_weight * np.clip(1 - space / config.squeeze_m, 0, 1)
    # In a large cell, the surface may be farther from the centre than a small hull reaches.
    passable = (space >= -config.overlap_m) & ~box.obstacle
    if box.blocked.any():
        # Where the robot was stopped, the hull does not fit in spite of errors of the map.
        n = 2 * math.ceil(hull.radius_m / box.frame.resolution_m) + 1
        disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (n, n))
        tried = cv2.dilate(box.blocked.astype(np.uint8), disk) > 0
        passable &= (space >= config.slack_m) | ~tried
    _let_out(passable, space, box.frame, box.pose)
    return CostMap(frame=box.frame, cost=cost, passable=passable)


def _let_out(
    passable: Bool[np.ndarray, "ny nx"],
    space: Float32[np.ndarray, "ny nx"],
    frame: GridFrame,
    pose: Float[np.ndarray, "3"],
) -> None:
    """If the robot stands too near to obstacles on the map, make cells around with more space passable."""
    iy, ix = (int(k) for k in frame.index(pose[:2]))
    ny, nx = frame.shape
    if not (0 <= iy < ny and 0 <= ix < nx) or passable[iy, ix]:
        return
    n = 5
    rows, columns = slice(max(iy - n, 0), iy + n + 1), slice(max(ix - n, 0), ix + n + 1)
    passable[rows, columns] |= space[rows, columns] > min(float(space[iy, ix]), -0.02) - 1e-4
    passable[iy, ix] = True


def travel_time_from_robot(
    box: Box, config: CostConfig, hull: Hull, *, through_unknown: bool = True
) -> TravelTime:
    """Travel time from the robot to all cells of a box, on larger cells if the hull permits (`CostMap.halved`)."""
    costs = cost_map(box, config, hull)
    if not through_unknown:
        costs = replace(costs, passable=costs.passable & (box.probability < 0.5))
    costs = costs.reachable_from(box.pose[:2]).halved(hull.radius_m - config.overlap_m)
    return travel_time_to(costs, costs.cell(box.pose[:2]))


def travel_time_to(costs: CostMap, cell: tuple[int, int]) -> TravelTime:
    """Travel time from all cells to a cell (row, column)."""
    return travel_time(costs.frame, costs.cost.astype(float), costs.passable, cell)
