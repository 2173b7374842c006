"""A policy that climbs the gradient of received power: what a search without a belief reaches.

A plane is fitted to the powers of the last places. The goal lies along its gradient. The robot explores for a
while if the map has an obstacle there, if it is stuck, or if the places lie in a line.
"""

from collections import deque

import numpy as np
from jaxtyping import Float

from robosim.policies.arrival import StuckDetector
from robosim.policies.estimates import Estimates
from robosim.policies.goals import GoalPolicy, PolicyContext
from robosim.simulator import Observation

#: Places of the plane, how far apart they are, and their least spread in each direction [m]; distance of the goal [m].
_PLACES, _APART_M, _SPREAD_M, _AHEAD_M = 12, 0.2, 0.15, 1.0
#: Decisions of exploring.
_EXPLORE = 25


class Climb(GoalPolicy):
    """Goes where the power increases."""

    uses_radio = True
    uses_directions = False

    def __init__(self, context: PolicyContext) -> None:
        self._explorer = context.explorer
        self._last: deque[tuple[float, float, float]] = deque(maxlen=_PLACES)
        self._stuck = StuckDetector(30, 0.5)
        self._exploring = 0

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A point along the gradient, or a frontier."""
        measured, here = estimated.require_measurement(), estimated.pose[:2]
        apart = not self._last or np.hypot(*(here - self._last[-1][:2])) >= _APART_M
        if len(measured.gain_db) and apart:
            self._last.append((float(here[0]), float(here[1]), float(measured.gain_db[0])))
        if self._stuck.is_stuck(here):
            self._exploring = _EXPLORE
            self._stuck.reset()
        self._exploring -= 1
        ahead = None if self._exploring > 0 else self._along(here, estimated)
        if ahead is None:
            self._exploring = max(self._exploring, _EXPLORE // 5)
            return self._explorer.goal(estimated.map)
        return ahead

    def _along(self, here: Float[np.ndarray, "2"], estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A point along the gradient that is not an obstacle; None without one."""
        if len(self._last) < _PLACES // 2:
            return None
        table = np.array(self._last)
        off = table[:, :2] - table[:, :2].mean(axis=0)
        if np.linalg.svd(off, compute_uv=False)[1] / np.sqrt(len(off)) < _SPREAD_M:
            return None
        gradient = np.linalg.lstsq(off, table[:, 2] - table[:, 2].mean(), rcond=None)[0]
        size = np.hypot(*gradient)
        if size == 0:
            return None
        goal = here + _AHEAD_M * gradient / size
        iy, ix = estimated.map.frame.index(goal)
        known = estimated.map.frame.inside(iy, ix)
        return None if known and estimated.map.obstacle[iy, ix] else np.asarray(goal)
