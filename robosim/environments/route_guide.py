"""A guide that follows the shortest drive on the true map, for trajectories to learn from.

It turns to the place nearby from which the rest of the drive is shortest, and drives there. Collected trajectories mix
in random actions, so that they show how to return to the route, as in DART (Laskey et al., Noise injection for robust
imitation learning, CoRL 2017).
"""

import numpy as np
from jaxtyping import Float

from robosim.environments.places import Place
from slam.actions import TURN_RAD, Action
from slam.poses import wrap

#: Distance of the next place [m].
_AHEAD_M = 0.6
#: Turns are steps, so directions within this count as ahead.
_STRAIGHT_RAD = 0.75 * TURN_RAD


def route_action(place: Place, pose: Float[np.ndarray, "3"], target: Float[np.ndarray, "2"]) -> Action:
    """The next action along the shortest drive from a true pose to a target."""
    plan, travel = place.plan, place.travel_m(target)
    column, row = plan.to_cells(pose[:2]) - 0.5
    reach = _AHEAD_M / plan.resolution_m
    corner = np.maximum(np.floor([row - reach, column - reach]), 0).astype(int)
    end = np.maximum(np.ceil([row + reach, column + reach]) + 1, 0).astype(int)
    cells = np.argwhere(np.isfinite(travel[corner[0] : end[0], corner[1] : end[1]])) + corner
    gap = np.hypot(cells[:, 0] - row, cells[:, 1] - column)
    # A place whose remaining drive is shorter by more than the gap lies behind a wall.
    saved = place.reach.remaining_m(travel, pose[:2]) - travel[cells[:, 0], cells[:, 1]]
    cells = cells[(gap <= reach) & (saved <= (gap + 1) * plan.resolution_m)]
    if not len(cells):  # the robot stands between cells: straight to the target
        goal = target
    else:
        best = cells[np.argmin(travel[cells[:, 0], cells[:, 1]])]
        goal = plan.to_map(best[::-1] + 0.5)
    turn = wrap(float(np.arctan2(goal[1] - pose[1], goal[0] - pose[0]) - pose[2]))
    if abs(turn) <= _STRAIGHT_RAD:
        return Action.FORWARD
    return Action.LEFT if turn > 0 else Action.RIGHT
