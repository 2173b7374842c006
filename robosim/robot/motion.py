"""Motions of a robot: goal, profile of speeds, and result.

A move is a displacement in the robot's frame. Along it x, y and yaw advance together, as one fraction
s(t) from 0 to 1: constant acceleration, constant speed, constant deceleration, the fastest motion with
speed and acceleration of the wheels within bounds.
Left out: bounds on jerk.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from slam.poses import Pose, wrap

#: A wall stopped a robot short of its goal if it ends further away than this [m], [rad].
BLOCKED_M, BLOCKED_RAD = 5e-3, math.radians(1.0)


@dataclass(frozen=True, eq=False)
class Motion:
    """Result of a motion."""

    pose: Float[np.ndarray, "3"]
    """Pose x [m], y [m], yaw [rad] in `map` at its end."""
    collided: bool
    """Whether a wall stopped the robot short of its goal."""
    duration_s: float
    """Simulated time it took [s]."""
    penetration_m: float = 0.0
    """How deep the hull was inside of a wall at the worst time [m]."""
    physics_steps: int = 0
    """Steps of the physics engine."""


@runtime_checkable
class Physics(Protocol):
    """Moves a robot in a building."""

    @property
    def pose(self) -> Pose:
        """True pose: x [m], y [m], yaw [rad] in `map`."""

    def reset(self, pose: Pose) -> None:
        """Put the robot at a pose, at rest."""

    def move(self, displacement: Pose) -> Motion:
        """Move by dx [m], dy [m], dyaw [rad] in the robot's frame, as far as walls let it."""

    def drive(self, v_mps: float, w_radps: float, duration_s: float) -> Motion:
        """Drive with a forward speed and a turn rate for a while, as far as walls let it."""

    def clone(self) -> "Physics | None":
        """A second robot, alone in the same building; None if another one has to be made."""
        return None


@dataclass(frozen=True)
class SpeedProfile:
    """A fraction that goes from 0 to 1 in `duration_s`, speeding up and slowing down for `ramp_s` each."""

    duration_s: float
    ramp_s: float

    @classmethod
    def fastest(cls, length_m: float, *, speed_mps: float, accel_mps2: float) -> "SpeedProfile":
        """Profile of the fastest motion along a length, at rest at both ends."""
        ramp_s = min(speed_mps / accel_mps2, math.sqrt(length_m / accel_mps2))
        if ramp_s == 0:
            return cls(0.0, 0.0)
        return cls(length_m / (accel_mps2 * ramp_s) + ramp_s, ramp_s)

    def fraction(self, time_s: float) -> float:
        """Completed fraction of the motion at a time [s] after the start."""
        if time_s >= self.duration_s:
            return 1.0
        if time_s > self.duration_s / 2:
            return 1.0 - self.fraction(self.duration_s - time_s)
        cruise = 1.0 / (self.duration_s - self.ramp_s)
        if time_s >= self.ramp_s:
            return cruise * (time_s - self.ramp_s / 2)
        return 0.5 * cruise * max(time_s, 0.0) ** 2 / self.ramp_s


class PlannedMove:
    """Where a robot should be at each time of a move."""

    def __init__(self, start: tuple[float, float, float], displacement: Pose, profile: SpeedProfile) -> None:
        """Plan a straight motion from a pose by a displacement in the robot's frame (x [m], y [m], yaw [rad])."""
        dx, dy, self.turn_rad = (float(component) for component in displacement)
        c, s = math.cos(start[2]), math.sin(start[2])
        self.start, self.profile = start, profile
        self.shift = (c * dx - s * dy, s * dx + c * dy)

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Pose x [m], y [m], yaw [rad] (not wrapped) at a time [s] after the start."""
        s = self.profile.fraction(time_s)
        x, y, yaw = self.start
        return x + s * self.shift[0], y + s * self.shift[1], yaw + s * self.turn_rad

    def left(self, pose: tuple[float, float, float]) -> tuple[float, float]:
        """Distance [m] and angle [rad] from a pose to the goal."""
        x, y, yaw = self.start
        gap = math.hypot(x + self.shift[0] - pose[0], y + self.shift[1] - pose[1])
        return gap, abs(wrap(yaw + self.turn_rad - pose[2]))


class CommandQueue:
    """Commanded speeds, each in force from one latency after its command until the next one is."""

    def __init__(self, latency: float) -> None:
        """Begin at rest; the unit of times is that of the latency."""
        self._latency = latency
        self.clear()

    def clear(self) -> None:
        """Forget all commands."""
        self._speeds = (0.0, 0.0)
        self._waiting: deque[tuple[float, tuple[float, float]]] = deque()

    def during(
        self, speeds: tuple[float, float], duration: float
    ) -> Iterator[tuple[tuple[float, float], float]]:
        """Command speeds, and let a time pass: the speeds in force, and how long each is."""
        self._waiting.append((self._latency, speeds))
        now: float = 0
        while now < duration:
            while self._waiting and self._waiting[0][0] <= now:
                self._speeds = self._waiting.popleft()[1]
            end = min(self._waiting[0][0], duration) if self._waiting else duration
            yield self._speeds, end - now
            now = end
        self._waiting = deque((left - duration, later) for left, later in self._waiting)


def check_displacement(displacement: Pose) -> None:
    """Raise ValueError for a displacement that is not three finite numbers."""
    if np.shape(displacement) != (3,) or not np.isfinite(displacement).all():
        raise ValueError(f"displacement = {displacement}, expected finite dx [m], dy [m], dyaw [rad].")


def check_drive(v_mps: float, w_radps: float, duration_s: float) -> None:
    """Raise ValueError for a drive that is not finite, or takes negative time."""
    if not (math.isfinite(v_mps) and math.isfinite(w_radps)):
        raise ValueError(f"v_mps, w_radps = {v_mps}, {w_radps}, expected finite speeds.")
    if not (math.isfinite(duration_s) and duration_s >= 0):
        raise ValueError(f"duration_s = {duration_s}, expected a finite time >= 0.")
