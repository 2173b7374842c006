"""Where a robot may go to look for the target, and how much of the belief lies behind each such place.

Ways to all places around lead through what was not seen yet. What is believed of a place counts for the frontier that
the way to it passes, over the decisions that the way takes: of two frontiers, who goes to the one with the greater
share an hour first arrives sooner in the mean (Smith's rule). Frontiers at the robot's own feet are no places to go
to: what lies behind them counts for the direction in which the ways to it begin.

Reference: Smith, Various optimizers for single-stage production, Naval Research Logistics Quarterly 3 (1956).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from robosim.policies.leads import Leads
from slam.actions import FORWARD_M, TURN_RAD
from slam.exploration.frontiers import Frontier
from slam.grid import GridFrame
from slam.poses import wrap

#: Frontiers nearer than this are at the robot's feet [m].
AT_FEET_M = 0.6
#: Ways that enter the unseen so far from a frontier do not pass it [m].
_BESIDE_M = 1.5
#: Narrower frontiers show less of what lies behind them, in proportion [m].
_WIDE_M = 0.6
#: Directions that are told apart around the robot, and how many on each side of one count for it.
_SECTORS, _BESIDE = 24, 2


class Prospect(NamedTuple):
    """A place to go to."""

    goal_xy: Float[np.ndarray, "2"]
    """Where [m]."""
    near_xy: Float[np.ndarray, "2"]
    """Where it is looked from [m]."""
    decisions: float
    """What the way there takes."""
    behind: float
    """Probability that the target lies behind it, each part over the decisions of the way there."""
    width: float = 1.0
    """Part of what lies behind it that its width lets one see, 0 to 1."""


def prospects(
    frontiers: Sequence[Frontier],
    way: Leads,
    probability: Float32[np.ndarray, "ny nx"],
    frame: GridFrame,
    pose: Float[np.ndarray, "3"],
    *,
    head_start: float,
    most: int,
) -> list[Prospect]:
    """Places to go to, with what is believed to lie behind them.

    Args:
        frontiers: Where what was seen ends.
        way: Ways from the robot.
        probability: Of each cell of a grid to hold the target.
        frame: Of that grid.
        pose: Of the robot.
        head_start: Decisions added to each way.
        most: So many of the nearest frontiers are looked at.
    """
    here = pose[:2]
    beyond = [one for one in frontiers if math.hypot(*(one.near_xy - here)) > AT_FEET_M]
    far = sorted(beyond, key=lambda one: one.cost_m)[:most]
    unseen = way.entry >= 0
    entries, inverse = _numbered(way.entry[unseen], way.entry.size)
    rows, columns = np.divmod(entries, way.entry.shape[1])
    places = frame.to_points(np.column_stack([columns + way.columns.start, rows + way.rows.start]) + 0.5)
    mass = probability[way.rows, way.columns][unseen]
    decisions = way.way_m[unseen] / FORWARD_M + head_start
    at_feet = (np.hypot(*(places - here).T) < AT_FEET_M)[inverse]
    found = []
    if len(beyond) < len(frontiers) and at_feet.any():
        found.append(_ahead(mass[at_feet], decisions[at_feet], way.out[unseen][at_feet].astype(float), pose))
    if far:
        turns = np.array([_turns(one.near_xy, pose) for one in far])
        behind = _behind(far, turns, places, inverse, np.where(at_feet, 0, mass), decisions)
        found += [
            Prospect(
                f.goal_xy,
                f.near_xy,
                f.cost_m / FORWARD_M + float(turn),
                float(share),
                min(1.0, f.length_m / _WIDE_M),
            )
            for f, turn, share in zip(far, turns, behind, strict=True)
        ]
    return found


def _numbered(cells: Int[np.ndarray, " n"], size: int) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " n"]]:
    """Which cells of a grid of some size there are, rising, and the place of each among them."""
    number = np.zeros(size, np.int64)
    number[cells] = 1
    there = np.flatnonzero(number)
    number[there] = np.arange(len(there))
    return there, number[cells]


def _ahead(
    mass: Float[np.ndarray, " n"],
    decisions: Float[np.ndarray, " n"],
    out: Float[np.ndarray, "n 2"],
    pose: Float[np.ndarray, "3"],
) -> Prospect:
    """The direction in which most of the belief lies for each decision, turning included."""
    angles = (np.arange(_SECTORS) + 0.5) * (2 * math.pi / _SECTORS) - math.pi
    sector = np.floor((np.arctan2(out[:, 1], out[:, 0]) + math.pi) * (_SECTORS / (2 * math.pi))).astype(int)
    apart = np.abs(np.arange(_SECTORS)[:, None] - sector % _SECTORS)
    beside = np.minimum(apart, _SECTORS - apart) <= _BESIDE
    turns = np.abs(wrap(angles - pose[2])) / TURN_RAD
    share = (beside * mass / (decisions + turns[:, None])).sum(axis=1)
    best = int(np.argmax(share))
    goal = pose[:2] + AT_FEET_M * np.array([math.cos(angles[best]), math.sin(angles[best])])
    return Prospect(goal, goal, AT_FEET_M / FORWARD_M + float(turns[best]), float(share[best]))


def _behind(
    frontiers: Sequence[Frontier],
    turns: Float[np.ndarray, " m"],
    places: Float[np.ndarray, "k 2"],
    inverse: np.ndarray,
    mass: Float[np.ndarray, " n"],
    decisions: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " m"]:
    """What is believed to lie behind each frontier, over the decisions of the ways."""
    share = np.zeros(len(frontiers))
    if not len(places):
        return share
    goals = np.array([frontier.goal_xy for frontier in frontiers])
    off_m = np.hypot(*(places[:, None] - goals).transpose(2, 0, 1))
    passed, own = np.argmin(off_m, axis=1), off_m.min(axis=1) < _BESIDE_M
    which = passed[inverse]
    np.add.at(share, which, np.where(own[inverse], mass / (decisions + turns[which]), 0))
    return share


def _turns(place: Float[np.ndarray, "2"], pose: Float[np.ndarray, "3"]) -> float:
    """Turns towards a place."""
    x, y = place - pose[:2]
    return abs(wrap(math.atan2(y, x) - float(pose[2]))) / TURN_RAD
