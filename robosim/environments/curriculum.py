"""Difficulty of tasks as a bound on the shortest drive, and a curriculum that adapts it to success.

At difficulty d between 0 and 1 the shortest drive is at most 2 m + 30 m d^2 longer than the shortest allowed one; at 1
it is not bounded. A curriculum changes the difficulty by the share of arrivals among the last episodes.
"""

import math
from collections import deque

#: Bound of drives above the shortest allowed one [m]: at difficulty 0, and what difficulty 1 adds.
_NEAR_M, _FAR_M = 2.0, 30.0
#: Episodes between changes, the shares of arrivals that raise and lower difficulty, and the change.
_EPISODES, _RAISE, _LOWER, _STEP = 10, 0.7, 0.3, 0.05


def longest_drive_m(difficulty: float, min_path_m: float) -> float:
    """Upper bound of the shortest drive of a task [m]."""
    return math.inf if difficulty >= 1 else min_path_m + _NEAR_M + _FAR_M * difficulty**2


class Curriculum:
    """The difficulty of the next task."""

    def __init__(self, difficulty: float, *, moves: bool) -> None:
        """Start with a difficulty from 0 to 1, which adapts to success if it `moves`."""
        self.difficulty, self._moves = difficulty, moves
        self._recent: deque[bool] = deque(maxlen=_EPISODES)

    def record(self, arrived: bool) -> None:
        """Record whether the robot arrived in an episode."""
        if not self._moves:
            return
        self._recent.append(arrived)
        if len(self._recent) < _EPISODES:
            return
        share = sum(self._recent) / _EPISODES
        change = _STEP if share >= _RAISE else -_STEP if share <= _LOWER else 0.0
        if change:
            self.difficulty = min(max(self.difficulty + change, 0.0), 1.0)
            self._recent.clear()
