"""Goals along the strongest radio path.

As published: if the path is strong enough and the link state is trusted, the goal is 0.6 m along the arrival, and stays
for some decisions or until it is reached. Arrivals are ignored for a while, longer each time, when the robot is stuck:
it stays in one place, or returns to it repeatedly, because the path comes through a gap that the robot does not fit, or
from two sides in turn. Unlike the published scripts, all policies share one arrival rule and one fallback.
Reference: arXiv 2110.14789.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from robosim.radio.measurement import Measurement
from robosim.support.checks import Range, checked
from wireless.paths import LinkState

#: Places nearer to each other are the same, and a robot comes nearer to one by this much at least [m].
_SAME_M, _NEARER_M = 1.0, 0.1


@dataclass(frozen=True, kw_only=True)
@checked
class FollowConfig:
    """When arrivals are followed."""

    min_snr_db: Annotated[float, Range(-200, 200, "dB")] = 10.0
    """Least SNR of a path that is followed."""
    ahead_m: Annotated[float, Range(0.01, 100, "m")] = 0.6
    """Distance of the goal along the arrival [m]."""
    every: Annotated[int, Range(1, 1_000_000, "decisions")] = 10
    """Decisions after which a goal is replaced, unless it is reached earlier."""
    reached_m: Annotated[float, Range(0, 100, "m")] = 0.2
    """Distance at which a goal is reached [m]."""
    stuck_steps: Annotated[int, Range(1, 1_000_000, "decisions")] = 30
    """Decisions within `stuck_m` of one place after which the robot is stuck: more than a turn to any side takes."""
    stuck_window: Annotated[int, Range(1, 1_000_000, "decisions")] = 120
    """Last decisions among which these are counted: a robot may go to and fro in front of a gap."""
    stuck_m: Annotated[float, Range(0, 100, "m")] = 0.5
    """See `stuck_steps` [m]."""
    leave_steps: Annotated[int, Range(0, 1_000_000, "decisions")] = 50
    """Decisions for which arrivals are ignored the first time; as many are added each time."""


class StuckDetector:
    """Detects that a robot stays in one place, or returns to it repeatedly."""

    def __init__(self, steps: int, radius_m: float, window: int | None = None) -> None:
        """Detect `steps` of the last `window` decisions (default: all of the last `steps`) within a radius [m]."""
        self._steps, self._radius_m = steps, radius_m
        self._places: deque[np.ndarray] = deque(maxlen=window or steps)

    def is_stuck(self, place: Float[np.ndarray, "2"]) -> bool:
        """Record the place of a decision [m], and check whether the robot is stuck there."""
        self._places.append(place.copy())
        if len(self._places) < self._steps:
            return False
        near = np.hypot(*(np.array(self._places) - place).T) < self._radius_m
        return bool(np.count_nonzero(near) >= self._steps)

    def reset(self) -> None:
        """Remove all places."""
        self._places.clear()


class Approach:
    """Detects that a robot comes no nearer to a place, as to one behind a wall without a door."""

    def __init__(self, steps: int) -> None:
        """Detect `steps` decisions after the nearest one to a place."""
        self._steps = steps
        self._place, self._nearest_m, self._at = np.full(2, np.inf), math.inf, 0

    def is_vain(self, place: Float[np.ndarray, "2"], away_m: float, decision: int) -> bool:
        """Record how far the robot is from a place [m] at a decision, and check whether it comes no nearer."""
        is_other = not math.hypot(*(place - self._place)) < _SAME_M
        if is_other or away_m < self._nearest_m - _NEARER_M:
            self._place = place.copy() if is_other else self._place
            self._nearest_m, self._at = away_m, decision
        return decision - self._at >= self._steps


class FollowArrival:
    """Chooses goals along the strongest path."""

    def __init__(self, trusted: tuple[LinkState, ...], config: FollowConfig | None = None) -> None:
        self._trusted, self._config = trusted, config or FollowConfig()
        self._goal: np.ndarray | None = None
        self._age = 0
        c = self._config
        self._stuck = StuckDetector(c.stuck_steps, c.stuck_m, c.stuck_window)
        self._n_ignored = 0
        self._n_stuck = 0

    def goal(self, measurement: Measurement, pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"] | None:
        """A point along the strongest path in `map` [m]; None if the path is not followed."""
        if self._n_ignored > 0:
            self._n_ignored -= 1
            return None
        c = self._config
        self._age += 1
        if self._goal is None or self._age >= c.every or math.hypot(*(self._goal - pose[:2])) < c.reached_m:
            self._goal, self._age = self._point_ahead(measurement, pose), 0
        if self._goal is not None and self._stuck.is_stuck(pose[:2]):
            self._n_stuck += 1
            self._n_ignored = c.leave_steps * self._n_stuck
            self._goal = None
            self._stuck.reset()
        return self._goal

    def _point_ahead(
        self, measurement: Measurement, pose: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "2"] | None:
        is_strong = len(measurement.snr_db) > 0 and measurement.snr_db[0] >= self._config.min_snr_db
        if not is_strong or measurement.state not in self._trusted:
            return None
        angle = float(measurement.aoa_rad[0])
        return pose[:2] + self._config.ahead_m * np.array([math.cos(angle), math.sin(angle)])
