"""Moving among people: waiting for those who cross the robot's path, and going around those who stand.

A step is done only if the robot keeps its distance from the predicted places of all tracked things, or moves away from
them; else it waits, and accepts less distance the longer it has waited. It keeps more distance from things that have
just come into view, whose velocity is not known yet. Things that stand are obstacles to planner and explorer.

Another robot is no obstacle where the distance that steps keep from it leaves no room to pass: paths lead on through
its place, and one of the two makes room (`robosim.team.yielding`). A detour would be given up as soon as it
moves. Robots side by side pass each other, although each step may bring them a little nearer.

A base that does not turn about its centre moves as it turns on the spot. Next to another robot, which does not step
aside, it turns to the other side if the turn would bring it too near.

Left out: passing people by a change of speed.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
from jaxtyping import Float

from robosim.support.checks import Range, checked
from slam.actions import MOVES, Action, Command, Velocity
from slam.grid import MapEstimate, MovingThing
from slam.planning.clearance import Clearance
from slam.planning.cost_map import Box, cut_box
from slam.poses import to_map
from slam.robot import Robot

#: Velocities with larger standard deviations are not known yet [m/s].
_UNSURE_MPS = 0.6
#: Half side of the surroundings of another robot in which there must be room to pass it [m], and area of floor that
#: counts [m2].
_AROUND_M, _REGION_M2 = 1.0, 0.05
#: By how much a robot may come nearer to another one as it passes by [m].
_BY_M = 0.03
#: The turn to the other side.
_OTHER_SIDE: dict[Command, Action] = {Action.LEFT: Action.RIGHT, Action.RIGHT: Action.LEFT}


@dataclass(frozen=True, kw_only=True)
@checked
class AvoidanceConfig:
    """Distances from people, and how far ahead they are predicted."""

    body_m: Annotated[float, Range(0.01, 5, "m")] = 0.17
    """Radius of a person [m]."""
    distance_m: Annotated[float, Range(0, 5, "m")] = 0.15
    """Distance that a step keeps between hull and person [m]."""
    squeeze_m: Annotated[float, Range(0, 5, "m")] = 0.05
    """Distance after several waits, for places where there is no more space [m]."""
    robots_m: Annotated[float, Range(0, 5, "m")] = 0.15
    """Distance from a robot after several waits: it does not step aside, and maps drift apart by centimetres [m]."""
    waits: Annotated[int, Range(1, 1000, "waits")] = 2
    """Waits in which the distance falls to `squeeze_m`."""
    deviations: Annotated[float, Range(0, 5)] = 0.5
    """Standard deviations of a velocity that is not known yet, by which the distance grows with time."""
    step_s: Annotated[float, Range(0.01, 60, "s")] = 1.0
    """Time of a step [s]."""
    stood_s: Annotated[float, Range(0, 1000, "s")] = 3.0
    """Things that have stood for longer are obstacles that paths lead around [s]."""
    unseen_s: Annotated[float, Range(0, 1000, "s")] = 2.0
    """Things that were out of sight for longer are no such obstacles [s]."""


class Avoidance:
    """Keeps a robot from running into people."""

    def __init__(self, robot: Robot = Robot(), config: AvoidanceConfig = AvoidanceConfig()) -> None:
        self._hull = robot.hull
        self._swings: dict[Command, np.ndarray] = {
            action: np.array(motion[:2])
            for action, motion in zip(MOVES, robot.motions, strict=True)
            if motion is not None and not action.ahead_m
        }
        self.config = config
        self.waited = 0
        """Waits since the robot was last free to go on."""

    def around(self, estimate: MapEstimate) -> MapEstimate:
        """The map with things that stand as obstacles; the same one if there are none."""
        standing = [
            thing
            for thing in estimate.moving
            if thing.stood_s >= self.config.stood_s and thing.unseen_s <= self.config.unseen_s
        ]
        if not standing:
            return estimate
        probability = estimate.obstacle_probability.copy()
        for thing in standing:
            radius_m = thing.radius_m or self.config.body_m
            rows, columns, covered = estimate.frame.disc(thing.xy, radius_m)
            # Room to pass it as near as `checked` allows.
            if thing.radius_m is None or self._has_room(estimate, thing, radius_m + self.config.robots_m):
                probability[rows, columns][covered] = 1.0
        return replace(estimate, obstacle_probability=probability)

    def _has_room(self, estimate: MapEstimate, thing: MovingThing, radius_m: float) -> bool:
        """Whether a thing of a radius [m] leaves all the floor around it connected, for the hull."""
        box = cut_box(estimate, thing.xy - _AROUND_M, thing.xy + _AROUND_M)
        before = self._count_regions(box)
        rows, columns, covered = box.frame.disc(thing.xy, radius_m)
        box.obstacle[rows, columns][covered] = True
        return self._count_regions(box) <= before

    def _count_regions(self, box: Box) -> int:
        """Number of connected regions of floor in which the hull can stand."""
        space_m = Clearance(box.frame, box.obstacle, box.offset_m).cells(self._hull.radius_m)
        free = (space_m >= self._hull.radius_m).astype(np.uint8)
        areas = cv2.connectedComponentsWithStats(free, connectivity=4)[2][1:, cv2.CC_STAT_AREA]
        return int((areas * box.frame.resolution_m**2 > _REGION_M2).sum())

    def checked(self, estimate: MapEstimate, action: Command) -> Command:
        """The action, or a wait if it would lead too near to a thing; a velocity as the chord of its arc."""
        yaw = float(estimate.pose[2])
        if isinstance(action, Velocity):
            length_m = action.v_mps * self.config.step_s
            yaw += action.w_radps * self.config.step_s / 2
        else:
            length_m = action.ahead_m
        if not estimate.moving:
            return action
        if action in _OTHER_SIDE and self._swings_into(estimate, action):
            other = _OTHER_SIDE[action]
            return Action.WAIT if self._swings_into(estimate, other) else other
        if not length_m:
            return action
        step = length_m * np.array([math.cos(yaw), math.sin(yaw)])
        meets = any(self._meets(estimate, step, thing) for thing in estimate.moving)
        self.waited = self.waited + 1 if meets else 0
        return Action.WAIT if meets else action

    def _swings_into(self, estimate: MapEstimate, action: Command) -> bool:
        """Whether a turn would bring the hull too near to another robot, and nearer than it is."""
        step = to_map(np.array([0.0, 0.0, estimate.pose[2]]), self._swings.get(action, np.zeros(2)))
        robots = (thing for thing in estimate.moving if thing.radius_m is not None)
        return any(self._meets(estimate, step, robot, turns=True) for robot in robots)

    def _meets(
        self, estimate: MapEstimate, step: Float[np.ndarray, "2"], thing: MovingThing, *, turns: bool = False
    ) -> bool:
        """Whether a step comes too near to a thing, and nearer than waiting would."""
        config = self.config
        share = np.linspace(0.25, 1.0, 4)
        share_left = 0.0 if turns else max(1 - self.waited / config.waits, 0.0)
        squeeze_m = config.squeeze_m if thing.radius_m is None or turns else config.robots_m
        distance_m = squeeze_m + share_left * (config.distance_m - squeeze_m)
        least_m = self._hull.turning_m + (thing.radius_m or config.body_m) + distance_m
        std_mps = math.sqrt(np.trace(thing.covariance[2:, 2:]) / 2)
        # The velocity of a person who has just come into view is not known yet.
        unsure_mps = config.deviations * std_mps if thing.unseen_s == 0 and std_mps > _UNSURE_MPS else 0.0
        # A moving thing goes on, or stops at any time.
        for time_s in (share * config.step_s, np.zeros(4)):
            there = thing.xy + time_s[:, None] * thing.velocity
            going_m = np.hypot(*(estimate.pose[:2] + share[:, None] * step - there).T)
            nearest_m = np.hypot(*(estimate.pose[:2] - there).T).min()
            if thing.radius_m is not None:
                nearest_m = min(nearest_m, max(nearest_m - _BY_M, least_m - distance_m + config.squeeze_m))
            if ((going_m < least_m + unsure_mps * time_s) & (going_m < nearest_m)).any():
                return True
        return False
