"""Manoeuvre before turns that would push the hull against something: leave the niche or the wall, and turn there.

A base whose hull is no disk sweeps a larger circle as it turns. A base that does not turn about its middle moves on a
circle as it turns on the spot: a LoCoBot by 2 cm to its left with each turn of 11 degrees to the left, once round a
circle of 20 cm. A turn pushes if it brings the hull nearer to an obstacle than the room that it needs, as in a gap
hardly wider than the hull. A few turns, and steps back or forward in the heading reached, may lead to a place with
room. The cost of each such manoeuvre is counted in decisions, with a penalty for turns that push, and the cheapest is
chosen; none, if turning here is cheapest.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from slam.actions import STEPS, Action
from slam.hull import Hull
from slam.planning.clearance import Clearance
from slam.poses import Pose, Poses, to_map

#: Places at which one step is checked against obstacles.
PARTS = 4
#: Largest numbers of turns and steps before the rest of the turns.
_MOST_ASIDE, _MOST_STEPS = 4, 4
#: Space that steps leave around the hull, unless there is less already, and the error of a map [m].
_CLEAR_M, _ERROR_M = 0.02, 0.01
#: A turn that moves the hull by less than this does not swing it [m].
SWING_M = 0.008
#: A turn pushes if it leaves less space around the hull than this [m], and reduces it by more than this [m].
_ROOM_M, _LESS_M = 0.005, 0.002


class Manoeuvre(NamedTuple):
    """Actions that make a turn."""

    before: list[Action]
    """Actions before the turns; empty if the robot may as well turn where it is."""
    rest: int
    """Turns left then; positive to the left."""


def swung(pose: Pose, motion: Pose, turns: int) -> Poses:
    """Poses after 0, 1, ... turns: x [m], y [m], yaw [rad]."""
    dx, dy, turn = motion
    yaw = pose[2] + turn * np.arange(turns + 1)
    c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    x = pose[0] + np.append(0, np.cumsum(c * dx - s * dy))
    y = pose[1] + np.append(0, np.cumsum(s * dx + c * dy))
    return np.column_stack([x, y, yaw])


def pushes(poses: Poses, clearance: Clearance, hull: Hull, room_m: float = _ROOM_M) -> Int[np.ndarray, " n"]:
    """How many of the turns up to each pose push the hull against an obstacle, or leave less than some space [m]."""
    room = clearance.space(hull, poses[:, :2], poses[:, 2])
    pushed = (room[1:] < room_m) & (room[1:] < room[:-1] - _LESS_M)
    return np.append(0, np.cumsum(pushed))


def turns_round(turn_rad: float) -> int:
    """Turns once round."""
    return round(2 * math.pi / abs(turn_rad))


def easier(
    pose: Pose,
    turns: int,
    clearance: Clearance,
    motion: Float[np.ndarray, "4 3"],
    *,
    hull: Hull,
    push_price: float,
    steps: Sequence[Action] = STEPS,
    around: bool = False,
) -> Manoeuvre:
    """The cheapest manoeuvre that makes some turns.

    Args:
        pose: Where the robot stands: x [m], y [m], yaw [rad].
        turns: What it is about to turn by; positive to the left.
        clearance: Distances to obstacles around.
        motion: What each action does, in the order of `Action`: x, y [m], yaw [rad].
        hull: Hull of the robot.
        push_price: What each turn that pushes costs extra [decisions].
        steps: Which steps it may make.
        around: Whether it turns to look around, so as much there as here.
    """
    cheapest = Manoeuvre([], turns)
    least = push_price * float(pushes_of(pose, turns, clearance, motion, hull)[-1])
    if not least:
        return cheapest
    for sign in (1, -1):
        turned = swung(pose, motion[first_of(sign)], _MOST_ASIDE)
        pushed = push_price * pushes_of(pose, sign * _MOST_ASIDE, clearance, motion, hull)
        for count in range(0 if sign == 1 else 1, _MOST_ASIDE + 1):
            rest = turns if around else turns - sign * count
            price = pushed[count] + count + abs(rest) - abs(turns)
            for step in steps:
                places = _along(turned[count], motion[step], clearance, hull)
                for number, there in enumerate(places, 1):
                    whole = price + number
                    if whole < least:
                        whole += push_price * pushes_of(there, rest, clearance, motion, hull)[-1]
                    if whole < least:
                        least = whole
                        cheapest = Manoeuvre([first_of(sign)] * count + [step] * number, rest)
    return cheapest


def pushes_of(
    pose: Pose, turns: int, clearance: Clearance, motion: Float[np.ndarray, "4 3"], hull: Hull
) -> Int[np.ndarray, " n"]:
    """How many of 0, 1, ... turns, positive to the left, push the hull; none of a disk that turns in place."""
    turn = motion[first_of(turns)]
    if not turns or (not hull.outline_m and np.hypot(*turn[:2]) < SWING_M):
        return np.zeros(abs(turns) + 1, int)
    return pushes(swung(pose, turn, abs(turns)), clearance, hull)


def first_of(turns: int) -> Action:
    """First action of a number of turns, positive to the left, and a run."""
    if turns == 0:
        return Action.FORWARD
    return Action.LEFT if turns > 0 else Action.RIGHT


def _along(pose: Pose, step: Pose, clearance: Clearance, hull: Hull) -> Poses:
    """Poses after one, two, ... steps, as far as the hull stays clear of obstacles."""
    fraction = np.arange(_MOST_STEPS * PARTS + 1)[:, None] / PARTS
    points = to_map(pose, fraction * step[:2])
    room = clearance.space(hull, points, float(pose[2]))
    clear = np.minimum.accumulate(room[1:])[PARTS - 1 :: PARTS] > min(room[0] - _ERROR_M, _CLEAR_M)
    places = points[PARTS::PARTS][: int(clear.sum())]
    return np.column_stack([places, np.full(len(places), pose[2])])
