"""Where turns take the hull of a base that does not turn about its middle, and where they push it against something.

Such a base goes round a circle as it turns on the spot: by the numbers of a LoCoBot, 2 cm to its left with each turn of
11 degrees to the left, so once round a circle of 20 cm. In a niche the hull rests against a wall on part of
it. A turn pushes if it brings the hull nearer to an obstacle than the room that it needs.
"""

import math

import numpy as np
from jaxtyping import Float, Int

from slam.planning.clearance import Clearance

#: A turn pushes if it leaves less space around the hull than this [m], and reduces it by more than this [m].
_ROOM_M, _LESS_M = 0.005, 0.002


def swung(
    pose: Float[np.ndarray, "3"], motion: Float[np.ndarray, "3"], turns: int
) -> Float[np.ndarray, "n 3"]:
    """Poses after 0, 1, ... turns: x [m], y [m], yaw [rad]."""
    dx, dy, turn = motion
    yaw = pose[2] + turn * np.arange(turns + 1)
    c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    x = pose[0] + np.append(0, np.cumsum(c * dx - s * dy))
    y = pose[1] + np.append(0, np.cumsum(s * dx + c * dy))
    return np.column_stack([x, y, yaw])


def pushes(poses: Float[np.ndarray, "n 3"], clearance: Clearance, radius_m: float) -> Int[np.ndarray, " n"]:
    """How many of the turns up to each pose push the hull against an obstacle."""
    room = clearance.at(poses[:, :2]) - radius_m
    pushed = (room[1:] < _ROOM_M) & (room[1:] < room[:-1] - _LESS_M)
    return np.append(0, np.cumsum(pushed))


def turns_round(turn_rad: float) -> int:
    """Turns once round."""
    return round(2 * math.pi / abs(turn_rad))
