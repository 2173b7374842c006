"""The learned search: a recurrent network chooses each action from the sensors, without a planner.

It is trained in generated homes, first by imitation of a guide that knows the route, then by its own arrivals
(`robosim.training.search`). Actions are drawn by the third power of their probabilities, likely ones more often than in
training, so that the robot turns to and fro less; the likeliest action alone could keep it between two doors forever.
The draws are the same in each search, so that a seed determines the episode. Actions that end at an obstacle of the map
are not drawn. `fused`, with the map and the belief of the whole search, decides in place of the network while nothing
is received on a floor larger than the homes of the training, or anywhere it sees little new, and permanently once the
robot stays in one place, or sees nothing new. Without a camera `fused` decides from the start.

The reason of an action is the group of inputs without which it would be least probable, among all groups, by the
network's probabilities with that group set to zero (occlusion; Zeiler and Fergus, Visualizing and understanding
convolutional networks, ECCV 2014). What the memory holds of earlier inputs stays.
"""

import math
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from robosim.policies.arrival import StuckDetector
from robosim.policies.belief import TargetBelief
from robosim.policies.estimates import Estimates
from robosim.policies.fused import Fused
from robosim.policies.goals import PolicyContext
from robosim.policies.reason import GoalKind, Reason
from robosim.policies.search_network import (
    COLUMNS,
    SENSES,
    SearchNetwork,
    SearchSenses,
    action_probabilities,
    draw_actions,
    empty_memory,
    horizon,
    load_search,
)
from robosim.radio.measurement import Measurement
from robosim.simulator import Observation
from robosim.support.installation import shipped_network
from slam.actions import TURN_RAD, Action
from slam.control.guard import Guard
from slam.grid import MapEstimate
from slam.poses import to_map
from slam.robot import Robot
from slam.sensing.background import background
from wireless.paths import LinkState

#: Seed of the draws.
_SEED = 28
#: Actions are drawn by this power of their probabilities.
_POWER = 3.0
#: The robot is stuck within this distance [m] for so many decisions.
_STUCK_M, _STUCK_STEPS = 0.5, 40
#: The robot is also stuck if it has seen less new floor [m2] in so many decisions.
_NEW_M2, _NEW_STEPS = 1.0, 100
#: Decisions without reception from which on the network does not decide until it receives again, if more floor [m2]
#: than this was seen in all, or less in so many decisions.
_OUTAGE_STEPS, _LARGE_M2 = 20, 100.0
_LITTLE_M2, _LITTLE_STEPS = 4.0, 40
#: How far beyond the map `fused` expects the target [m].
_BEYOND_M = 30.0
#: Distance of the goal in the log [m].
_AHEAD_M = 0.5
#: Change of the heading by an action [rad].
_TURNS = {Action.FORWARD: 0.0, Action.LEFT: TURN_RAD, Action.RIGHT: -TURN_RAD}
_WORDS = {Action.FORWARD: "ahead", Action.LEFT: "left", Action.RIGHT: "right"}


