"""Movers that several robots meet, each in its turn.

Robots of a world act one after the other, but people walk once in each step, for as long as the longest of the robots'
actions: the first robot that comes to a time lets them walk, and the others meet them where they were at that time. A
robot that acts later stands, for people, where its last action has led it.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.movers.mover import Group, Mover, Surroundings

#: Interval at which poses are stored [s]; linear in between.
_STEP_S = 0.1


class Crowd:
    """Movers, and where they have been since the beginning of the step."""

    def __init__(self, movers: Sequence[Mover], robot_radii_m: Sequence[float]) -> None:
        self._group, self._radii_m = Group(movers), np.array(robot_radii_m)
        self.bodies = self._group.bodies

    def reset(
        self, building: Building, robots: Float[np.ndarray, "robots 3"], rng: np.random.Generator
    ) -> None:
        """Begin at time 0, with the robots at poses x [m], y [m], yaw [rad] in `map`."""
        self._robots = np.array(robots, float)
        self._others = np.column_stack([self._robots[1:, :2], self._radii_m[1:]])
        self._group.reset(Surroundings(building, self._robots[0], float(self._radii_m[0]), self._others), rng)
        self._first, self._poses = 0, [self._group.poses(0.0, self._robots[0])]

    def begin_step(self, time_s: float) -> None:
        """Forget where they were before a time; robots never come back to it."""
        passed = min(math.floor(time_s / _STEP_S) - self._first, len(self._poses) - 1)
        del self._poses[: max(passed, 0)]
        self._first += max(passed, 0)

    def poses(self, time_s: float, number: int, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses as `robosim.movers.mover.Mover` returns them, at the time of the robot of a number."""
        self._robots[number] = robot
        while (self._first + len(self._poses) - 1) * _STEP_S < time_s:
            self._others[:, :2] = self._robots[1:, :2]
            later_s = (self._first + len(self._poses)) * _STEP_S
            self._poses.append(self._group.poses(later_s, self._robots[0]))
        steps = max(time_s / _STEP_S - self._first, 0.0)
        k = min(int(steps), len(self._poses) - 1)
        before, after = self._poses[k], self._poses[min(k + 1, len(self._poses) - 1)]
        return before + (steps - k) * (after - before)


class CrowdAsMet:
    """A crowd as one of the robots meets it (`robosim.movers.mover.Mover`)."""

    def __init__(self, crowd: Crowd, number: int) -> None:
        self._crowd, self._number, self.bodies = crowd, number, crowd.bodies

    def reset(self, surroundings: Surroundings, rng: np.random.Generator) -> None:
        """Stay as the world has begun it."""

    def poses(self, time_s: float, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses at the robot's time."""
        return self._crowd.poses(time_s, self._number, robot)
