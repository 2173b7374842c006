"""Radio, camera and map used jointly: a belief over the target's place decides where to go.

A target seen by the camera is gone to at once. In line of sight the robot follows the arrival: its direction is known
to a degree, where the belief knows the distance to a third only. So it does at first where a strong arrival is of first
order: as long as hardly any wall is known, the belief cannot tell round which of them it came. Else, where the belief
has gathered, it goes there; what the mapper's graph makes of all directions in line of sight, a place with a
covariance, is part of the belief; and where it has not, it goes where it will learn most in the least time: of all
frontiers, to the one from which most of the belief may come in sight, and behind which most of it lies, for each
decision that the way takes.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.policies.arrival import Dwelling, FollowArrival, FollowConfig
from robosim.policies.belief import BeliefConfig, TargetBelief
from robosim.policies.estimates import Estimates
from robosim.policies.prospects import prospects
from robosim.policies.reason import GoalKind, Reason
from robosim.policies.sightlines import in_sight
from robosim.simulator import Observation
from robosim.support.checks import Range, checked
from slam.exploration.explorer import Explorer
from slam.exploration.frontiers import find_frontiers
from slam.grid import MapEstimate
from slam.planning.cost_map import CostConfig, cut_box, known_box
from slam.planning.known_ground import travel_time_from_robot
from slam.poses import to_map
from wireless.paths import LinkState


@dataclass(frozen=True, kw_only=True)
@checked
class FusedConfig:
    """When a belief is acted on, and what a look is worth."""

    belief: BeliefConfig = field(default_factory=BeliefConfig)
    """How the belief is formed."""
    uses_camera: bool = True
    """Whether the target is looked for in pictures."""
    uses_graph: bool = True
    """Whether the mapper is asked where the target stands, by its directions from all poses together."""
    cost: CostConfig = field(default_factory=CostConfig)
    """What a metre costs."""
    in_sight: FollowConfig = field(default_factory=lambda: FollowConfig(every=5))
    """How the arrival is followed in line of sight."""
    at_first: Annotated[int, Range(0, 1_000_000, "decisions")] = 30
    """Decisions from the start in which strong arrivals of first order are followed, until the belief is sure."""
    first_snr_db: Annotated[float, Range(-200, 200, "dB")] = 25.0
    """How strong they have to be."""
    sure: Annotated[float, Range(0, 1)] = 0.3
    """Probability within half a metre of a place from which on the robot goes there."""
    view_m: Annotated[float, Range(0.1, 100, "m")] = 5.0
    """Range around a frontier in which the belief counts [m]."""
    head_start: Annotated[float, Range(0, 1e6, "decisions")] = 10.0
    """Decisions added to each way, so that the nearest frontier is not always the best."""
    keep: Annotated[float, Range(0, 1000)] = 1.3
    """How much better another frontier must be before the goal is changed."""
    every: Annotated[int, Range(1, 1_000_000, "decisions")] = 5
    """Decisions for which a goal is kept, if it is not reached before."""
    candidates: Annotated[int, Range(1, 10_000, "frontiers")] = 12
    """Frontiers that are looked at closely."""
    dwell_steps: Annotated[int, Range(1, 1_000_000, "decisions")] = 40
    """Decisions within `dwell_m` of one place after which a goal is given up."""
    dwell_m: Annotated[float, Range(0, 100, "m")] = 0.5
    """See above [m]."""


class _Rated(NamedTuple):
    """A place to go to, and what it is worth."""

    value: float
    goal_xy: Float[np.ndarray, "2"]
    in_sight: float
    """Probability that the target is seen from there."""
    decisions: float
    """What the way there takes."""


class Fused:
    """Goes where the target is believed to be, or where most is learnt about it."""

    seeks_target, uses_radio = True, True

    def __init__(self, explorer: Explorer, config: FusedConfig | None = None) -> None:
        self.config = config or FusedConfig()
        believed = self.config.belief
        self._believing = believed if self.config.uses_camera else replace(believed, look_m=0.0)
        self.uses_camera = self.config.uses_camera
        self._explorer = explorer
        self._in_sight = FollowArrival((LinkState.LOS,), self.config.in_sight)
        strong = FollowConfig(min_snr_db=self.config.first_snr_db)
        self._at_first = FollowArrival((LinkState.FIRST_ORDER,), strong)
        self._decisions = 0
        self.belief: TargetBelief | None = None
        self.reason: Reason | None = None
        self._mass = math.nan
        self._before = ""
        self._goal: np.ndarray | None = None
        self._age = 0
        self._dwelling = Dwelling(self.config.dwell_steps, self.config.dwell_m)
        self._given_up: list[np.ndarray] = []
        self._seen: np.ndarray | None = None

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """Where the target is, or is believed to be, or where most is learnt about it."""
        estimate, here = estimated.map, estimated.pose[:2]
        if self.belief is None:
            self.belief = TargetBelief(here, self._believing)
        self.belief.add(estimated.require_measurement(), estimate)
        if sensed.target is not None:
            self._seen = to_map(estimate.pose, sensed.target)
        if self._seen is not None:
            self._tell(GoalKind.SEEN, "the camera has seen the target")
            return self._seen
        straight = self._in_sight.goal(estimated.require_measurement(), estimate.pose)
        if straight is not None:
            self._tell(GoalKind.ARRIVAL, "the strongest path comes in line of sight")
            self._goal = None
            return straight
        self._decisions += 1
        if self._decisions <= self.config.at_first and self.belief.peak()[1] < self.config.sure:
            onward = self._at_first.goal(estimated.require_measurement(), estimate.pose)
            if onward is not None:
                self._tell(GoalKind.ARRIVAL, "a strong path of first order, and the belief is not sure yet")
                self._goal = None
                return onward
        self._age += 1
        if self._dwelling.at(here):
            self._give_up()
        reached = self._goal is not None and math.hypot(*(self._goal - here)) < 0.2
        if self._goal is None or reached or self._age >= self.config.every:
            if (
                self.config.uses_graph
                and (found := estimated.locate_transmitters().get("target")) is not None
            ):
                self.belief.locate(found)
            self._before = "the last goal is reached; " if reached else self._before
            self._goal, self._age = self._choose(estimate, self.belief), 0
            self._before = ""
        return self._goal

    def _choose(self, estimate: MapEstimate, belief: TargetBelief) -> Float[np.ndarray, "2"] | None:
        place, mass = belief.peak()
        self._mass = mass
        if mass >= self.config.sure:
            if math.hypot(*(place - estimate.pose[:2])) > 0.2:
                self._tell(GoalKind.BELIEVED, f"{mass:.0%} of the belief lies within 0.5 m of it")
                return place
            belief.rule_out(place, 0.3)
        rated = self._rate(estimate, belief)
        if rated:
            best = max(rated, key=lambda r: r.value)
            told = f"{best.in_sight:.0%} of the belief in sight from it, {best.decisions:.0f} decisions away"
            self._tell(GoalKind.LOOK, f"{told}: best of {len(rated)}")
            return best.goal_xy
        onward = self._explorer.goal(estimate)
        if onward is None:
            self._tell(GoalKind.BELIEVED, "nothing is left to look at")
            return place
        self._tell(GoalKind.EXPLORE, "the belief tells no place to look from")
        return onward

    def _tell(self, kind: GoalKind, because: str) -> None:
        because = f"{self._before}{because}"
        if self.reason is None or (self.reason.kind, self.reason.because) != (kind, because):
            self.reason = Reason(kind=kind, because=because, mass=self._mass)

    def _rate(self, estimate: MapEstimate, belief: TargetBelief) -> list[_Rated]:
        """Places to go to, with the probability in sight from there and behind them for each decision on the way."""
        c = self.config
        low, high = known_box(estimate)
        margin = 2 * estimate.frame.resolution_m
        box = cut_box(estimate, low - margin, high + margin)
        way = travel_time_from_robot(box, self.config.cost)
        given_up = np.array(self._given_up).reshape(-1, 2)
        frontiers = find_frontiers(box, way, min_cells=3, piece_m=1.6, given_up=given_up)
        survey, p, pose = belief.survey(estimate), belief.probability(), estimate.pose
        to_all = survey.leads(pose[:2])
        rated = []
        for one in prospects(
            frontiers, to_all, p, belief.frame, pose, head_start=c.head_start, most=c.candidates
        ):
            if (np.hypot(*(given_up - one.goal_xy).T) < 0.25).any():
                continue
            possibly = in_sight(
                survey.known, one.near_xy, belief.frame, self.config.view_m, through_unknown=True
            )
            share = float(p[possibly].sum())
            value = one.width * (share / (one.decisions + c.head_start) + one.behind)
            if self._goal is not None and math.hypot(*(one.goal_xy - self._goal)) < 0.5:
                value *= self.config.keep
            rated.append(_Rated(value, one.goal_xy, share, one.decisions))
        return rated

    def _give_up(self) -> None:
        """What was expected at the goal is not there, or the way is barred."""
        if self._goal is not None and self.belief is not None:
            self.belief.rule_out(self._goal, 0.6)
            self._given_up.append(self._goal)
            self._before = "the last goal is given up, as the robot dwells; "
        self._goal = None
        self._dwelling.forget()
