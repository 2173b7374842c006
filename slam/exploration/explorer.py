"""Frontier exploration: one frontier after another, until nothing is left to see.

One travel-time field from the robot gives the costs of the paths to all frontiers. "nearest", the baseline, chooses the
frontier with the cheapest path. The other ratings count decisions (turns of 10 degrees and steps of a quarter metre
along the path) for the most promising frontiers: "cheapest" chooses the fewest decisions, "gain" weighs the unseen area
behind against decisions, "tour" chooses the first frontier of the best order of visits, "learned" uses a network. A
goal stays until its frontier has been seen or another one is clearly better. Frontiers that another robot of a team
reaches sooner are left to it. A frontier that remains although the robot
stands before it, or that is not reached within its budget of decisions, is given up.
Reference: Yamauchi, A frontier-based approach for autonomous exploration, CIRA 1997.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from robosim.support.checks import Range, checked
from slam.actions import FORWARD_M, TURN_RAD
from slam.exploration.choosing import Offer, describe
from slam.exploration.claims import unclaimed
from slam.exploration.frontiers import Frontier, find_frontiers, unseen_area
from slam.exploration.tour import costs_between, shared_areas, values_of_orders
from slam.grid import MapEstimate
from slam.planning.cost_map import (
    Box,
    CostConfig,
    cut_box,
    known_box,
    near_box,
    travel_time_from_robot,
)
from slam.planning.paths import downhill, length, taut
from slam.planning.travel_time import TravelTime
from slam.poses import wrap
from slam.robot import Robot

#: Places that are remembered of each kind: given up, left for another goal, looked around at.
MEMORY = 400

#: The robot stands before a frontier that is nearer than this [m], and faces one at a smaller bearing [rad].
_BEFORE_M, _FACING_RAD = 0.6, math.radians(40.0)

#: Least decisions between choices on a large map, and most cells of a map that a tour searches at once: time.
_EVERY_ON_LARGE, _WHOLE_CELLS = 8, 1_000_000
#: Turns assumed between two visits of a tour.
_TURNS_BETWEEN = 6.0
#: Frontiers of a tour that are the nearest; the others promise the most.
_NEAREST = 3

ExplorerName = Literal["nearest", "cheapest", "gain", "tour", "learned"]


@dataclass(frozen=True, kw_only=True)
@checked
class ExplorerConfig:
    """How frontiers are found and rated."""

    rating: ExplorerName = "gain"
    """Criterion: path cost, decisions, unseen area against decisions, an order of visits, or a learned choice."""
    cost: CostConfig = field(default_factory=CostConfig)
    """Cost per metre."""
    view_m: Annotated[float, Range(0.1, 100, "m")] = 3.2
    """Range of the camera that counts as seeing [m]."""
    min_cells: Annotated[int, Range(1, 10_000, "cells")] = 3
    """Shorter frontiers are ignored [cells]."""
    piece_m: Annotated[float, Range(0.05, 100, "m")] = 1.6
    """Longer frontiers are cut into pieces of about this size [m]."""
    depth_m: Annotated[float, Range(0, 100, "m")] = 5.0
    """Depth of unseen space behind a frontier [m]: its length times this bounds the area."""
    gain_weight: Annotated[float, Range(0, 1e6)] = 10.0
    """Decisions that a square metre of unseen area is worth."""
    max_gain_m2: Annotated[float, Range(0, 1e6, "m2")] = 16.0
    """Unseen area above which a frontier gets no better [m^2]."""
    keep: Annotated[float, Range(0, 1e6, "decisions")] = 10.0
    """Decisions by which another frontier must be better before the goal is changed."""
    candidates: Annotated[int, Range(1, 10_000, "frontiers")] = 6
    """Frontiers for which decisions are counted exactly."""
    tour: Annotated[int, Range(1, 12, "frontiers")] = 10
    """Number of frontiers that "tour" compares, whose work grows exponentially."""
    horizon: Annotated[float, Range(1, 1e6, "decisions")] = 60.0
    """Decisions until a visit of a tour by which its gain is worth 1/e."""
    visit: Annotated[float, Range(0, 1e6, "decisions")] = 4.0
    """Decisions of a visit itself, in a tour."""
    turn_weight: Annotated[float, Range(0, 100)] = 1.0
    """Weight of turns; 0 for a robot that sees all around and drives in any direction."""
    every: Annotated[int, Range(1, 1_000_000, "decisions")] = 4
    """Decisions after which frontiers are rated again even if the goal remains valid."""
    near_m: Annotated[float, Range(0, 100, "m")] = 1.4
    """A frontier nearer than this is looked at when the robot faces it [m]; the planner stops before that."""
    patience: Annotated[int, Range(1, 1_000_000, "decisions")] = 12
    """Decisions near a frontier that show nothing new after which it is given up."""


#: Settings on which the features of the shipped learned choice depend.
LEARNED: dict[str, Any] = {"depth_m": 1.5, "max_gain_m2": 5.0, "keep": 4.0, "every": 8}


@runtime_checkable
class Explorer(Protocol):
    """Interface of explorers."""

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The spot to go to, in `map` [m]; None when nothing is left to see."""

    def reset(self) -> None:
        """Forget the last episode; an explorer without memory has nothing to do."""
        return


