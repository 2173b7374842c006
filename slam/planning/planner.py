"""The way to a goal on a map that is still growing: fast marching on inflated obstacles, near and far.

A goal a few metres away is planned for directly, on the map's own cells, in a box around robot and goal, unless the
way found is so long that a better one may lead through elsewhere. Any other goal in two stages. Far: on cells
twice as large, over all that is known and a border of what is not, fast marching prices the way to the goal from
everywhere. Near: on the map's own cells, in a box around the first metres of that way, it does so again, precisely
enough for doors just wider than the hull; what lies behind is taken from the far field. So the price of a plan
depends little on the size of the building. Fields are kept as long as the goal stays and nothing comes in the way.

A goal inside an obstacle, or cut off, is replaced by the reachable cell nearest to it. But first the map is taken less
strictly: a way that stopped the robot once is tried again. Where a goal is only to be looked at, the way ends before
it, with room to turn: a robot that drives into a niche to see its end touches walls as it turns out again.
Reference: Sethian, PNAS 93(4), 1996; Chaplot et al., ICLR 2020, section 4 (planning on a predicted map).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from slam.grid import MapEstimate
from slam.planning.clearance import Clearance
from slam.planning.cost_map import CostConfig, CostMap, cost_map, cut_box, known_box
from slam.planning.known_ground import ways_to
from slam.planning.paths import along, downhill, gone, length, onward, taut
from slam.planning.travel_time import TravelTime
from slam.support.checks import Range, checked

#: A goal that moves by more is another one, to which the coarse cells may know a way again [m].
_SAME_GOAL_M = 0.5


@dataclass(frozen=True, kw_only=True)
@checked
class PlannerConfig:
    """What a way costs, and how often it is thought over."""

    cost: CostConfig = field(default_factory=CostConfig)
    """What a metre costs."""
    border_m: Annotated[float, Range(0, 100, "m")] = 1.0
    """Unknown border around the known map through which ways may lead [m]."""
    direct_m: Annotated[float, Range(0, 1000, "m")] = 4.5
    """Goals nearer than this are planned for directly [m]."""
    near_m: Annotated[tuple[float, float], Range(1, 1000, "m")] = (3.5, 5.5)
    """Between these distances along the way the near field hands over to the far one [m]."""
    near_margin_m: Annotated[float, Range(0.05, 100, "m")] = 1.2
    """Margin of the near field around the way [m]; twice as much around a goal planned for directly."""
    near_every: Annotated[int, Range(1, 1_000_000, "decisions")] = 8
    """Decisions after which the near field is computed anew even if nothing is in the way."""
    far_every: Annotated[int, Range(1, 1_000_000, "decisions")] = 16
    """The same for the far field."""
    look_m: Annotated[float, Range(0.05, 100, "m")] = 3.2
    """Half side of the window around the robot in which obstacles are checked at every decision [m]."""
    max_far_m: Annotated[float, Range(0, 1000, "m")] = 20.0
    """A goal farther outside of the known map is replaced by a point on the way to it [m]; bounds the work."""
    look_from_m: Annotated[float, Range(0, 100, "m")] = 1.0
    """Where it is enough to look at the goal, the way ends at most so far before it [m] ..."""
    look_room_m: Annotated[float, Range(0, 10, "m")] = 0.1
    """... at the first place with this much space beside the hull, to turn in [m]; at the roomiest if there is none."""

    def __post_init__(self) -> None:
        if not self.near_m[0] < self.near_m[1]:
            raise ValueError(f"near_m is {self.near_m}, expected two rising distances.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A way to a goal."""

    asked_xy: Float[np.ndarray, "2"]
    """The goal asked for [m]."""
    goal_xy: Float[np.ndarray, "2"]
    """Where the way ends [m]: the goal asked for, or the reachable spot nearest to it."""
    short_term_goal: Float[np.ndarray, "2"]
    """End of the first straight leg [m]."""
    path: Float[np.ndarray, "n 2"]
    """Corners of the way (x, y) [m], from the robot to `goal_xy`."""
    length_m: float
    """Length of `path` [m]; inf if no way leads there."""
    reachable: bool
    """Whether the goal asked for can be reached as far as is known."""
    field: TravelTime
    """Cost of the way to `goal_xy` from the surroundings of the robot and of the first metres of the way."""
    clearance: Clearance
    """Distance to obstacles around the robot, as of this decision."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Far:
    """Field of a goal over the whole map."""

    asked: Float[np.ndarray, "2"]
    aim: Float[np.ndarray, "2"]
    goal: Float[np.ndarray, "2"]
    window: CostMap
    field: TravelTime


class Planner:
    """Plans at every decision, with as much as possible kept from the last one."""

    def __init__(self, config: PlannerConfig = PlannerConfig()):
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget the last plan."""
        self._far: _Far | None = None
        self._plan: Plan | None = None
        self._hand_over: np.ndarray | None = None
        self._space_m = 0.0
        self._bumps = True
        """Whether places where the robot was stopped are no way."""
        self._far_age = self._near_age = 0
        self._closely = False
        """Whether coarse cells have led this way through a neck that is too narrow."""

    def plan(self, estimate: MapEstimate, goal_xy: Float[np.ndarray, "2"], *, look: bool = False) -> Plan:
        """The way from the robot to a goal.

        Args:
            estimate: Map and pose.
            goal_xy: The goal (x, y) [m] in `map`; need not be free, nor on the map.
            look: Whether it is enough to look at the goal: the path then ends before it where there is room to turn.

        Returns:
            The plan. Where no way leads anywhere, the path stays at the robot and the length is inf.

        Raises:
            ValueError: If the goal is not finite.
        """
        asked = np.asarray(goal_xy, float)
        if not np.isfinite(asked).all():
            raise ValueError(f"goal_xy = {asked}, expected two finite coordinates in metres.")
        self._far_age += 1
        self._near_age += 1
        clearance = self._around(estimate)
        old = self._plan
        gone_m = math.inf if old is None else math.hypot(*(asked - old.asked_xy))
        self._closely &= gone_m < _SAME_GOAL_M
        if old is None or gone_m > 0.02 or self._in_the_way(old, clearance, estimate):
            plan = self._anew(estimate, asked)
        elif self._near_age < self.config.near_every and not self._near_hand_over(estimate):
            plan = replace(old, path=onward(old.path, estimate.pose[:2]), clearance=clearance)
        elif self._far is None or self._far_age >= self.config.far_every:
            plan = self._anew(estimate, asked)
        else:
            plan = self._solve_near(estimate, self._far)
        self._plan = _completed(plan, estimate)
        return self._before_goal(self._plan, estimate) if look else self._plan

    def look_closely(self) -> None:
        """Plan the next way, and those to the same goal that come, on the map's own cells throughout."""
        self._closely = True
        self._near_age, self._far_age = self.config.near_every, self.config.far_every

    def _before_goal(self, plan: Plan, estimate: MapEstimate) -> Plan:
        """The plan with a path that ends where the hull has room to turn, in a straight line before the goal."""
        if plan.length_m > self.config.look_m:
            return plan
        back = along(plan.path[::-1], estimate.frame.resolution_m, self.config.look_from_m)
        before_m = gone(back)
        bent = np.hypot(*(back - back[0]).T) < 0.95 * before_m
        straight = back[: int(np.argmax(bent))] if bent.any() else back
        room = plan.clearance.at(straight) - self.config.cost.radius_m
        k = int(np.argmax(np.minimum(room, self.config.look_room_m)))
        corners_m = gone(plan.path)
        path = np.vstack([plan.path[corners_m < corners_m[-1] - before_m[k]], back[k]])
        return _completed(replace(plan, path=path), estimate)

    def _around(self, estimate: MapEstimate) -> Clearance:
        return Clearance.around(estimate, self.config.look_m, bumps=self._bumps)

    def _in_the_way(self, plan: Plan, clearance: Clearance, estimate: MapEstimate) -> bool:
        """Whether something has come up on the way since it was planned, or the robot has left the field."""
        here = estimate.pose[:2]
        if math.isinf(float(plan.field.at(here))):
            return True
        limit = min(self.config.cost.radius_m - 0.01, self._space_m - 0.015)
        return self._least_space(onward(plan.path, here), clearance) < limit

    def _least_space(self, path: Float[np.ndarray, "n 2"], clearance: Clearance) -> float:
        """Smallest distance from the next metres of a path to an obstacle [m], the robot's own place left out."""
        ahead = along(path, 0.04, self.config.look_m)[3:]
        return float(clearance.at(ahead).min(initial=1.0))

    def _near_hand_over(self, estimate: MapEstimate) -> bool:
        if self._hand_over is None:
            return False
        return math.hypot(*(self._hand_over - estimate.pose[:2])) < 0.4 * self.config.near_m[0]

    def _anew(self, estimate: MapEstimate, asked: Float[np.ndarray, "2"]) -> Plan:
        """A plan for a goal with nothing kept."""
        self._far_age = self._near_age = 0
        self._bumps, self._far, self._hand_over = True, None, None
        direct = self._solve_directly(estimate, asked)
        if direct is not None:
            return direct
        self._far = self._solve_far(estimate, asked)
        return self._solve_near(estimate, self._far)

    def _costs(
        self, estimate: MapEstimate, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]
    ) -> CostMap:
        """Costs of a box, of what can be reached in it."""
        costs = cost_map(cut_box(estimate, low, high, bumps=self._bumps), self.config.cost)
        return costs.reachable_from(estimate.pose[:2])

    def _solve_directly(self, estimate: MapEstimate, asked: Float[np.ndarray, "2"]) -> Plan | None:
        """Plan for a goal near by; None if a better way may lead through elsewhere."""
        here, margin = estimate.pose[:2], 2 * self.config.near_margin_m
        distance = math.hypot(*(asked - here))
        if distance > self.config.direct_m:
            return None
        window = self._costs(estimate, np.minimum(here, asked) - margin, np.maximum(here, asked) + margin)
        cell, goal, gap_m = window.nearest(asked)
        if gap_m > self.config.cost.radius_m + estimate.frame.resolution_m:
            return None
        field = ways_to(window, cell)
        # A way through elsewhere goes out of the box and back.
        if not float(field.at(here)) < distance + margin:
            return None
        path = _ends(taut(downhill(field, window.cell(here)), field), here, goal)
        return self._made(estimate, asked, goal, path, field)

    def _solve_far(self, estimate: MapEstimate, asked: Float[np.ndarray, "2"]) -> _Far:
        """Field of the goal, or of the reachable spot nearest to it, over the whole map."""
        low, high = known_box(estimate)
        reach = self.config.max_far_m
        aim = np.clip(asked, low - reach, high + reach)
        low, high = np.minimum(low, aim) - self.config.border_m, np.maximum(high, aim) + self.config.border_m
        for self._bumps in (True, False):
            costs = self._costs(estimate, low, high)
            _, goal, gap_m = costs.nearest(aim)
            if gap_m < 0.3:
                break
        window = costs if self._closely else costs.halved()
        return _Far(asked=asked, aim=aim, goal=goal, window=window, field=ways_to(window, window.cell(goal)))

    def _solve_near(self, estimate: MapEstimate, far: _Far) -> Plan:
        """Field and way on the map's own cells, up to where the far field takes over."""
        self._near_age = 0
        here, margin = estimate.pose[:2], self.config.near_margin_m
        way = downhill(far.field, far.window.cell(here))
        k = self._hand_over_index(way, far)
        whole = k >= len(way) - 1
        target = far.goal if whole else way[k]
        aim = np.clip(far.aim, target - 0.5, target + 0.5) if whole else target
        around = np.vstack([here, target, aim, way[: k + 1]])
        window = self._costs(estimate, around.min(axis=0) - margin, around.max(axis=0) + margin)
        cell, goal, _ = window.nearest(aim)
        if math.hypot(*(goal - target)) > 0.2 and len(way):
            # The coarse cells have seen a way where the hull does not fit: look at everything closely.
            if not self._closely:
                self._closely = True
                self._far = self._solve_far(estimate, far.asked)
                return self._solve_near(estimate, self._far)
            low, high = far.window.frame.to_points(np.array([[0, 0], far.window.frame.shape[::-1]]))
            window, whole = self._costs(estimate, low, high), True
            cell, goal, _ = window.nearest(far.aim)
        near = ways_to(window, cell)
        path = _ends(taut(downhill(near, window.cell(here)), near), here, goal)
        self._hand_over = None if whole else goal
        if not whole:
            near = replace(near, cost_m=near.cost_m + float(far.field.at(way[k])))
            path = np.vstack([path, _ends(taut(way[k:], far.field), goal, far.goal)[1:]])
            goal = far.goal
        return self._made(estimate, far.asked, goal, path, near)

    def _made(
        self,
        estimate: MapEstimate,
        asked: Float[np.ndarray, "2"],
        goal: Float[np.ndarray, "2"],
        path: Float[np.ndarray, "n 2"],
        near: TravelTime,
    ) -> Plan:
        clearance = self._around(estimate)
        self._space_m = self._least_space(path, clearance)
        return Plan(
            asked_xy=asked.copy(),
            goal_xy=goal,
            short_term_goal=goal,
            path=path,
            length_m=0.0,
            reachable=math.hypot(*(goal - asked)) < 0.1,
            field=near,
            clearance=clearance,
        )

    def _hand_over_index(self, way: Float[np.ndarray, "n 2"], far: _Far) -> int:
        """Which point of the far way the near field leads to: the roomiest within a range of distances."""
        if len(way) < 2:
            return max(len(way) - 1, 0)
        at_m = gone(way)
        if at_m[-1] < self.config.near_m[1]:
            return len(way) - 1
        range_ = np.flatnonzero((at_m >= self.config.near_m[0]) & (at_m <= self.config.near_m[1]))
        iy, ix = far.window.frame.index(way[range_])
        return int(range_[int(np.argmin(far.window.cost[iy, ix]))])


def _completed(plan: Plan, estimate: MapEstimate) -> Plan:
    """The plan with what follows from its path."""
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
