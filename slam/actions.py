"""The actions of a robot that explores: discrete ones with their nominal displacements, and velocities.

One step forward or a turn on the spot is the set that Active Neural SLAM and Habitat use, and what networks choose
among here (`PUBLISHED`). A robot that does not turn about its centre cannot turn in a gap as narrow as itself: it can
step back too. Where others move, it can wait. There is no stop action: arrival is judged from the pose. The amounts
are nominal; the actual displacement depends on the robot.
Reference: Chaplot et al., Learning to Explore using Active Neural SLAM, ICLR 2020, section 4.
"""

import math
from enum import IntEnum
from typing import NamedTuple

#: Distance of a step forward, or back [m].
FORWARD_M = 0.25
#: Angle of a turn [rad].
TURN_RAD = math.radians(10.0)
#: Time of a wait [s].
WAIT_S = 1.0


class Action(IntEnum):
    """Command of the robot in one decision."""

    FORWARD = 0
    """Go forward by `FORWARD_M`."""
    LEFT = 1
    """Turn counter-clockwise by `TURN_RAD`."""
    RIGHT = 2
    """Turn clockwise by `TURN_RAD`."""
    BACKWARD = 3
    """Go back by `FORWARD_M`."""
    WAIT = 4
    """Stand still for `WAIT_S`, while others move."""

    @property
    def ahead_m(self) -> float:
        """Distance that it leads ahead [m], negative backwards."""
        return {Action.FORWARD: FORWARD_M, Action.BACKWARD: -FORWARD_M}.get(self, 0.0)


#: The actions of the published system.
PUBLISHED = (Action.FORWARD, Action.LEFT, Action.RIGHT)
#: Actions that move the robot.
MOVES = (*PUBLISHED, Action.BACKWARD)
#: Actions without a turn.
STEPS = (Action.FORWARD, Action.BACKWARD)


class Velocity(NamedTuple):
    """A speed and a turn rate for a time; the robot rolls on."""

    v_mps: float
    """Speed ahead [m/s]."""
    w_radps: float
    """Turn rate, counter-clockwise [rad/s]."""
    duration_s: float
    """Time until the next command [s]."""

    @property
    def ahead_m(self) -> float:
        """Distance that it leads ahead [m], negative backwards."""
        return self.v_mps * self.duration_s


#: Command of a robot in one decision.
Command = Action | Velocity


def nearest_action(command: Command) -> Action:
    """The discrete action that is most like a command."""
    if isinstance(command, Action):
        return command
    if command.v_mps:
        return Action.FORWARD if command.v_mps > 0 else Action.BACKWARD
    return Action.LEFT if command.w_radps > 0 else Action.RIGHT if command.w_radps else Action.WAIT
