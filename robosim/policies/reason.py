"""The reason of a goal, which is recorded and shown with each decision."""

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slam.actions import FORWARD_M, TURN_RAD
from slam.poses import wrap


class GoalKind(StrEnum):
    """Kind of a goal."""

    KNOWN = "target known"
    """The position of the target, which the policy knows."""
    SEEN = "target seen"
    """Where the camera saw the target."""
    ARRIVAL = "arrival followed"
    """A point ahead along the strongest radio path."""
    BELIEVED = "place believed"
    """Where the belief is concentrated."""
    LOOK = "place to look from"
    """The frontier of the region with which the best order of regions begins."""
    ACTION = "action chosen"
    """A point in the direction of an action that a network chooses."""
    EXPLORE = "map's edge"
    """A frontier, chosen without the radio."""
    AWAY = "yields"
    """A place where another robot can pass."""
    PREVIOUS = "goal kept"  # stored name
    """An earlier goal, since two of them alternated."""
    OTHER = "not told"  # stored name
    """The policy gives no reason."""


#: Kinds of goals at which, or beyond which, the target is expected.
TO_TARGET = (GoalKind.KNOWN, GoalKind.SEEN, GoalKind.ARRIVAL, GoalKind.BELIEVED)


class Reason(NamedTuple):
    """Reason of the present goal at its last review."""

    kind: GoalKind
    because: str = ""
    """A few words."""
    mass: float = math.nan
    """Probability within 0.5 m of the belief's peak; NaN without a belief."""


KNOWN = Reason(kind=GoalKind.KNOWN, because="the policy is given the place of the target")
SEEN = Reason(kind=GoalKind.SEEN, because="the camera has seen the target")
ARRIVAL = Reason(kind=GoalKind.ARRIVAL, because="the link state of the strongest path is trusted")
EXPLORE = Reason(kind=GoalKind.EXPLORE, because="more floor is to be seen there")
IDLE = Reason(kind=GoalKind.OTHER, because="nothing is left to do")
YIELDS = Reason(kind=GoalKind.AWAY, because="another robot is to pass")
UNKNOWN_REASON = Reason(kind=GoalKind.OTHER)
#: Reason of an earlier goal that the loop detector (`slam.planning.loop_detector`) returns.
LOOP_DETECTED = Reason(
    kind=GoalKind.PREVIOUS, because="two goals took turns, so the present one stays for a while"
)


def decisions_along(path: Float[np.ndarray, "n 2"], yaw: float) -> float:
    """Decisions for a path (corners [m], from the robot on): steps ahead, and turns, the first from the robot's yaw."""
    legs = np.diff(path, axis=0)
    length = np.hypot(legs[:, 0], legs[:, 1])
    legs, length = legs[length > 0], length[length > 0]
    heading = np.concatenate([[yaw], np.arctan2(legs[:, 1], legs[:, 0])])
    return float(length.sum() / FORWARD_M + np.abs(wrap(np.diff(heading))).sum() / TURN_RAD)
