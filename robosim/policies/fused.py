"""The policy `fused`: a belief over the target's position from radio, camera and map decides where to go.

1. A target that the camera sees is approached at once.
2. In line of sight the robot follows the arrival, whose direction is known to a degree; the belief knows the distance
   to a third only. Below 10 GHz the belief decides instead, since paths pass walls. At the start the robot also follows
   strong arrivals of first order: with few known walls the belief cannot decide where such a wave interacted. Of a
   team one robot does.
3. If the belief is concentrated, the robot goes to its peak, unless another of its team seeks the target and is
   nearer. The belief includes the position, with covariance, that the mapper's graph computes from all directions in
   line of sight.
4. Otherwise it goes to the frontier of the region that the best order of all regions begins with (`regions`).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from robosim.policies.arrival import Approach, FollowArrival, FollowConfig, StuckDetector
from robosim.policies.belief import BeliefConfig, TargetBelief
from robosim.policies.estimates import Estimates
from robosim.policies.reason import GoalKind, Reason
from robosim.policies.regions import FADES_M, Region, find_regions, regions_won, values_first
from robosim.simulator import Observation
from robosim.support.checks import Range, checked
from slam.exploration.explorer import Explorer
from slam.exploration.frontiers import find_frontiers, lines_across
from slam.grid import MapEstimate
from slam.planning.cost_map import CostConfig, cut_box, known_box, travel_time_from_robot
from slam.poses import to_map
from slam.robot import Robot
from wireless.paths import LinkState
from wireless.tracing.tracer import OPAQUE_HZ


@dataclass(frozen=True, kw_only=True)
@checked
class FusedConfig:
    """When the belief decides, and how frontiers are rated."""

    belief: BeliefConfig = field(default_factory=BeliefConfig)
    """The belief."""
    uses_camera: bool = True
    """Whether the camera looks for the target."""
    uses_graph: bool = True
    """Whether the belief includes the position from the mapper's graph."""
    cost: CostConfig = field(default_factory=CostConfig)
    """Cost of routes to frontiers."""
    in_sight: FollowConfig = field(default_factory=lambda: FollowConfig(every=5))
    """How arrivals in line of sight are followed."""
    at_first: Annotated[int, Range(0, 1_000_000, "decisions")] = 30
    """Decisions from the start in which strong arrivals of first order are followed."""
    first_snr_db: Annotated[float, Range(-200, 200, "dB")] = 25.0
    """Their least SNR."""
    sure: Annotated[float, Range(0, 1)] = 0.3
    """Least probability within 0.5 m of the peak for the robot to go there."""
    candidates: Annotated[int, Range(1, 14, "regions")] = 10
    """Number of regions whose orders are compared: the work doubles with each."""
    far: Annotated[float, Range(0, 1e6, "decisions")] = 100.0
    """Decisions added to a region's own where the regions with the most belief per decision are selected."""
    head_start: Annotated[float, Range(0, 1e6, "decisions")] = 10.0
    """Decisions added to each route, so that the nearest region is not always the first."""
    horizon: Annotated[float, Range(1, 1e6, "decisions")] = 400.0
    """Decisions after which a belief that is found is worth less by a factor of e."""
    keep: Annotated[float, Range(0, 1000)] = 1.02
    """Factor by which another order must be better to replace the goal."""
    every: Annotated[int, Range(1, 1_000_000, "decisions")] = 5
    """Decisions after which a goal is reviewed, unless it is reached earlier; on large maps a multiple of it."""
    stuck_steps: Annotated[int, Range(1, 1_000_000, "decisions")] = 40
    """Decisions within `stuck_m` of one place after which a goal is given up."""
    stuck_m: Annotated[float, Range(0, 100, "m")] = 0.5
    """See `stuck_steps` [m]."""
    vain_steps: Annotated[int, Range(1, 1_000_000, "decisions")] = 60
    """Decisions without coming nearer to where the belief is concentrated, after which the target is not there."""


