"""Places from which the robot may look for the target, and the part of the belief behind each of them.

Routes to all places enter unexplored cells somewhere. The belief of a place counts for the frontier where the route to
it does, divided by the decisions for the route: of two tasks, doing the one with the larger probability per time first
ends sooner on average (Smith's rule). Frontiers at the robot's own place are no goals: the belief behind them counts
for the direction in which its routes begin.

Reference: Smith, Various optimizers for single-stage production, Naval Research Logistics Quarterly 3 (1956).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from robosim.policies.route_directions import RouteDirections
from slam.actions import FORWARD_M, TURN_RAD
from slam.exploration.frontiers import Frontier
from slam.grid import GridFrame
from slam.poses import wrap

#: Frontiers nearer than this are at the robot's own place [m].
AT_ROBOT_M = 0.6
#: Routes that enter unexplored cells farther from a frontier do not pass it [m].
_PASSING_M = 1.5
#: Narrower frontiers show proportionally less of what is behind them [m].
_WIDE_M = 0.6
#: Directions around the robot, and how many on each side count for one of them.
_SECTORS, _SIDE_SECTORS = 24, 2


class Prospect(NamedTuple):
    """A place to go to."""

    goal_xy: Float[np.ndarray, "2"]
    """Position of the goal [m]."""
    near_xy: Float[np.ndarray, "2"]
    """Position from which the robot looks [m]."""
    decisions: float
    """Decisions for the route there."""
    behind: float
    """Probability behind it, each part divided by the decisions for its route."""
    width: float = 1.0
    """Share of what is behind it that its width shows, 0 to 1."""


def find_prospects(
    frontiers: Sequence[Frontier],
    routes: RouteDirections,
    probability: Float32[np.ndarray, "ny nx"],
    frame: GridFrame,
    pose: Float[np.ndarray, "3"],
    *,
    head_start: float,
    count: int,
) -> list[Prospect]:
    """Places to go to from the robot's pose, with the belief (of a grid) behind them.

    `head_start` is added to the decisions of each route; only the nearest `most` frontiers are used.
    """
    here = pose[:2]
    beyond = [frontier for frontier in frontiers if math.hypot(*(frontier.near_xy - here)) > AT_ROBOT_M]
    far = sorted(beyond, key=lambda frontier: frontier.cost_m)[:count]
    unexplored = routes.entry >= 0
    # As np.unique with its inverse, but without sorting all cells.
    number = np.zeros(routes.entry.size, np.int64)
    number[routes.entry[unexplored]] = 1
    entries = np.flatnonzero(number)
    number[entries] = np.arange(len(entries))
    inverse = number[routes.entry[unexplored]]
    rows, columns = np.divmod(entries, routes.entry.shape[1])
    places = frame.to_points(
        np.column_stack([columns + routes.columns.start, rows + routes.rows.start]) + 0.5
    )
    mass = probability[routes.rows, routes.columns][unexplored]
    decisions = routes.length_m[unexplored] / FORWARD_M + head_start
    at_robot = (np.hypot(*(places - here).T) < AT_ROBOT_M)[inverse]
    prospects = []
    if len(beyond) < len(frontiers) and at_robot.any():
        out = routes.out[unexplored][at_robot].astype(float)
        prospects.append(_best_direction(mass[at_robot], decisions[at_robot], out, pose))
    if far:
        turns = np.array([_turns(frontier.near_xy, pose) for frontier in far])
        behind = _behind(far, turns, places, inverse, np.where(at_robot, 0, mass), decisions)
        for frontier, turn, share in zip(far, turns, behind, strict=True):
            width = min(1.0, frontier.length_m / _WIDE_M)
            n_decisions = frontier.cost_m / FORWARD_M + float(turn)
            prospects.append(Prospect(frontier.goal_xy, frontier.near_xy, n_decisions, float(share), width))
    return prospects


def _best_direction(
    mass: Float[np.ndarray, " n"],
    decisions: Float[np.ndarray, " n"],
    out: Float[np.ndarray, "n 2"],
    pose: Float[np.ndarray, "3"],
) -> Prospect:
    """The direction with the largest belief per decision, turns included."""
    angles = (np.arange(_SECTORS) + 0.5) * (2 * math.pi / _SECTORS) - math.pi
    sector = np.floor((np.arctan2(out[:, 1], out[:, 0]) + math.pi) * (_SECTORS / (2 * math.pi))).astype(int)
    apart = np.abs(np.arange(_SECTORS)[:, None] - sector % _SECTORS)
    is_near = np.minimum(apart, _SECTORS - apart) <= _SIDE_SECTORS
    turns = np.abs(wrap(angles - pose[2])) / TURN_RAD
    share = (is_near * mass / (decisions + turns[:, None])).sum(axis=1)
    best = int(np.argmax(share))
    goal = pose[:2] + AT_ROBOT_M * np.array([math.cos(angles[best]), math.sin(angles[best])])
    return Prospect(goal, goal, AT_ROBOT_M / FORWARD_M + float(turns[best]), float(share[best]))


def _behind(
    frontiers: Sequence[Frontier],
    turns: Float[np.ndarray, " m"],
    places: Float[np.ndarray, "k 2"],
    inverse: np.ndarray,
    mass: Float[np.ndarray, " n"],
    decisions: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " m"]:
    """Belief behind each frontier, divided by the decisions for the routes."""
    share = np.zeros(len(frontiers))
    if not len(places):
        return share
    goals = np.array([frontier.goal_xy for frontier in frontiers])
    distance_m = np.hypot(*(places[:, None] - goals).transpose(2, 0, 1))
    nearest, passes = np.argmin(distance_m, axis=1), distance_m.min(axis=1) < _PASSING_M
    which = nearest[inverse]
    np.add.at(share, which, np.where(passes[inverse], mass / (decisions + turns[which]), 0))
    return share


def _turns(place: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"]) -> float:
    """Turns towards a place."""
    x, y = place - pose[:2]
    return abs(wrap(math.atan2(y, x) - float(pose[2]))) / TURN_RAD