class FrontierExplorer:
    """Chooses goals one after another until nothing is left to see."""

    def __init__(
        self,
        robot: Robot = Robot(),
        config: ExplorerConfig = ExplorerConfig(),
        choose: Callable[[Float32[np.ndarray, "n k"]], int] | None = None,
    ):
        """Make an explorer.

        Args:
            robot: Its hull.
            config: How frontiers are found and rated.
            choose: Index of the best frontier for the rating "learned", given features of
                `slam.exploration.choosing.describe`.

        Raises:
            ValueError: If `choose` is missing for "learned", or given for another rating.
        """
        if (config.rating == "learned") != (choose is not None):
            raise ValueError(f"rating = {config.rating!r}, expected 'learned' with `choose`, and only then.")
        self.config, self._hull = config, robot.hull
        self._choose_offer = choose
        self.reset()

    def reset(self) -> None:
        """Forget goal and frontiers given up."""
        self._goal: np.ndarray | None = None
        self._given_up: deque[tuple[float, float]] = deque(maxlen=MEMORY)
        self._age = 0
        self._waited = 0
        self._budget = 0.0
        self._budgets: deque[tuple[np.ndarray, float]] = deque(maxlen=MEMORY)
        self._spin = 0
        self._looked_around: deque[np.ndarray] = deque(maxlen=MEMORY)
        self._forgiven_at_m2 = 0.0

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The spot to go to, in `map` [m]; None when nothing is left to see."""
        if self._spin:
            self._spin -= 1
            return estimate.pose[:2]
        self._age += 1
        self._budget -= 1
        every = self.config.every if estimate.size_factor == 1 else max(self.config.every, _EVERY_ON_LARGE)
        if self._goal is None or self._age >= every or not self._worth_it(estimate, self._goal):
            self._goal = self._choose(estimate)
            self._age = 0
        if self._goal is None and self._look_around(estimate):
            return estimate.pose[:2]
        return self._goal

    def _look_around(self, estimate: MapEstimate) -> bool:
        """Turn once round before exploration ends, if not done here before."""
        # A robot that begins in a niche has all that is left to see behind its back. Frontiers that were given up get
        # another chance if more has been seen since the last one.
        here = estimate.pose[:2]
        if any(math.hypot(*(here - place)) < 0.5 for place in self._looked_around):
            return False
        self._looked_around.append(here.copy())
        seen_m2 = np.count_nonzero(estimate.explored) * estimate.frame.resolution_m**2
        if seen_m2 > self._forgiven_at_m2 + 1.0:
            self._forgiven_at_m2 = seen_m2
            self._given_up.clear()
            self._budgets.clear()
        self._spin = round(2 * math.pi / TURN_RAD)
        return True

    def _worth_it(self, estimate: MapEstimate, goal: Float[np.ndarray, "2"]) -> bool:
        """Whether something unseen is left at the goal; gives it up when going there does not help."""
        x, y = goal
        r = 2 * estimate.frame.resolution_m
        rows, columns, _ = estimate.frame.window((x - r, y - r), (x + r, y + r))
        unseen = ~estimate.explored[rows, columns] & (estimate.obstacle_probability[rows, columns] <= 0.5)
        if not unseen.any():
            return False
        if self._looked_at(goal, estimate.pose):
            self._waited += 1
        elif math.hypot(*(goal - estimate.pose[:2])) > self.config.near_m:
            self._waited = 0
        if self._waited > self.config.patience or self._budget < 0:
            self._given_up.append((float(x), float(y)))
            self._waited = 0
            return False
        return True

    def _looked_at(self, goal: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"]) -> bool:
        """Whether the robot stands right before a frontier, or faces it from where it is looked at."""
        x, y = goal - pose[:2]
        away = math.hypot(x, y)
        facing = abs(wrap(math.atan2(y, x) - pose[2])) < _FACING_RAD
        return bool(away < _BEFORE_M or (away < self.config.near_m and facing))

    def _choose(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The goal of the best frontier; if none is reachable, places where the robot was stopped count as free."""
        margin = 2 * estimate.frame.resolution_m
        # On a large map the surroundings are searched first; by a tour, only if there are many cells.
        cells = estimate.obstacle_probability.size
        whole = estimate.size_factor == 1 or (self.config.rating == "tour" and cells <= _WHOLE_CELLS)
        for find_box, bumps in ((near_box, True), (known_box, True), (known_box, False)):
            if find_box is near_box and whole:
                continue
            low, high = find_box(estimate)
            box = cut_box(estimate, low - margin, high + margin, bumps=bumps)
            travel_time = travel_time_from_robot(box, self.config.cost, self._hull, through_unknown=False)
            frontiers = find_frontiers(
                box,
                travel_time,
                min_cells=self.config.min_cells,
                piece_m=self.config.piece_m,
                given_up=np.array(list(self._given_up)).reshape(-1, 2),
            )
            if estimate.claims:
                frontiers = unclaimed(frontiers, estimate.claims, travel_time)
            if frontiers:
                return self._best(box, travel_time, frontiers)
        return None

    def _best(self, box: Box, travel_time: TravelTime, frontiers: list[Frontier]) -> Float[np.ndarray, "2"]:
        """Goal of the frontier with the best rating."""
        promising = sorted(frontiers, key=lambda f: self._guess(f, box.pose))
        number = self.config.candidates
        if self.config.rating == "tour":
            nearest = sorted(frontiers, key=lambda f: f.cost_m)[:_NEAREST]
            promising = [*nearest, *(frontier for frontier in promising if frontier not in nearest)]
            number = self.config.tour
        offers = [self._offer(box, travel_time, frontier) for frontier in promising[:number]]
        if self._choose_offer:
            best = offers[self._choose_offer(describe(offers, box, self.config.view_m))]
        elif self.config.rating == "tour":
            best = self._first_of_tour(box, travel_time, offers)
        else:
            best = min(offers, key=lambda offer: offer.rating)
        goal = best.frontier.goal_xy
        if self._goal is None or math.hypot(*(goal - self._goal)) > 0.5:
            # Otherwise two unreachable goals that alternate would renew each other's budget forever.
            if self._goal is not None:
                self._budgets.append((self._goal, self._budget))
            near = [left for place, left in self._budgets if math.hypot(*(place - goal)) < 0.5]
            self._budget = min([(3 * best.decisions + 40), *near])
            self._waited = 0
        return goal

    def _first_of_tour(self, box: Box, travel_time: TravelTime, offers: list[Offer]) -> Offer:
        """The frontier with which the best order of visits begins."""
        config = self.config
        places = np.array([offer.frontier.near_xy for offer in offers])
        bound = [min(offer.frontier.length_m * config.depth_m, config.max_gain_m2) for offer in offers]
        area = np.minimum(shared_areas(box, places, config.view_m), bound)
        wait = np.array([offer.rating for offer in offers]) + config.visit
        turns = config.turn_weight * _TURNS_BETWEEN
        between = costs_between(travel_time, places) / FORWARD_M + config.visit + turns
        values = values_of_orders(area, np.exp(-wait / config.horizon), np.exp(-between / config.horizon))
        return offers[int(np.argmax(values))]

    def _offer(self, box: Box, travel_time: TravelTime, frontier: Frontier) -> Offer:
        """A frontier with its cost, area and rating."""
        decisions, area, bonus = self._decisions(travel_time, frontier, box.pose), 0.0, self._bonus(frontier)
        rating = frontier.cost_m / FORWARD_M if self.config.rating == "nearest" else decisions
        if self._counts_area:
            area = unseen_area(box, frontier, self.config.view_m, self.config.depth_m)
            rating -= self.config.gain_weight * min(area, self.config.max_gain_m2)
        return Offer(
            frontier=frontier, decisions=decisions, area_m2=area, current=bonus > 0, rating=rating - bonus
        )

    @property
    def _counts_area(self) -> bool:
        return self.config.rating in ("gain", "learned")

    def _guess(self, frontier: Frontier, pose: Float[np.ndarray, "3"]) -> float:
        """Rating without the exact path and the area behind."""
        guess = frontier.cost_m / FORWARD_M - self._bonus(frontier)
        if self.config.rating != "nearest":
            guess += self.config.turn_weight * frontier.turns_from(pose)
        area = min(frontier.length_m * self.config.depth_m, self.config.max_gain_m2)
        if self.config.rating == "tour":
            return -area * math.exp(-guess / self.config.horizon)
        return guess - self.config.gain_weight * area if self._counts_area else guess

    def _bonus(self, frontier: Frontier) -> float:
        """Bonus of the frontier that is the current goal [decisions]."""
        is_current = self._goal is not None and math.hypot(*(frontier.goal_xy - self._goal)) < 0.5
        return self.config.keep if is_current else 0.0

    def _decisions(self, travel_time: TravelTime, frontier: Frontier, pose: Float[np.ndarray, "3"]) -> float:
        """Turns and steps to a frontier; it is seen from half a metre away."""
        iy, ix = travel_time.frame.index(frontier.near_xy)
        corners = taut(downhill(travel_time, (int(iy), int(ix))), travel_time)[::-1]
        corners = np.vstack([pose[:2], corners[1:], frontier.goal_xy])
        legs = np.diff(corners, axis=0)
        legs = legs[np.hypot(*legs.T) > 0.1]
        if not len(legs):
            return 0.0
        yaw = np.concatenate([[pose[2]], np.arctan2(legs[:, 1], legs[:, 0])])
        turns = sum(abs(wrap(float(d))) for d in np.diff(yaw)) / TURN_RAD
        return self.config.turn_weight * turns + max(0.0, length(corners) - 0.5) / FORWARD_M
