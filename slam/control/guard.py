"""Predicts which of the next actions would end at an obstacle of the map.

For policies that choose actions without a map. A step forward bumps if the hull does not fit on its path; a turn, of a
base that swings aside as it turns, if it pushes the hull against something.
"""

import numpy as np
from jaxtyping import Bool

from robosim.support.compiled import delayed_signals
from slam.actions import FORWARD_M, PUBLISHED, Action
from slam.control.manoeuvre import pushes, swung
from slam.grid import MapEstimate
from slam.planning.clearance import Clearance
from slam.robot import Robot

#: Error of a map [m]: the hull is taken to be smaller by this where there is not more space; and the space to keep.
_ERROR_M, _MARGIN_M = 0.01, 0.014
#: Space that a turn must leave around the hull [m]: turns that left less on the map have touched walls.
_TURN_M = 0.015


class Guard:
    """Predicts bumps of one robot."""

    def __init__(self, robot: Robot) -> None:
        self._hull = robot.hull
        self._turns = {
            action: np.array(motion)
            for action, motion in zip(PUBLISHED, robot.motions, strict=False)
            if motion is not None and action is not Action.FORWARD
        }

    @delayed_signals()
    def bumps(self, estimate: MapEstimate) -> Bool[np.ndarray, "3"]:
        """Whether each of the published actions would end at something."""
        near = Clearance.around(estimate, FORWARD_M + 2 * self._hull.turning_m)
        here_m = float(near.space(self._hull, estimate.pose[:2], float(estimate.pose[2])))
        space_m = max(min(here_m - _ERROR_M, _MARGIN_M), -_ERROR_M)
        ahead_m = near.free_run_m(estimate.pose[:2], estimate.pose[2:], self._hull, space_m)
        is_bump = np.zeros(len(PUBLISHED), bool)
        is_bump[Action.FORWARD] = ahead_m[0] < FORWARD_M - 1e-6
        for action, motion in self._turns.items():
            is_bump[action] = pushes(swung(estimate.pose, motion, 1), near, self._hull, _TURN_M)[1]
        return is_bump
