"""Following the strongest radio path: a goal a little ahead along its angle of arrival, where that can be trusted.

As published: if the path is strong enough and the link state one of the trusted, the goal lies 0.6 m along the
arrival; it is kept for some decisions, or until it is reached. A robot that dwells in one place all the same, or
comes back to it again and again (the path comes through a gap that it does not fit, or from two sides in turn), leaves
arrivals alone for a while, longer each time.

Unlike the published scripts, one rule holds for all policies: no success radii or fall-backs of their own.
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


@dataclass(frozen=True, kw_only=True)
@checked
class FollowConfig:
    """When and how far a path is followed."""

    min_snr_db: Annotated[float, Range(-200, 200, "dB")] = 10.0
    """Weaker paths are not followed."""
    ahead_m: Annotated[float, Range(0.01, 100, "m")] = 0.6
    """How far along the arrival the goal lies [m]."""
    every: Annotated[int, Range(1, 1_000_000, "decisions")] = 10
    """Decisions for which a goal is kept, if it is not reached before."""
    reached_m: Annotated[float, Range(0, 100, "m")] = 0.2
    """A goal this near is reached [m]."""
    dwell_steps: Annotated[int, Range(1, 1_000_000, "decisions")] = 30
    """Decisions within `dwell_m` of one place after which the robot dwells: more than a turn to any side takes."""
    dwell_window: Annotated[int, Range(1, 1_000_000, "decisions")] = 120
    """Decisions of following that these are counted in: a robot may go to and fro before a gap that it does not fit."""
    dwell_m: Annotated[float, Range(0, 100, "m")] = 0.5
    """See above [m]."""
    leave_steps: Annotated[int, Range(0, 1_000_000, "decisions")] = 50
    """Decisions for which arrivals are left alone, the first time; as many more each time after."""


class Dwelling:
    """Notices that a robot stays in one place, or comes back to it again and again."""

    def __init__(self, steps: int, radius_m: float, window: int | None = None) -> None:
        """Nothing seen so far.

        Args:
            steps: Decisions in one place after which the robot dwells.
            radius_m: What counts as one place: nearer than this to where the robot is [m].
            window: Decisions that are looked back on; as many as `steps` if not given, so that it must have stayed.
        """
        self._steps, self._radius_m = steps, radius_m
        self._places: deque[np.ndarray] = deque(maxlen=window or steps)

    def at(self, place: Float[np.ndarray, "2"]) -> bool:
        """Take in where the robot is at a decision, x, y [m]; says whether it dwells."""
        self._places.append(place.copy())
        if len(self._places) < self._steps:
            return False
        near = np.hypot(*(np.array(self._places) - place).T) < self._radius_m
        return bool(np.count_nonzero(near) >= self._steps)

    def forget(self) -> None:
        """Begin anew."""
        self._places.clear()


class FollowArrival:
    """Chooses goals along the strongest path, or none."""

    def __init__(self, trusted: tuple[LinkState, ...], config: FollowConfig | None = None) -> None:
        self._trusted, self._config = trusted, config or FollowConfig()
        self._goal: np.ndarray | None = None
        self._age = 0
        c = self._config
        self._dwelling = Dwelling(c.dwell_steps, c.dwell_m, c.dwell_window)
        self._left_alone = 0
        self._dwelt = 0

    def goal(self, measurement: Measurement, pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"] | None:
        """A point along the strongest path in `map` [m]; None if it is not to be followed now."""
        if self._left_alone > 0:
            self._left_alone -= 1
            return None
        self._age += 1
        kept = self._goal is not None and self._age < self._config.every
        if not kept or math.hypot(*(self._goal - pose[:2])) < self._config.reached_m:
            self._goal, self._age = self._ahead(measurement, pose), 0
        if self._goal is not None and self._dwelling.at(pose[:2]):
            self._dwelt += 1
            self._left_alone = self._config.leave_steps * self._dwelt
            self._goal = None
            self._dwelling.forget()
        return self._goal

    def _ahead(self, measurement: Measurement, pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"] | None:
        strong = len(measurement.snr_db) > 0 and measurement.snr_db[0] >= self._config.min_snr_db
        if not strong or measurement.state not in self._trusted:
            return None
        angle = float(measurement.aoa_rad[0])
        return pose[:2] + self._config.ahead_m * np.array([math.cos(angle), math.sin(angle)])
