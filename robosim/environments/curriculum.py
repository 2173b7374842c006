"""From near targets to far ones: difficulty as a bound on the shortest drive, and its rise with success.

At difficulty d between 0 and 1 the shortest drive is at most 2 m + 30 m d^2 longer than the least one; at 1 it may be
any. A curriculum begins somewhere and moves by the share of arrivals among the last episodes.
"""

import math
from collections import deque

#: Drives may be so much longer than the least [m]: at difficulty 0, and the more that just below 1 adds.
_NEAR_M, _FAR_M = 2.0, 30.0
#: Episodes that a step is decided on, the shares of arrivals that raise and lower difficulty, and by how much.
_EPISODES, _RAISE, _LOWER, _STEP = 10, 0.7, 0.3, 0.05


def longest_m(difficulty: float, min_path_m: float) -> float:
    """Length that the shortest drive of a task may have at most [m]."""
    return math.inf if difficulty >= 1 else min_path_m + _NEAR_M + _FAR_M * difficulty**2


class Curriculum:
    """The difficulty of the next task."""

    def __init__(self, difficulty: float, *, moves: bool) -> None:
        """Begin at a difficulty of 0 to 1.

        Args:
            difficulty: Where.
            moves: Whether it follows success, or stays.
        """
        self.difficulty, self._moves = difficulty, moves
        self._recent: deque[bool] = deque(maxlen=_EPISODES)

    def ended(self, arrived: bool) -> None:
        """Take in how an episode ended."""
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
