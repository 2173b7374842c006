"""The way to a goal on a map that is still growing: fast marching on inflated obstacles.

Every cell has a cost per metre: 1 on open floor, more the nearer to walls (so that ways keep to the middle of doors
where there is room), more where nothing is known, none at all where the hull does not fit. Fast marching gives the
cost of the way to the goal from everywhere; the way itself goes downhill and is then pulled taut into few straight
legs, because a turn of 10 degrees takes a robot as long as a quarter of a metre.

A goal inside an obstacle, or cut off, is replaced by the reachable cell nearest to it. The cost field is kept while
goal and map along the way stay the same.
Reference: Sethian, PNAS 93(4), 1996; Chaplot et al., ICLR 2020, section 4 (planner on a predicted map).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from slam.clearance import Clearance
from slam.grid import GridFrame, MapEstimate
from slam.travel_time import TravelTime, travel_time


@dataclass(frozen=True, kw_only=True)
class PlannerConfig:
    """What a way costs, and how often it is thought over."""

    radius_m: float = 0.10
    """Radius of the hull [m]."""
    slack_m: float = 0.005
    """Space that must be left on each side of the hull [m]."""
    comfort_m: float = 0.12
    """Space on each side above which a wall no longer costs anything [m]."""
    wall_weight: float = 3.0
    """Extra cost per metre with the hull at a wall; falls with the square of the space left."""
    unknown_cost: float = 1.5
    """Cost per metre through unknown cells."""
    margin_m: float = 1.0
    """Unknown border around the known map through which ways may lead [m]."""
    replan_every: int = 8
    """Decisions after which the cost field is computed anew even if nothing is in the way."""
    look_m: float = 3.0
    """Half side of the window around the robot in which obstacles are checked at every decision [m]."""

    def __post_init__(self) -> None:
        if not self.radius_m > 0:
            raise ValueError(f"radius_m = {self.radius_m}, expected a positive radius in metres.")
        if self.unknown_cost < 1 or self.wall_weight < 0:
            raise ValueError(
                f"unknown_cost = {self.unknown_cost}, wall_weight = {self.wall_weight}, expected at least 1 and 0."
            )
        if self.replan_every < 1:
            raise ValueError(f"replan_every = {self.replan_every}, expected at least 1.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A way to a goal."""

    goal_xy: Float[np.ndarray, "2"]
    """Where the way ends [m]: the goal asked for, or the reachable cell nearest to it."""
    short_term_goal: Float[np.ndarray, "2"]
    """End of the first straight leg [m]."""
    path: Float[np.ndarray, "n 2"]
    """Corners of the way (x, y) [m], from the robot to `goal_xy`."""
    length_m: float
    """Length of `path` [m]; inf if there is no way."""
    reachable: bool
    """Whether the goal asked for can be reached as far as is known."""
    field: TravelTime
    """Cost of the way to `goal_xy` from everywhere."""
    clearance: Clearance
    """Distance to obstacles around the robot, as of this decision."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CostMap:
    """Cost per metre of the cells of a window."""

    frame: GridFrame
    """Where the cells lie."""
    cost: Float32[np.ndarray, "ny nx"]
    """Cost per metre, at least 1."""
    passable: Bool[np.ndarray, "ny nx"]
    """Cells where the hull fits."""
    clearance: Clearance
    """Distance to obstacles in the window."""


def known_box(estimate: MapEstimate) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lower-left and upper-right corner (x, y) [m] of the cells of which anything is known."""
    known = estimate.obstacle_probability != 0.5
    ys, xs = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(ys):
        return estimate.pose[:2], estimate.pose[:2]
    corners = np.array([[xs[0], ys[0]], [xs[-1] + 1, ys[-1] + 1]])
    low, high = estimate.frame.to_points(corners)
    return low, high


def cost_map(
    estimate: MapEstimate,
    config: PlannerConfig,
    low_xy: Float[np.ndarray, "2"],
    high_xy: Float[np.ndarray, "2"],
) -> CostMap:
    """What a metre costs in each cell of a box of the map, for the hull.

    Args:
        estimate: Map and pose.
        config: Costs.
        low_xy: Lower-left corner of the box [m].
        high_xy: Upper-right corner of the box [m].
    """
    rows, columns, frame = estimate.frame.window((low_xy[0], low_xy[1]), (high_xy[0], high_xy[1]))
    clearance = Clearance.around(estimate, rows, columns, frame)
    space = clearance.cells() - config.radius_m
    cost = np.ones(frame.shape, np.float32)
    cost[estimate.obstacle_probability[rows, columns] == 0.5] = config.unknown_cost
    tightness = np.clip(1 - space / config.comfort_m, 0, 1)
    cost += config.wall_weight * tightness * tightness
    passable = space >= config.slack_m
    _let_out(passable, space, frame, estimate.pose)
    return CostMap(frame=frame, cost=cost, passable=passable, clearance=clearance)


