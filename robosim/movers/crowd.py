"""Movers that several robots meet, each in its turn.

Robots of a world act one after the other, but people walk once in each step, for as long as the longest of the robots'
actions: the first robot that comes to a time lets them walk, and the others meet them where they were at that time. For
people, a robot that acts later goes straight to where its command leads.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.movers.mover import Group, Mover, Surroundings

#: Interval at which poses are stored [s]; linear in between. Time that an action is expected to take [s].
_STEP_S, _ACTION_S = 0.1, 1.0


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
        self.begin_step(0.0, self._robots, self._robots[:, :2])

    def begin_step(
        self, time_s: float, robots: Float[np.ndarray, "robots 3"], goals: Float[np.ndarray, "robots 2"]
    ) -> None:
        """Begin a step at a time, with the robots at poses, and where their commands lead [m].

        What was before is forgotten: robots never come back to it.
        """
        self._robots = np.array(robots, float)
        self._begun_s, self._starts, self._goals = time_s, self._robots[:, :2].copy(), goals
        self._has_acted = np.zeros(len(goals), bool)
        passed = min(math.floor(time_s / _STEP_S) - self._first, len(self._poses) - 1)
        del self._poses[: max(passed, 0)]
        self._first += max(passed, 0)

    def poses(self, time_s: float, number: int, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses as `robosim.movers.mover.Mover` returns them, at the time of the robot of a number."""
        self._robots[number], self._has_acted[number] = robot, True
        while (self._first + len(self._poses) - 1) * _STEP_S < time_s:
            later_s = (self._first + len(self._poses)) * _STEP_S
            share = min((later_s - self._begun_s) / _ACTION_S, 1.0)
            expected = self._starts + share * (self._goals - self._starts)
            self._robots[~self._has_acted, :2] = expected[~self._has_acted]
            self._others[:, :2] = self._robots[1:, :2]
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
