"""Loop detector: recognises a robot that drives in circles, logs the cause, and chooses a remedy.

The robot drives near one place for long, and either its path to the same goal does not get shorter, or two goals
alternate. In the first case paths are planned on the map's own cells, since larger cells may lead to a passage where
the hull does not fit; in the second the current goal is held for a while.
A robot that stands and turns is not detected: the controller handles it.
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

#: A loop is this many decisions within this distance of the robot [m], over at least this path length [m].
_DECISIONS, _NEAR_M, _DRIVEN_M = 60, 2.0, 2.0
#: Least decrease of the path length from the first to the second half of the decisions [m].
_PROGRESS_M = 0.5
#: Goals at least this far apart are different, and a nearer one is reached [m]; at most this many goals, with at least
#: this many changes, alternate.
_APART_M, _FEW, _CHANGES = 0.5, 2, 5


class Remedy(Enum):
    """Remedies for a loop."""

    PLAN_CLOSELY = (
        "the path does not get shorter; it is planned on the map's own cells until the goal changes"
    )
    KEEP_GOAL = f"two goals alternate; the current one is held for {_DECISIONS} decisions"


class _Decision(NamedTuple):
    """Record of a decision."""

    here: Float[np.ndarray, "2"]
    goal: Float[np.ndarray, "2"]
    length_m: float


class LoopDetector:
    """Detects loops in a sequence of decisions."""

    def __init__(self) -> None:
        self._last: deque[_Decision] = deque(maxlen=_DECISIONS)
        self._held_goal: Float[np.ndarray, 2] | None = None
        self._left = 0

    def goal(self, requested: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
        """The goal (x, y) [m]: the requested one, or one that is held until the robot reaches it."""
        if self._held_goal is None or not self._left or math.hypot(*(self._held_goal - pose[:2])) < _APART_M:
            self._held_goal = None
            return requested
        self._left -= 1
        return self._held_goal

    def watch(self, pose: Float[np.ndarray, "3"], goal: Float[np.ndarray, "2"], plan: Plan) -> Remedy | None:
        """Record a decision; return the remedy if the robot is in a loop, and log the cause."""
        self._last.append(_Decision(np.array(pose[:2]), np.array(goal), plan.length_m))
        remedy = self._remedy()
        if remedy is None:
            return None
        logger.warning(
            "The robot drives in circles within %g m of (%.2f, %.2f) m for %d decisions, bound for (%.2f, %.2f) m: %s.",
            _NEAR_M,
            *pose[:2],
            _DECISIONS,
            *goal,
            remedy.value,
        )
        self._last.clear()
        if remedy is Remedy.KEEP_GOAL:
            self._held_goal, self._left = np.array(goal), _DECISIONS
        return remedy

    def _remedy(self) -> Remedy | None:
        if len(self._last) < _DECISIONS:
            return None
        places = np.array([decision.here for decision in self._last])
        if np.hypot(*(places - places[-1]).T).max() > _NEAR_M:
            return None
        if np.hypot(*np.diff(places, axis=0).T).sum() < _DRIVEN_M:
            return None
        goals, changes = self._goals()
        if goals == 1:
            # The length of an unreachable goal is infinite.
            length = np.minimum([decision.length_m for decision in self._last], 1e6)
            half, least = _DECISIONS // 2, length.min()
            on = length[:half].min() - length[half:].min() >= _PROGRESS_M
            return None if on or least < _APART_M else Remedy.PLAN_CLOSELY
        return Remedy.KEEP_GOAL if goals <= _FEW and changes >= _CHANGES else None

    def _goals(self) -> tuple[int, int]:
        """Number of different goals, and of changes of the goal."""
        distinct: list[Float[np.ndarray, 2]] = []
        which = []
        for decision in self._last:
            near = [k for k, goal in enumerate(distinct) if math.hypot(*(goal - decision.goal)) < _APART_M]
            if not near:
                distinct.append(decision.goal)
            which.append(near[0] if near else len(distinct) - 1)
        return len(distinct), int(np.count_nonzero(np.diff(which)))
