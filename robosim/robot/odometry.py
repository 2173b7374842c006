"""Noise of a LoCoBot: actuation and odometry.

Active Neural SLAM fitted one distribution per action to a real robot's motions. An *actuation* sample is
the motion itself and takes the place of the nominal one; a *sensor* sample is the odometry's error and is
added to the true motion. Both are x forward [m], y left [m], yaw counter-clockwise [rad] in the robot's
frame before the move. The tables give them as published, but for actuation turned into that frame (it was
stored right- and clockwise-positive, and the simulator's hook negated y and theta).

The published numbers have two probable defects, present in ``variant="published"`` because results were made
with them, undone in ``"corrected"``:
- Heading noise of a step forward is sixty times smaller than that of turns: probably radians were treated
  as degrees.
- Sensor y and theta were not negated as those of actuation were: so the sideways slip of turns, 2 cm, is
  seen by odometry twice, where with the other sign it would not be seen at all.

Left out: covariances and second mixture components, which were not printed with the means and deviations
used here, so components are independent Gaussians; noise of continuous driving, which was not measured. Nor was a step
back: it is a reversed step forward, its means negated. A wait has no noise.
Reference: Chaplot et al., Learning to Explore using Active Neural SLAM, ICLR 2020, section 4.1 and
published models.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

import numpy as np

from robosim.support.checks import Range, checked
from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.poses import Pose

NoiseVariant = Literal["published", "corrected"]

#: What each action is meant to do: dx [m], dy [m], dyaw [rad].
NOMINAL = {
    Action.FORWARD: np.array([FORWARD_M, 0.0, 0.0]),
    Action.LEFT: np.array([0.0, 0.0, TURN_RAD]),
    Action.RIGHT: np.array([0.0, 0.0, -TURN_RAD]),
    Action.BACKWARD: np.array([-FORWARD_M, 0.0, 0.0]),
    Action.WAIT: np.zeros(3),
}

_Table = Mapping[Action, tuple[tuple[float, float, float], tuple[float, float, float]]]

# Means and standard deviations as published: x [cm], y [cm], theta [degrees].
_ACTUATION: _Table = {
    Action.FORWARD: ((24.56, -0.20, -0.009), (0.36, 0.26, 0.007)),
    Action.LEFT: ((-0.15, 1.96, 11.26), (0.20, 0.16, 0.42)),
    Action.RIGHT: ((-0.08, -1.95, -11.09), (0.23, 0.15, 0.48)),
}
_SENSOR: _Table = {
    Action.FORWARD: ((0.14, -0.09, 0.000), (0.27, 0.23, 0.002)),
    Action.LEFT: ((0.20, 1.96, 0.198), (0.14, 0.16, 0.084)),
    Action.RIGHT: ((0.20, -1.94, 0.008), (0.15, 0.15, 0.083)),
}
_TO_SI = np.array([0.01, 0.01, math.radians(1.0)])


@dataclass(frozen=True, kw_only=True)
@checked
class NoiseModel:
    """How a robot's motion and odometry differ from what is asked and done."""

    level: Annotated[float, Range(0, 100, "times the published noise of motion")] = 1.0
    """Scale of all deviations: 0 none, 1 as published."""
    variant: NoiseVariant = "published"
    """Numbers as published, or with their two probable defects undone."""
    exact_odometry: bool = False
    """Whether odometry measures motions exactly; actuation still has noise."""

    def actuation(self, action: Action, rng: np.random.Generator) -> Pose:
        """Motion dx [m], dy [m], dyaw [rad] of an action without obstacles."""
        mean, deviation = self._moments(_ACTUATION, action)
        nominal = NOMINAL[action]
        return nominal + self.level * (mean + deviation * rng.standard_normal(3) - nominal)

    def sense(self, action: Action, true_displacement: Pose, rng: np.random.Generator) -> Pose:
        """What odometry says of a motion dx [m], dy [m], dyaw [rad] that an action led to."""
        mean, deviation = self._moments(_SENSOR, action)
        # Drawn all the same: the motions that follow must not depend on it.
        error = self.level * (mean + deviation * rng.standard_normal(3))
        return true_displacement + (0.0 if self.exact_odometry else error)

    def sensor_bias(self, action: Action) -> Pose:
        """Mean error of `sense` [m, m, rad]: the result of a calibration, which a mapper may subtract."""
        return (0.0 if self.exact_odometry else self.level) * self._moments(_SENSOR, action)[0]

    def sense_motion(self, true_displacement: Pose, rng: np.random.Generator) -> Pose:
        """What odometry says of any motion dx [m], dy [m], dyaw [rad].

        Taken as parts of a step forward and of a turn: means grow with the parts, deviations with the
        roots of the parts, as of independent pieces. Not measured; whole actions have `sense`.
        """
        ahead, turn = true_displacement[0] / FORWARD_M, true_displacement[2] / TURN_RAD
        parts = {Action.FORWARD: ahead, Action.LEFT if turn > 0 else Action.RIGHT: abs(turn)}
        measured = np.array(true_displacement, float)
        for action, fraction in parts.items():
            mean, deviation = self._moments(_SENSOR, action)
            measured += self.level * rng.normal(fraction * mean, math.sqrt(abs(fraction)) * deviation)
        return np.array(true_displacement, float) if self.exact_odometry else measured

    def _moments(self, table: _Table, action: Action) -> tuple[Pose, Pose]:
        """Mean and standard deviation [m, m, rad] of an action in one of the tables."""
        return _moments(self.variant, table is _SENSOR, action)


@cache
def _moments(variant: NoiseVariant, sensed: bool, action: Action) -> tuple[Pose, Pose]:
    if action is Action.WAIT:
        return np.zeros(3), np.zeros(3)
    if action is Action.BACKWARD:
        mean, deviation = _moments(variant, sensed, Action.FORWARD)
        return -mean, deviation
    mean, deviation = (np.array(row) * _TO_SI for row in (_SENSOR if sensed else _ACTUATION)[action])
    if variant == "corrected":
        if action == Action.FORWARD:
            mean[2], deviation[2] = math.degrees(mean[2]), math.degrees(deviation[2])
        if sensed:
            mean[1:] *= -1
    mean.flags.writeable = deviation.flags.writeable = False  # they are the same for all
    return mean, deviation