def _let_out(
    passable: Bool[np.ndarray, "ny nx"],
    space: Float32[np.ndarray, "ny nx"],
    frame: GridFrame,
    pose: Float[np.ndarray, "3"],
) -> None:
    """Where the map says that the robot stands in an obstacle, open the cells around it that have more space."""
    iy, ix = (int(k) for k in frame.index(pose[:2]))
    ny, nx = frame.shape
    if not (0 <= iy < ny and 0 <= ix < nx) or passable[iy, ix]:
        return
    n = 5
    rows, columns = slice(max(iy - n, 0), iy + n + 1), slice(max(ix - n, 0), ix + n + 1)
    passable[rows, columns] |= space[rows, columns] > min(float(space[iy, ix]), -0.02) - 1e-4
    passable[iy, ix] = True


class Planner:
    """Plans at every decision, with as much as possible kept from the last one."""

    def __init__(self, config: PlannerConfig = PlannerConfig()):
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget the last plan."""
        self._asked: Float[np.ndarray, "2"] | None = None
        self._plan: Plan | None = None
        self._age = 0

    def plan(self, estimate: MapEstimate, goal_xy: Float[np.ndarray, "2"]) -> Plan:
        """The way from the robot to a goal.

        Args:
            estimate: Map and pose.
            goal_xy: The goal (x, y) [m] in `map`; need not be free, nor on the map.

        Returns:
            The plan. Where no way leads anywhere, the path stays at the robot and the length is inf.

        Raises:
            ValueError: If the goal is not finite.
        """
        goal_xy = np.asarray(goal_xy, float)
        if not np.isfinite(goal_xy).all():
            raise ValueError(f"goal_xy = {goal_xy}, expected two finite coordinates in metres.")
        self._age += 1
        near = self._around(estimate)
        old = self._plan
        if old is None or self._asked is None or self._must_replan(estimate, goal_xy, old, near):
            field, goal, reachable = self._field(estimate, goal_xy)
            self._asked, self._age = goal_xy.copy(), 0
            path = self._path(estimate.pose[:2], field, goal)
        else:
            field, goal, reachable = old.field, old.goal_xy, old.reachable
            path = self._onward(estimate.pose[:2], old, near)
        step = np.hypot(*np.diff(path, axis=0).T)
        stays = len(path) < 2 and np.hypot(*(goal - estimate.pose[:2])) > 2 * estimate.frame.resolution_m
        self._plan = Plan(
            goal_xy=goal,
            short_term_goal=path[min(1, len(path) - 1)],
            path=path,
            length_m=math.inf if stays else float(step.sum()),
            reachable=reachable and not stays,
            field=field,
            clearance=near,
        )
        return self._plan

    def _around(self, estimate: MapEstimate) -> Clearance:
        x, y, _ = estimate.pose
        r = self.config.look_m
        return Clearance.around(estimate, *estimate.frame.window((x - r, y - r), (x + r, y + r)))

    def _must_replan(
        self, estimate: MapEstimate, goal_xy: Float[np.ndarray, "2"], old: Plan, near: Clearance
    ) -> bool:
        if self._age >= self.config.replan_every or np.hypot(*(goal_xy - self._asked)) > 0.02:
            return True
        if not np.isfinite(old.field.at(estimate.pose[:2])):
            return True
        ahead = _samples(self._onward(estimate.pose[:2], old, near), 0.5 * estimate.frame.resolution_m)[2:]
        return bool((near.at(ahead) < self.config.radius_m - 0.01).any())

    def _field(
        self, estimate: MapEstimate, goal_xy: Float[np.ndarray, "2"]
    ) -> tuple[TravelTime, Float[np.ndarray, "2"], bool]:
        """Cost field of the goal, or of the reachable cell nearest to it; which goal, and whether it is the asked."""
        low, high = known_box(estimate)
        here = estimate.pose[:2]
        low = np.minimum(np.minimum(low, here), goal_xy) - self.config.margin_m
        high = np.maximum(np.maximum(high, here), goal_xy) + self.config.margin_m
        window = cost_map(estimate, self.config, low, high)
        frame = window.frame
        # Fast marching passes between cells that share an edge, so components do as well.
        parts = cv2.connectedComponents(window.passable.astype(np.uint8), connectivity=4)[1]
        iy, ix = _clipped(frame, here)
        reach = parts == parts[iy, ix] if window.passable[iy, ix] else window.passable
        gy, gx = _clipped(frame, goal_xy)
        reachable = bool(reach[gy, gx])
        goal = goal_xy
        if not reachable and reach.any():
            ys, xs = np.nonzero(reach)
            centres = frame.to_points(np.column_stack([xs, ys]) + 0.5)
            k = int(np.argmin(((centres - goal_xy) ** 2).sum(axis=1)))
            gy, gx, goal = int(ys[k]), int(xs[k]), centres[k]
            # Half a cell is no detour: such a goal is reached.
            reachable = bool(np.hypot(*(goal - goal_xy)) < 0.75 * frame.resolution_m)
        return travel_time(frame, window.cost.astype(float), window.passable, (gy, gx)), goal, reachable

    def _path(
        self, here: Float[np.ndarray, "2"], field: TravelTime, goal: Float[np.ndarray, "2"]
    ) -> Float[np.ndarray, "n 2"]:
        cells = _downhill(field, here)
        if not cells:
            return here[None].copy()
        points = field.frame.to_points(np.array(cells) + 0.5)
        points[0] = here
        points[-1] = goal
        return _taut(points, field)

    def _onward(self, here: Float[np.ndarray, "2"], old: Plan, near: Clearance) -> Float[np.ndarray, "n 2"]:
        """What is left of an old path, seen from where the robot is now."""
        path = old.path
        if len(path) < 2:
            return np.vstack([here, path[-1:]])
        start, leg = path[:-1], np.diff(path, axis=0)
        share = ((here - start) * leg).sum(axis=1) / np.maximum((leg * leg).sum(axis=1), 1e-12)
        foot = start + np.clip(share, 0, 1)[:, None] * leg
        k = int(np.argmin(np.hypot(*(foot - here).T)[:3]))
        return np.vstack([here, path[k + 1 :]])


def _clipped(frame: GridFrame, point: Float[np.ndarray, "2"]) -> tuple[int, int]:
    iy, ix = frame.index(point)
    return int(np.clip(iy, 0, frame.shape[0] - 1)), int(np.clip(ix, 0, frame.shape[1] - 1))


def _downhill(field: TravelTime, here: Float[np.ndarray, "2"]) -> list[tuple[int, int]]:
    """Cells (column, row) of steepest descent from a point to the source; empty if there is no way."""
    cost = field.cost_m
    ny, nx = cost.shape
    iy, ix = _clipped(field.frame, here)
    if not math.isfinite(cost[iy, ix]):
        return []
    cells = [(ix, iy)]
    for _ in range(ny * nx):
        value = cost[iy, ix]
        best, step = 0.0, None
        for dx, dy, length in _STEPS:
            jx, jy = ix + dx, iy + dy
            if 0 <= jx < nx and 0 <= jy < ny:
                fall = (value - cost[jy, jx]) / length
                if fall > best:
                    best, step = fall, (jx, jy)
        if step is None:
            break
        ix, iy = step
        cells.append(step)
    return cells


_STEPS = [(dx, dy, math.hypot(dx, dy)) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


def _samples(path: Float[np.ndarray, "n 2"], spacing_m: float) -> Float[np.ndarray, "m 2"]:
    """Points along a path, its corners included, at most `spacing_m` apart."""
    parts = [path[:1]]
    for a, b in zip(path[:-1], path[1:], strict=True):
        n = max(1, math.ceil(math.hypot(b[0] - a[0], b[1] - a[1]) / spacing_m))
        parts.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(parts)


def _taut(points: Float[np.ndarray, "n 2"], field: TravelTime) -> Float[np.ndarray, "m 2"]:
    """Fewest legs: from each corner straight on to the farthest point that costs no more than the way downhill.

    The downhill way on a grid is a staircase some per cent longer than the smooth one, so a leg may cost a
    little more than the field says and still be the better way.
    """
    cost = field.at(points)
    corners, i = [0], 0
    last = len(points) - 1
    while i < last:
        low, high = i + 1, last
        # The farthest visible point by bisection, from a doubling search: visibility is nearly monotone.
        jump = 4
        while i + jump < last and _straight(points[i], points[i + jump], cost[i] - cost[i + jump], field):
            low = i + jump
            jump *= 2
        high = min(i + jump, last)
        if _straight(points[i], points[high], cost[i] - cost[high], field):
            low = high
        while high - low > 1:
            middle = (low + high) // 2
            if _straight(points[i], points[middle], cost[i] - cost[middle], field):
                low = middle
            else:
                high = middle
        corners.append(low)
        i = low
    return points[corners]


def _straight(
    a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"], budget_m: float, field: TravelTime
) -> bool:
    """Whether a straight leg costs no more than the way downhill between its ends, but for the raster."""
    return field.of_leg(a, b) <= 1.03 * budget_m + 0.5 * field.frame.resolution_m
