"""Goal policies: where the robot wants to be, given what it knows.

A policy is given what the robot has sensed (`Observation`) and what it has estimated from it (`Estimates`): map, pose,
link state; never the truth. Two are exceptions by name, and the bars that the others' arrival times are
measured against: the oracle is handed the target; `shortest` is told the building and its pose too. All policies are
asked once a decision, and all arrive by one rule.

    oracle         knows the target
    shortest       knows target, building and pose: the physical limit
    explore        goes where the map ends; does not look for the target
    visual         explores until the camera sees the target, then goes there
    snr            follows the strongest path wherever there is one that is strong enough, else explores
    los            follows it where the link state is line of sight
    los-or-first   follows it where the link state is line of sight or first order: the published system
    fused          goes where radio, camera and map together say that the target is, or will tell most about it
    learned        a recurrent network chooses the actions from what the robot senses; `fused` goes on where it is stuck

A `.safetensors` file of `robosim train search` is one like the last.

Reference: arXiv 2110.14789 for all but `shortest`, `fused` and `learned`.
"""

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.parts import GOAL
from robosim.policies.arrival import FollowArrival
from robosim.policies.belief import TargetBelief
from robosim.policies.estimates import Estimates
from robosim.policies.fused import Fused, FusedConfig
from robosim.policies.reason import ARRIVAL, EXPLORE, KNOWN, SEEN, Reason
from robosim.simulator import Observation
from robosim.support.parts import Part
from slam.actions import Action
from slam.control.controller import ControlConfig
from slam.exploration.explorer import Explorer
from slam.poses import to_map
from wireless.paths import LinkState

#: Policies that come with this package and look for the target.
SEEKERS = tuple(name for name in GOAL.names if name != "explore")


@runtime_checkable
class GoalPolicy(Protocol):
    """Chooses a goal once a decision; what derives from this class takes what it does not say from here.

    One that says why it chose its last goal does so by an attribute `reason`, a `robosim.policies.reason.Reason`.
    """

    #: Whether the policy looks for the target, so that an episode ends on arrival.
    seeks_target: bool = True
    #: Whether it needs the radio.
    uses_radio: bool = False
    #: Whether it needs the target recognised in pictures.
    uses_camera: bool = False
    #: Where it takes the target to be; None if it keeps no such belief.
    belief: TargetBelief | None = None

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A point of `map` to go to, or None when there is nothing left to do."""
        ...


@runtime_checkable
class Driver(Protocol):
    """A goal policy that chooses actions too; then those of the controller are not done."""

    def action(self) -> Action | None:
        """What to do now; asked after the goal, in the same decision. None leaves it to the controller."""
        ...


class Oracle:
    """Knows where the target is."""

    seeks_target, uses_radio, uses_camera = True, False, False
    belief: TargetBelief | None = None
    reason: Reason | None = KNOWN

    def __init__(self, target: Float[np.ndarray, "2"]) -> None:
        self._target = target

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """The target."""
        return self._target


class Explore:
    """Goes where the map ends, until it ends nowhere."""

    seeks_target, uses_radio, uses_camera = False, False, False
    belief: TargetBelief | None = None
    reason: Reason | None = EXPLORE

    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A frontier, or None when all that can be reached is explored."""
        return self._explorer.goal(estimated.map)


class Visual:
    """Explores until the target is seen, then goes to where it was seen last."""

    seeks_target, uses_radio, uses_camera = True, False, True
    belief: TargetBelief | None = None
    reason: Reason | None = EXPLORE

    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer
        self._seen: np.ndarray | None = None

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """The target if it was ever seen, else a frontier."""
        if sensed.target is not None:
            self._seen = to_map(estimated.pose, sensed.target)
            self.reason = SEEN
        return self._explorer.goal(estimated.map) if self._seen is None else self._seen


class Wireless:
    """Follows the strongest path in trusted link states, and explores in others."""

    seeks_target, uses_radio, uses_camera = True, True, False
    belief: TargetBelief | None = None
    reason: Reason | None = None

    def __init__(self, explorer: Explorer, trusted: tuple[LinkState, ...]) -> None:
        self._explorer = explorer
        self._follow = FollowArrival(trusted)

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A point along the strongest path, or a frontier."""
        ahead = self._follow.goal(estimated.require_measurement(), estimated.pose)
        self.reason = EXPLORE if ahead is None else ARRIVAL
        return self._explorer.goal(estimated.map) if ahead is None else ahead


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyContext:
    """What a goal policy is made from."""

    explorer: Explorer
    """Who chooses among frontiers."""
    fused: FusedConfig = field(default_factory=FusedConfig)
    """How `fused` weighs what it knows."""
    control: ControlConfig = field(default_factory=ControlConfig)
    """The robot's hull, and what its actions do."""
    target: Float[np.ndarray, "2"] | None = None
    """Where the target truly is: for the oracle alone, and for what is compared with it."""


def make_policy(goal: Part, context: PolicyContext) -> GoalPolicy:
    """A goal policy.

    Args:
        goal: Its name, `module:Name`, an object, or a class or function that makes one from a `PolicyContext`.
        context: What it is made from.

    Raises:
        ValueError: If there is no such policy.
    """
    policy: GoalPolicy = GOAL.make(goal, context, field="goal")
    return policy


def oracle(context: PolicyContext) -> Oracle:
    """Knows the target."""
    if context.target is None:
        raise ValueError("target is None, but the oracle has to be told where it is.")
    return Oracle(context.target)


def explore(context: PolicyContext) -> Explore:
    """Goes where the map ends."""
    return Explore(context.explorer)


def visual(context: PolicyContext) -> Visual:
    """Explores until the camera sees the target."""
    return Visual(context.explorer)


def snr(context: PolicyContext) -> Wireless:
    """Follows any strong arrival."""
    trusted = LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER
    return Wireless(context.explorer, trusted)


def los(context: PolicyContext) -> Wireless:
    """Follows arrivals in line of sight."""
    return Wireless(context.explorer, (LinkState.LOS,))


def los_or_first(context: PolicyContext) -> Wireless:
    """Follows arrivals in line of sight and of first order."""
    return Wireless(context.explorer, (LinkState.LOS, LinkState.FIRST_ORDER))


def fused(context: PolicyContext) -> Fused:
    """Goes where radio, camera and map together say."""
    return Fused(context.explorer, context.fused)
