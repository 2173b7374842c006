"""Notices a robot that drives round and round near a place, says why, and what is done about it.

It drives there for long, and either its way to one and the same goal does not get shorter, or two goals take turns.
In the first case the way is planned on the map's own cells throughout, since larger cells may lead it to a neck where
the hull does not fit; in the second the goal that it has is kept for a while. Runs in which neither happens are left
as they are: nothing is decided here then.
Left out: a robot that stands and turns. The controller walks off by itself then.
"""

import logging
import math
from collections import deque
from enum import Enum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slam.planning.planner import Plan

logger = logging.getLogger(__name__)

#: So many decisions within this distance of where the robot is [m], with so much way [m], are going round.
_DECISIONS, _NEAR_M, _DRIVEN_M = 60, 2.0, 2.0
#: A way that is shorter by less in the second half of them does not get shorter [m].
_PROGRESS_M = 0.5
#: Goals this far apart are different, and one that is nearer is reached [m]; so many of them at most, with so many
#: changes at least, take turns.
_APART_M, _FEW, _CHANGES = 0.5, 2, 5


class Remedy(Enum):
    """What is done about going round."""

    PLAN_CLOSELY = "the way does not get shorter; it is planned on the map's own cells from now on"
    KEEP_GOAL = f"two goals take turns; the present one is kept for {_DECISIONS} decisions"


class _Decision(NamedTuple):
    """What is remembered of a decision."""

    here: Float[np.ndarray, "2"]
    goal: Float[np.ndarray, "2"]
    length_m: float


class Rounds:
    """Looks on as decisions are made."""

    def __init__(self) -> None:
        self._last: deque[_Decision] = deque(maxlen=_DECISIONS)
        self._kept: Float[np.ndarray, 2] | None = None
        self._left = 0

    def goal(self, asked: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
        """The goal to go to, (x, y) [m]: the one asked for, or one that is kept until the robot is there."""
        if self._kept is None or not self._left or math.hypot(*(self._kept - pose[:2])) < _APART_M:
            self._kept = None
            return asked
        self._left -= 1
        return self._kept

    def watch(self, pose: Float[np.ndarray, "3"], goal: Float[np.ndarray, "2"], plan: Plan) -> Remedy | None:
        """Take in a decision; what is to be done if the robot goes round, which is logged with its cause.

        Args:
            pose: Where the robot is: x [m], y [m], yaw [rad].
            goal: Where it was to go [m].
            plan: The way there.
        """
        self._last.append(_Decision(np.array(pose[:2]), np.array(goal), plan.length_m))
        remedy = self._remedy()
        if remedy is None:
            return None
        logger.warning(
            "The robot goes round within %g m of (%.2f, %.2f) m for %d decisions, bound for (%.2f, %.2f) m: %s.",
            _NEAR_M,
            *pose[:2],
            _DECISIONS,
            *goal,
            remedy.value,
        )
        self._last.clear()
        if remedy is Remedy.KEEP_GOAL:
            self._kept, self._left = np.array(goal), _DECISIONS
        return remedy

    def _remedy(self) -> Remedy | None:
        if len(self._last) < _DECISIONS:
            return None
        places = np.array([one.here for one in self._last])
        if np.hypot(*(places - places[-1]).T).max() > _NEAR_M:
            return None
        if np.hypot(*np.diff(places, axis=0).T).sum() < _DRIVEN_M:
            return None
        goals, changes = self._goals()
        if goals == 1:
            # Where there is no way at all its length is infinite.
            length = np.minimum([one.length_m for one in self._last], 1e6)
            half, least = _DECISIONS // 2, length.min()
            on = length[:half].min() - length[half:].min() >= _PROGRESS_M
            return None if on or least < _APART_M else Remedy.PLAN_CLOSELY
        return Remedy.KEEP_GOAL if goals <= _FEW and changes >= _CHANGES else None

    def _goals(self) -> tuple[int, int]:
        """How many different goals there were, and how often the goal changed."""
        found: list[Float[np.ndarray, 2]] = []
        which = []
        for one in self._last:
            near = [k for k, goal in enumerate(found) if math.hypot(*(goal - one.goal)) < _APART_M]
            if not near:
                found.append(one.goal)
            which.append(near[0] if near else len(found) - 1)
        return len(found), int(np.count_nonzero(np.diff(which)))
