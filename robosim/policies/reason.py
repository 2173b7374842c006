"""Why a policy chose its goal: recorded with each decision, and shown with it."""

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slam.actions import FORWARD_M, TURN_RAD
from slam.poses import wrap


class GoalKind(StrEnum):
    """What a goal is."""

    KNOWN = "target known"
    """The target's place, which the policy is given."""
    SEEN = "target seen"
    """Where the camera saw the target."""
    ARRIVAL = "arrival followed"
    """A point ahead along the strongest radio path."""
    BELIEVED = "place believed"
    """Where the belief has gathered."""
    LOOK = "place to look from"
    """Where most of the belief comes in sight, or lies behind, per decision that the path takes."""
    EXPLORE = "map's edge"
    """Where the map ends, whatever the radio says."""
    PREVIOUS = "goal kept"
    """An earlier goal, since two of them took turns."""
    OTHER = "not told"
    """The policy does not say."""


class Reason(NamedTuple):
    """Why the present goal was chosen, or confirmed at the last review."""

    kind: GoalKind
    """What the goal is."""
    because: str = ""
    """What was weighed then, in a few words."""
    mass: float = math.nan
    """Probability that the target was within half a metre of the place most believed then; NaN without a belief."""


#: Of policies that have one reason for a kind of goal.
KNOWN = Reason(kind=GoalKind.KNOWN, because="the policy is given the place of the target")
SEEN = Reason(kind=GoalKind.SEEN, because="the camera has seen the target")
ARRIVAL = Reason(kind=GoalKind.ARRIVAL, because="the link state of the strongest path is trusted")
EXPLORE = Reason(kind=GoalKind.EXPLORE, because="more floor is to be seen there")
#: Of a policy that does not say.
UNKNOWN_REASON = Reason(kind=GoalKind.OTHER)
#: Of an earlier goal that the loop detector returns instead of the policy's (`slam.planning.loop_detector`).
LOOP_DETECTED = Reason(
    kind=GoalKind.PREVIOUS, because="two goals took turns, so the present one stays for a while"
)


def decisions_along(path: Float[np.ndarray, "n 2"], yaw: float) -> float:
    """Decisions that a path takes if nothing intervenes: steps ahead, and turns at its corners.

    Args:
        path: Corners of the path (x, y) [m], from the robot on.
        yaw: Where the robot looks [rad].
    """
    legs = np.diff(path, axis=0)
    length = np.hypot(legs[:, 0], legs[:, 1])
    legs, length = legs[length > 0], length[length > 0]
    heading = np.concatenate([[yaw], np.arctan2(legs[:, 1], legs[:, 0])])
    return float(length.sum() / FORWARD_M + np.abs(wrap(np.diff(heading))).sum() / TURN_RAD)
