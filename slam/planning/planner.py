"""Path planning on a growing map: fast marching on inflated obstacles, in a near and a far field.

A goal a few metres away is planned for directly, on the map's own cells, in a box around robot and goal, unless the
path found is so long that a better one may lead outside the box. Any other goal is planned for in two stages. Far: on
cells twice as large if the hull permits (`CostMap.halved`), over the known map and an unknown border, fast marching
computes the cost to the goal from every cell. Near: on the map's own cells, in a box around the first metres of the far
path, it does so again, precisely enough for doors just wider than the hull; costs beyond come from the far field. The
cost of planning therefore depends little on the size of the building. Fields are reused while the goal stays and the
path stays free.

A goal inside an obstacle, or cut off, is replaced by the reachable cell nearest to it, but only after a second attempt
in which places where the robot was stopped count as free. Where it is enough to look at a goal, the path ends before
it, with room to turn: a robot that drives into a niche touches the walls as it turns out again.
Reference: Sethian, PNAS 93(4), 1996; Chaplot et al., ICLR 2020, section 4 (planning on a predicted map).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from robosim.support.checks import Range, checked
from robosim.support.compiled import delayed_signals
from slam.grid import MapEstimate
from slam.planning.clearance import Clearance
from slam.planning.cost_map import CostConfig, CostMap, cost_map, cut_box, known_box, travel_time_to
from slam.planning.paths import along, arc_length, downhill, length, onward, taut
from slam.planning.travel_time import TravelTime
from slam.robot import Robot

#: A goal that shifts by more is a new goal, for which coarse cells are tried again [m].
_SAME_GOAL_M = 0.5


@dataclass(frozen=True, kw_only=True)
@checked
class PlannerConfig:
    """Costs of paths, and how often a path is planned again."""

    cost: CostConfig = field(default_factory=CostConfig)
    """Cost per metre."""
    border_m: Annotated[float, Range(0, 100, "m")] = 1.0
    """Unknown border around the known map through which paths may lead [m]."""
    direct_m: Annotated[float, Range(0, 1000, "m")] = 4.5
    """Goals nearer than this are planned for directly [m]."""
    near_m: Annotated[tuple[float, float], Range(1, 1000, "m")] = (3.5, 5.5)
    """Range of distances along the path at which the near field ends and the far field begins [m]."""
    near_margin_m: Annotated[float, Range(0.05, 100, "m")] = 1.2
    """Margin of the near field around the path [m]; twice as much around a goal planned for directly."""
    far_margin_m: Annotated[float, Range(1, 1000, "m")] = 10.0
    """Margin of the far field of a large map around robot and goal, if no better path can lead outside [m]."""
    near_every: Annotated[int, Range(1, 1_000_000, "decisions")] = 8
    """Decisions after which the near field is computed again even if the path is free."""
    far_every: Annotated[int, Range(1, 1_000_000, "decisions")] = 16
    """Decisions after which the far field is computed again even if the path is free."""
    look_m: Annotated[float, Range(0.05, 100, "m")] = 3.2
    """Half side of the window around the robot in which obstacles are checked at every decision [m]."""
    max_far_m: Annotated[float, Range(0, 1000, "m")] = 20.0
    """A goal farther outside of the known map is clipped to this distance [m]; bounds the work."""
    look_from_m: Annotated[float, Range(0, 100, "m")] = 1.0
    """Where it is enough to look at the goal, the path ends at most this far before it [m] ..."""
    look_room_m: Annotated[float, Range(0, 10, "m")] = 0.1
    """... at the first place with this much space around the hull to turn in [m], or at the place with most space."""

    def __post_init__(self) -> None:
        if not self.near_m[0] < self.near_m[1]:
            raise ValueError(f"near_m is {self.near_m}, expected two rising distances.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A path to a goal."""

    asked_xy: Float[np.ndarray, "2"]
    """The requested goal [m]."""
    goal_xy: Float[np.ndarray, "2"]
    """End of the path [m]: the requested goal, or the reachable point nearest to it."""
    short_term_goal: Float[np.ndarray, "2"]
    """End of the first straight leg [m]."""
    path: Float[np.ndarray, "n 2"]
    """Corners of the path (x, y) [m], from the robot to `goal_xy`."""
    length_m: float
    """Length of `path` [m]; inf if the goal is unreachable."""
    reachable: bool
    """Whether the requested goal can be reached on the current map."""
    field: TravelTime
    """Cost to `goal_xy` from the surroundings of the robot and of the first metres of the path."""
    clearance: Clearance
    """Distance to obstacles around the robot, as of this decision."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Far:
    """Field of a goal over the whole map."""

    requested: Float[np.ndarray, "2"]
    aim: Float[np.ndarray, "2"]
    goal: Float[np.ndarray, "2"]
    window: CostMap
    field: TravelTime


class Planner:
    """Plans at every decision, and reuses the last plan where possible."""

    def __init__(self, robot: Robot = Robot(), config: PlannerConfig = PlannerConfig()):
        self.config, self._hull = config, robot.hull
        self._look_room_m = config.look_room_m + robot.hull.turning_m - robot.hull.radius_m
        self.reset()

    def reset(self) -> None:
        """Forget the last plan."""
        self._far: _Far | None = None
        self._plan: Plan | None = None
        self._hand_over: np.ndarray | None = None
        self._space_m = 0.0
        self._bumps = True
        """Whether places where the robot was stopped are obstacles."""
        self._far_age = self._near_age = 0
        self._closely = False
        """Whether coarse cells have led to this goal through a passage that is too narrow."""

    @delayed_signals()
    def plan(self, estimate: MapEstimate, goal_xy: Float[np.ndarray, "2"], *, look: bool = False) -> Plan:
        """Plan a path from the robot to a goal.

        Args:
            estimate: Map and pose.
            goal_xy: The goal (x, y) [m] in `map`; need not be free, nor on the map.
            look: Whether it is enough to look at the goal: the path then ends before it where there is room to turn.

        Returns:
            The plan. If nothing is reachable, the path stays at the robot and the length is inf.

        Raises:
            ValueError: If the goal is not finite.
        """
        requested = np.asarray(goal_xy, float)
        if not np.isfinite(requested).all():
            raise ValueError(f"goal_xy = {requested}, expected two finite coordinates in metres.")
        self._far_age += 1
        self._near_age += 1
        clearance = self._around(estimate)
        old = self._plan
        goal_shift_m = math.inf if old is None else math.hypot(*(requested - old.asked_xy))
        self._closely &= goal_shift_m < _SAME_GOAL_M
        if old is None or goal_shift_m > 0.02 or self._is_blocked(old, clearance, estimate):
            plan = self._plan_from_scratch(estimate, requested)
        elif self._near_age < self.config.near_every and not self._near_hand_over(estimate):
            plan = replace(old, path=onward(old.path, estimate.pose[:2]), clearance=clearance)
        elif self._far is None or self._far_age >= self.config.far_every:
            plan = self._plan_from_scratch(estimate, requested)
        else:
            plan = self._solve_near(estimate, self._far)
        self._plan = _completed(plan, estimate)
        return self._before_goal(self._plan, estimate) if look else self._plan

    def look_closely(self) -> None:
        """Plan the next path, and later ones to the same goal, on the map's own cells throughout."""
        self._closely = True
        self._near_age, self._far_age = self.config.near_every, self.config.far_every

    def _before_goal(self, plan: Plan, estimate: MapEstimate) -> Plan:
        """The plan with a path that ends where the hull has room to turn, in a straight line before the goal."""
        if plan.length_m > self.config.look_m:
            return plan
        back = along(plan.path[::-1], estimate.frame.resolution_m, self.config.look_from_m)
        before_m = arc_length(back)
        bent = np.hypot(*(back - back[0]).T) < 0.95 * before_m
        straight = back[: int(np.argmax(bent))] if bent.any() else back
        room = plan.clearance.at(straight) - self._hull.radius_m
        k = int(np.argmax(np.minimum(room, self._look_room_m)))
        corners_m = arc_length(plan.path)
        path = np.vstack([plan.path[corners_m < corners_m[-1] - before_m[k]], back[k]])
        return _completed(replace(plan, path=path), estimate)

    def _around(self, estimate: MapEstimate) -> Clearance:
        return Clearance.around(estimate, self.config.look_m, bumps=self._bumps)

    def _is_blocked(self, plan: Plan, clearance: Clearance, estimate: MapEstimate) -> bool:
        """Whether an obstacle has appeared on the path since it was planned, or the robot has left the field."""
        here = estimate.pose[:2]
        if math.isinf(float(plan.field.at(here))):
            return True
        limit = min(self._hull.radius_m - 0.01, self._space_m - 0.015)
        return self._least_space(onward(plan.path, here), clearance) < limit

    def _least_space(self, path: Float[np.ndarray, "n 2"], clearance: Clearance) -> float:
        """Smallest distance from the next metres of a path to an obstacle [m], the robot's own place left out."""
        ahead = along(path, 0.04, self.config.look_m)[3:]
        return float(clearance.at(ahead).min(initial=1.0))

    def _near_hand_over(self, estimate: MapEstimate) -> bool:
        if self._hand_over is None:
            return False
        return math.hypot(*(self._hand_over - estimate.pose[:2])) < 0.4 * self.config.near_m[0]

    def _plan_from_scratch(self, estimate: MapEstimate, requested: Float[np.ndarray, "2"]) -> Plan:
        """Plan without reuse of previous fields."""
        self._far_age = self._near_age = 0
        self._bumps, self._far, self._hand_over = True, None, None
        direct = self._solve_directly(estimate, requested)
        if direct is not None:
            return direct
        self._far = self._solve_far(estimate, requested)
        return self._solve_near(estimate, self._far)

    def _costs(
        self, estimate: MapEstimate, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]
    ) -> CostMap:
        """Costs of the reachable cells of a box."""
        costs = cost_map(cut_box(estimate, low, high, bumps=self._bumps), self.config.cost, self._hull)
        return costs.reachable_from(estimate.pose[:2])

    def _solve_directly(self, estimate: MapEstimate, requested: Float[np.ndarray, "2"]) -> Plan | None:
        """Plan for a nearby goal; None if a better path may leave the box."""
        here, margin = estimate.pose[:2], 2 * self.config.near_margin_m
        distance = math.hypot(*(requested - here))
        if distance > self.config.direct_m:
            return None
        window = self._costs(
            estimate, np.minimum(here, requested) - margin, np.maximum(here, requested) + margin
        )
        cell, goal, gap_m = window.nearest(requested)
        if gap_m > self._hull.radius_m + estimate.frame.resolution_m:
            return None
        field = travel_time_to(window, cell)
        # A path outside the box leaves it and returns.
        if not float(field.at(here)) < distance + margin:
            return None
        path = _ends(taut(downhill(field, window.cell(here)), field), here, goal)
        return self._make_plan(estimate, requested, goal, path, field)

    def _solve_far(self, estimate: MapEstimate, requested: Float[np.ndarray, "2"]) -> _Far:
        """Field of the goal, or of the reachable spot nearest to it; over the whole map, if that may be necessary."""
        here, margin = estimate.pose[:2], self.config.far_margin_m
        if estimate.size_factor > 1:
            low, high = np.minimum(here, requested) - margin, np.maximum(here, requested) + margin
            far, gap_m = self._solve_box(estimate, requested, requested, low, high)
            # A path outside the box leaves it and returns.
            if gap_m < 0.3 and float(far.field.at(here)) < math.hypot(*(requested - here)) + 2 * margin:
                return far
        low, high = known_box(estimate)
        reach = self.config.max_far_m
        aim = np.clip(requested, low - reach, high + reach)
        low, high = np.minimum(low, aim) - self.config.border_m, np.maximum(high, aim) + self.config.border_m
        return self._solve_box(estimate, requested, aim, low, high)[0]

    def _solve_box(
        self,
        estimate: MapEstimate,
        requested: Float[np.ndarray, "2"],
        aim: Float[np.ndarray, "2"],
        low: Float[np.ndarray, "2"],
        high: Float[np.ndarray, "2"],
    ) -> tuple[_Far, float]:
        """Field of a goal over a box, and how far from the goal it begins [m]."""
        for self._bumps in (True, False):
            costs = self._costs(estimate, low, high)
            _, goal, gap_m = costs.nearest(aim)
            if gap_m < 0.3:
                break
        reach_m = self._hull.radius_m - self.config.cost.overlap_m
        window = costs if self._closely else costs.halved(reach_m)
        field = travel_time_to(window, window.cell(goal))
        return _Far(requested=requested, aim=aim, goal=goal, window=window, field=field), gap_m

    def _solve_near(self, estimate: MapEstimate, far: _Far) -> Plan:
        """Field and path on the map's own cells, up to the start of the far field."""
        self._near_age = 0
        here, margin = estimate.pose[:2], self.config.near_margin_m
        route = downhill(far.field, far.window.cell(here))
        k = self._hand_over_index(route, far)
        whole = k >= len(route) - 1
        target = far.goal if whole else route[k]
        aim = np.clip(far.aim, target - 0.5, target + 0.5) if whole else target
        around = np.vstack([here, target, aim, route[: k + 1]])
        window = self._costs(estimate, around.min(axis=0) - margin, around.max(axis=0) + margin)
        cell, goal, _ = window.nearest(aim)
        if math.hypot(*(goal - target)) > 0.2 and len(route):
            # The coarse cells lead through a place where the hull does not fit: use the map's own cells.
            if not self._closely:
                self._closely = True
                self._far = self._solve_far(estimate, far.requested)
                return self._solve_near(estimate, self._far)
            low, high = far.window.frame.to_points(np.array([[0, 0], far.window.frame.shape[::-1]]))
            window, whole = self._costs(estimate, low, high), True
            cell, goal, _ = window.nearest(far.aim)
        near = travel_time_to(window, cell)
        path = _ends(taut(downhill(near, window.cell(here)), near), here, goal)
        self._hand_over = None if whole else goal
        if not whole:
            near = replace(near, cost_m=near.cost_m + float(far.field.at(route[k])))
            path = np.vstack([path, _ends(taut(route[k:], far.field), goal, far.goal)[1:]])
            goal = far.goal
        return self._make_plan(estimate, far.requested, goal, path, near)

    def _make_plan(
        self,
        estimate: MapEstimate,
        requested: Float[np.ndarray, "2"],
        goal: Float[np.ndarray, "2"],
        path: Float[np.ndarray, "n 2"],
        near: TravelTime,
    ) -> Plan:
        clearance = self._around(estimate)
        self._space_m = self._least_space(path, clearance)
        return Plan(
            asked_xy=requested.copy(),
            goal_xy=goal,
            short_term_goal=goal,
            path=path,
            length_m=0.0,
            reachable=math.hypot(*(goal - requested)) < 0.1,
            field=near,
            clearance=clearance,
        )

    def _hand_over_index(self, route: Float[np.ndarray, "n 2"], far: _Far) -> int:
        """Index of the point of the far path where the near field ends: the cheapest one within `near_m`."""
        if len(route) < 2:
            return max(len(route) - 1, 0)
        at_m = arc_length(route)
        if at_m[-1] < self.config.near_m[1]:
            return len(route) - 1
        range_ = np.flatnonzero((at_m >= self.config.near_m[0]) & (at_m <= self.config.near_m[1]))
        iy, ix = far.window.frame.index(route[range_])
        return int(range_[int(np.argmin(far.window.cost[iy, ix]))])


def _completed(plan: Plan, estimate: MapEstimate) -> Plan:
    """The plan with the values that depend on its path."""
    path, here = plan.path, estimate.pose[:2]
    lost = math.isinf(float(plan.field.at(here))) and math.hypot(*(plan.goal_xy - here)) > 0.1
    return replace(
        plan,
        short_term_goal=path[min(1, len(path) - 1)],
        length_m=math.inf if lost else length(path),
        reachable=plan.reachable and not lost,
    )


def _ends(
    path: Float[np.ndarray, "n 2"], start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "m 2"]:
    """A path over cell centres with its two ends moved to the points meant."""
    if not len(path):
        return start[None].copy()
    return np.vstack([start, path[1:-1], end])