class Fused:
    """Goes to the peak of the belief, or to the regions with the most of it."""

    seeks_target, uses_radio = True, True
    make_belief = TargetBelief

    def __init__(self, explorer: Explorer, config: FusedConfig | None = None, robot: Robot = Robot()) -> None:
        self._hull = robot.hull
        self.config = config or FusedConfig()
        belief = self.config.belief
        self._belief_config = belief if self.config.uses_camera else replace(belief, look_m=0.0)
        self.uses_camera = self.config.uses_camera
        self._explorer = explorer
        # Where walls are passed, an arrival in line of sight may lead into a wall: the belief decides.
        self._trusted = (LinkState.LOS,) if belief.frequency_hz >= OPAQUE_HZ else ()
        self.reset()

    def reset(self) -> None:
        """Forget the last episode."""
        self._explorer.reset()
        self._in_sight = FollowArrival(self._trusted, self.config.in_sight)
        strong = FollowConfig(min_snr_db=self.config.first_snr_db)
        self._at_first = FollowArrival((LinkState.FIRST_ORDER,), strong)
        self._decisions = 0
        self.belief: TargetBelief | None = None
        self.reason: Reason | None = None
        self._mass = math.nan
        self._prefix = ""
        self._goal: np.ndarray | None = None
        self._age = 0
        self._stuck = StuckDetector(self.config.stuck_steps, self.config.stuck_m)
        self._approach = Approach(self.config.vain_steps)
        self._given_up: list[np.ndarray] = []
        self._seen: np.ndarray | None = None

    def observe(self, sensed: Observation, estimated: Estimates) -> TargetBelief:
        """Add what the robot senses to the belief; once per decision, by `goal` unless another policy decides."""
        estimate = estimated.map
        if self.belief is None:
            self.belief = self.make_belief(estimated.pose[:2], self._belief_config)
        self.belief.add(estimated.require_measurement(), estimate)
        for measurement in estimated.received:
            self.belief.add_received(measurement, estimate)
        if sensed.target is not None:
            self._seen = to_map(estimate.pose, sensed.target)
        return self.belief

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """The target, the peak of the belief, or a place to look from."""
        estimate, here = estimated.map, estimated.pose[:2]
        belief = self.observe(sensed, estimated)
        if self._seen is not None:
            self._set_reason(GoalKind.SEEN, "the camera has seen the target")
            return self._seen
        straight = self._in_sight.goal(estimated.require_measurement(), estimate.pose)
        if straight is not None:
            self._set_reason(GoalKind.ARRIVAL, "the strongest path comes in line of sight")
            self._goal = None
            return straight
        self._decisions += 1
        if self._decisions <= self.config.at_first and belief.peak()[1] < self.config.sure:
            onward = self._at_first.goal(estimated.require_measurement(), estimate.pose)
            if onward is not None and not any(claim.to_target for claim in estimate.claims):
                self._set_reason(
                    GoalKind.ARRIVAL, "a strong path of first order, and the belief is not sure yet"
                )
                self._goal = None
                return onward
        self._age += 1
        if self._stuck.is_stuck(here):
            # Give up a goal without a target, or without a passable route.
            if self._goal is not None and self.belief is not None:
                self.belief.rule_out(self._goal, 0.6)
                self._given_up.append(self._goal)
                self._prefix = "the last goal is given up, since the robot is stuck; "
            self._goal = None
            self._stuck.reset()
        reached = self._goal is not None and math.hypot(*(self._goal - here)) < 0.2
        if self._goal is None or reached or self._age >= self.config.every * estimate.size_factor:
            if (
                self.config.uses_graph
                and (transmitter := estimated.locate_transmitters().get("target")) is not None
            ):
                belief.locate(transmitter)
            self._prefix = "the last goal is reached; " if reached else self._prefix
            self._goal, self._age = self._choose(estimate, belief), 0
            self._prefix = ""
        return self._goal

    def _choose(self, estimate: MapEstimate, belief: TargetBelief) -> Float[np.ndarray, "2"] | None:
        place, mass = belief.peak()
        self._mass = mass
        away_m = math.hypot(*(place - estimate.pose[:2]))
        if mass >= self.config.sure and not _is_left(place, estimate):
            if away_m > 0.2 and not self._approach.is_vain(place, away_m, self._decisions):
                self._set_reason(GoalKind.BELIEVED, f"{mass:.0%} of the belief lies within 0.5 m of it")
                return place
            belief.rule_out(place, 0.6 if away_m > 0.2 else 0.3)
        region = self._best_region(estimate, belief)
        if region is not None:
            behind = f"{region.belief:.0%} of the belief is behind it, {region.decisions:.0f} decisions away"
            self._set_reason(GoalKind.LOOK, f"{behind}: first of the best order")
            return region.frontier.goal_xy
        onward = self._explorer.goal(estimate)
        if onward is None:
            self._set_reason(GoalKind.BELIEVED, "nothing is left to look at")
            return place
        self._set_reason(GoalKind.EXPLORE, "there is no place to look from")
        return onward

    def _set_reason(self, kind: GoalKind, because: str) -> None:
        because = f"{self._prefix}{because}"
        if self.reason is None or (self.reason.kind, self.reason.because) != (kind, because):
            self.reason = Reason(kind=kind, because=because, mass=self._mass)

    def _best_region(self, estimate: MapEstimate, belief: TargetBelief) -> Region | None:
        """The region with which the best order of regions begins; None without a frontier."""
        c = self.config
        given_up = np.array(self._given_up).reshape(-1, 2)
        margin = 2 * estimate.frame.resolution_m
        low, high = known_box(estimate)
        box = cut_box(estimate, low - margin, high + margin)
        times = travel_time_from_robot(box, c.cost, self._hull)
        frontiers = [
            frontier
            for frontier in find_frontiers(box, times, min_cells=3, piece_m=1.6, given_up=given_up)
            if not (np.hypot(*(given_up - frontier.goal_xy).T) < 0.25).any()
        ]
        goals_xy = np.array([frontier.goal_xy for frontier in frontiers]).reshape(-1, 2)
        lines_m = lines_across(box, goals_xy, FADES_M[1])
        survey = belief.survey(estimate)
        regions = find_regions(frontiers, lines_m, survey, belief.probability(), estimate.pose)
        regions.sort(key=lambda region: -region.belief / (region.decisions + c.far))
        if estimate.claims and regions:
            regions = regions_won(
                regions[: 2 * c.candidates],
                times,
                estimate.claims,
                head_start=c.head_start,
                horizon=c.horizon,
            )
        del regions[c.candidates :]
        if not regions:
            return None
        values = values_first(regions, times, head_start=c.head_start, horizon=c.horizon)
        if self._goal is not None:
            is_goal = [math.hypot(*(region.frontier.goal_xy - self._goal)) < 0.5 for region in regions]
            values[is_goal] *= c.keep
        return regions[int(np.argmax(values))]


def _is_left(place: Float[np.ndarray, "2"], estimate: MapEstimate) -> bool:
    """Whether a place where the target may be is left to another robot, which seeks the target and is nearer."""
    away_m = math.hypot(*(place - estimate.pose[:2]))
    return any(
        claim.to_target and claim.cost_m + math.hypot(*(claim.xy - place)) < away_m
        for claim in estimate.claims
    )