class Learned:
    """Chooses actions by a network, and falls back to the goals of `fused` in large buildings, or once it is stuck."""

    seeks_target, uses_radio = True, True

    def __init__(
        self,
        network: SearchNetwork,
        fused: Fused,
        robot: Robot = Robot(),
    ) -> None:
        self._network, self._fused, self._guard = network, fused, Guard(robot)
        column = (np.arange(COLUMNS) + 0.5) / COLUMNS
        self._left = math.tan(math.radians(robot.optics.hfov_deg) / 2) * (1 - 2 * column)
        self.uses_camera = fused.uses_camera
        self.reset()

    def reset(self) -> None:
        """Forget the last episode."""
        self._fused.reset()
        self._senses = SearchSenses()
        self._before = self._memory = empty_memory()
        self._rng = np.random.default_rng(_SEED)
        self._stuck = StuckDetector(_STUCK_STEPS, _STUCK_M)
        self._seen_m2: deque[float] = deque(maxlen=_NEW_STEPS + 1)
        self._action: Action | None = None
        self._reason: Reason | None = None
        self._has_fallen_back = False
        self._outage_steps, self._is_lost = 0, False

    @property
    def belief(self) -> TargetBelief | None:
        """The belief of `fused`, which decides after the fallback only."""
        return self._fused.belief

    @property
    def reason(self) -> Reason | None:
        """The inputs that speak for the action; the reason of `fused` after the fallback."""
        return self._fused.reason if self._has_fallen_back else self._reason

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A point in the direction of the chosen action, for the log; after the fallback the goal of `fused`.

        Raises:
            ValueError: If the robot has no radio.
        """
        estimate = estimated.map
        seen_m2 = int(np.count_nonzero(estimate.explored)) * estimate.frame.resolution_m**2
        if self._has_fallen_back or not sensed.depth.size or self._is_stuck(estimate, seen_m2):
            self._has_fallen_back = True
            self._action = None
            return self._fused.goal(sensed, estimated)
        measured = estimated.require_measurement()
        inputs = self._encode(sensed, estimated, measured)
        if sensed.action is not Action.WAIT:  # after a wait it decides again
            self._before = self._memory
        scores, _, self._memory = self._network(inputs, self._before)
        if measured.state != LinkState.OUTAGE:
            self._outage_steps, self._is_lost = 0, False
        else:
            self._outage_steps += 1
            sees_enough = seen_m2 <= _LARGE_M2 and not self._sees_less(_LITTLE_M2, _LITTLE_STEPS)
            self._is_lost |= self._outage_steps >= _OUTAGE_STEPS and not sees_enough
        if self._is_lost:
            self._action = None
            goal = self._fused.goal(sensed, estimated)
            self._reason = self._fused.reason
            return goal
        belief = self._fused.observe(sensed, estimated)
        bumps = self._guard.bumps(estimate)
        if not bumps.all():
            scores[bumps] = -np.inf
        self._action = Action(int(draw_actions(_POWER * scores[None], self._rng)[0]))
        self._reason = Reason(
            kind=GoalKind.ACTION, because=self._because(inputs, self._before), mass=belief.peak()[1]
        )
        turn = _TURNS[self._action]
        return to_map(estimated.pose, _AHEAD_M * np.array([np.cos(turn), np.sin(turn)]))

    def _encode(
        self, sensed: Observation, estimated: Estimates, measured: Measurement
    ) -> Float32[np.ndarray, " k"]:
        """Inputs of the network."""
        depth_m = sensed.depth
        if estimated.map.moving:  # there were no people in training
            depth_m = background(horizon(depth_m).astype(float), self._left, estimated.map)[None]
        return self._senses.encode(
            depth_m,
            sensed.odometry,
            # In the robot's frame, without the map's error of heading.
            measured.aoa_rad - measured.pose[2],
            measured.snr_db,
            np.nan_to_num(measured.delay_s),
            measured.probability,
            waited=sensed.action is Action.WAIT,
        )

    def _because(self, inputs: Float32[np.ndarray, " k"], memory: Float32[np.ndarray, " m"]) -> str:
        """Return the probability of the action, and the least one without a kind of inputs."""
        assert self._action is not None
        occluded = np.tile(inputs, (1 + len(SENSES), 1))
        for row, group in zip(occluded[1:], SENSES.values(), strict=True):
            row[group] = 0.0
        scores = self._network(occluded, np.tile(memory, (len(occluded), 1))).scores
        with_all, *without = action_probabilities(scores)[:, self._action]
        name, least = min(zip(SENSES, without, strict=True), key=lambda pair: pair[1])
        return f"{_WORDS[self._action]}, {with_all:.0%} likely ({least:.0%} without {name})"

    def _is_stuck(self, estimate: MapEstimate, seen_m2: float) -> bool:
        """Whether the robot stays in one place, or sees nothing new."""
        self._seen_m2.append(seen_m2)
        return self._stuck.is_stuck(estimate.pose[:2]) or self._sees_less(_NEW_M2, _NEW_STEPS)

    def _sees_less(self, new_m2: float, steps: int) -> bool:
        """Whether it has seen less new floor [m2] in so many decisions."""
        return len(self._seen_m2) > steps and self._seen_m2[-1] - self._seen_m2[-1 - steps] < new_m2

    def action(self) -> Action | None:
        """The chosen action; None after the fallback."""
        return self._action


def learned(context: PolicyContext) -> Learned:
    """The policy of the shipped network."""
    return learned_of_file(shipped_network("search"), context)


def learned_of_file(path: Path, context: PolicyContext) -> Learned:
    """The policy of the network in a file."""
    belief = replace(context.fused.belief, silence=True, beyond_m=_BEYOND_M)
    config = replace(context.fused, belief=belief)
    return Learned(load_search(path), Fused(context.explorer, config, context.robot), context.robot)
