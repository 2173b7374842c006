"""A driver that knows the way: it follows the shortest drive on the true map, for trajectories to learn from.

It looks for the place within reach from which the rest of the drive is shortest, turns to it, and goes. Who collects
trajectories lets it stray now and then, so that they hold the way back too, as in DART (Laskey et al., Noise injection
for robust imitation learning, CoRL 2017).
"""

import numpy as np
from jaxtyping import Float

from robosim.environments.places import Place
from slam.actions import TURN_RAD, Action
from slam.poses import wrap

#: How far ahead it looks [m].
_AHEAD_M = 0.6
#: It turns by steps, so what is nearly ahead is ahead.
_STRAIGHT_RAD = 0.75 * TURN_RAD


def way_action(place: Place, pose: Float[np.ndarray, "3"], target: Float[np.ndarray, "2"]) -> Action:
    """The action that follows the shortest drive.

    Args:
        place: The building.
        pose: True pose of the robot: x [m], y [m], yaw [rad] in `map`.
        target: Where it is to go: x, y [m] in `map`.
    """
    plan, travel = place.plan, place.travel_m(target)
    column, row = plan.to_cells(pose[:2]) - 0.5
    reach = _AHEAD_M / plan.resolution_m
    corner = np.maximum(np.floor([row - reach, column - reach]), 0).astype(int)
    end = np.maximum(np.ceil([row + reach, column + reach]) + 1, 0).astype(int)
    cells = np.argwhere(np.isfinite(travel[corner[0] : end[0], corner[1] : end[1]])) + corner
    gap = np.hypot(cells[:, 0] - row, cells[:, 1] - column)
    # Where the rest of the drive is shorter by more than the gap, a wall is between.
    saved = place.reach.remaining_m(travel, pose[:2]) - travel[cells[:, 0], cells[:, 1]]
    cells = cells[(gap <= reach) & (saved <= (gap + 1) * plan.resolution_m)]
    if not len(cells):  # squeezed in between cells: on towards the target
        goal = target
    else:
        best = cells[np.argmin(travel[cells[:, 0], cells[:, 1]])]
        goal = plan.to_map(best[::-1] + 0.5)
    turn = wrap(float(np.arctan2(goal[1] - pose[1], goal[0] - pose[0]) - pose[2]))
    if abs(turn) <= _STRAIGHT_RAD:
        return Action.FORWARD
    return Action.LEFT if turn > 0 else Action.RIGHT
