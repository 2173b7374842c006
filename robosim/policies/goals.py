"""Goal policies, which choose where the robot goes.

A policy receives the observation (`Observation`) and the estimates from it (`Estimates`): map, pose, link state; never
the truth. Two named exceptions are the references for arrival times: the oracle knows the target, `shortest` also the
building and the pose. All policies are called once per decision, and all arrive by one rule.

    oracle         knows the target
    shortest       knows target, building and pose: the physical limit
    explore        goes to frontiers; does not search
    visual         explores until the camera sees the target, then goes there
    snr            follows the strongest path if it is strong enough, else explores
    los            follows it if the link state is line of sight
    los-or-first   follows it if the link state is line of sight or first order: the published system
    fused          goes where radio, camera and map together locate the target, or where they learn most about it
    rss            the same from received power alone, without directions
    learned        a recurrent network chooses the actions from the sensors; `fused` decides where it is stuck, or
                   nothing is received for long

A `.safetensors` file of `robosim train search` is a policy like the last.

Reference: arXiv 2110.14789 for `oracle`, `visual`, `snr`, `los` and `los-or-first`.
"""

from collections.abc import Callable
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
from robosim.policies.received_power import PowerSearch
from robosim.simulator import Observation
from robosim.support.parts import Part
from slam.actions import Action
from slam.exploration.explorer import Explorer
from slam.poses import to_map
from slam.robot import Robot
from wireless.paths import LinkState

#: Policies of this package that search for the target.
SEEKERS = tuple(name for name in GOAL.names if name != "explore")


@runtime_checkable
class GoalPolicy(Protocol):
    """Chooses a goal at each decision. A policy that lacks an attribute has the default below."""

    #: Whether the policy searches for the target, so that an episode ends on arrival.
    seeks_target: bool = True
    #: Whether it needs the radio.
    uses_radio: bool = False
    #: Whether it needs the recogniser of the target.
    uses_camera: bool = False
    #: Whether it is given directions of arrival, or powers and ranges only.
    uses_directions: bool = True
    #: Whether its robot knows the building and its own pose, as a reference of other policies.
    uses_true_map: bool = False
    #: The belief over the target's position; None without one.
    belief: TargetBelief | None = None
    #: Reason of the last goal; None if the policy gives none.
    reason: Reason | None = None

    def reset(self) -> None:
        """Forget the last episode; a policy without memory has nothing to do."""
        return

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """Return a point of `map` to go to, or None if nothing is left to do."""
        ...

    def action(self) -> Action | None:
        """Return an action in place of the controller's, after the goal of the same decision; None leaves it to it."""
        return None


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyContext:
    """The inputs of a goal policy's constructor."""

    explorer: Explorer
    """Chooses among frontiers."""
    fused: FusedConfig = field(default_factory=FusedConfig)
    """Settings of `fused`."""
    robot: Robot = field(default_factory=Robot)
    """The robot."""
    target: Float[np.ndarray, "2"] | None = None
    """True position of the target, for the oracle and `shortest` only."""


class Oracle(GoalPolicy):
    """Knows the target."""

    reason = KNOWN

    def __init__(self, context: PolicyContext) -> None:
        if context.target is None:
            raise ValueError(f"target is None, expected its position: {type(self).__name__} needs it.")
        self._target = context.target

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """The target."""
        return self._target


class Explore(GoalPolicy):
    """Explores until there are no frontiers."""

    seeks_target = False
    reason = EXPLORE

    def __init__(self, context: PolicyContext) -> None:
        self._explorer = context.explorer

    def reset(self) -> None:
        """Forget the last episode."""
        self._explorer.reset()

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A frontier, or None if there is none."""
        return self._explorer.goal(estimated.map)


class Visual(GoalPolicy):
    """Explores until the target is seen, then goes to its last seen position."""

    uses_camera = True

    def __init__(self, context: PolicyContext) -> None:
        self._explorer = context.explorer
        self.reset()

    def reset(self) -> None:
        """Forget the last episode."""
        self._explorer.reset()
        self._seen: np.ndarray | None = None
        self.reason = EXPLORE

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """The target if it has been seen, else a frontier."""
        if sensed.target is not None:
            self._seen = to_map(estimated.pose, sensed.target)
            self.reason = SEEN
        return self._explorer.goal(estimated.map) if self._seen is None else self._seen


class Wireless(GoalPolicy):
    """Follows the strongest path in trusted link states, and explores in others."""

    uses_radio = True

    def __init__(self, explorer: Explorer, trusted: tuple[LinkState, ...]) -> None:
        self._explorer, self._trusted = explorer, trusted
        self.reset()

    def reset(self) -> None:
        """Forget the last episode."""
        self._explorer.reset()
        self._follow = FollowArrival(self._trusted)

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"] | None:
        """A point along the strongest path, or a frontier."""
        ahead = self._follow.goal(estimated.require_measurement(), estimated.pose)
        self.reason = EXPLORE if ahead is None else ARRIVAL
        return self._explorer.goal(estimated.map) if ahead is None else ahead


def make_policy(goal: Part, context: PolicyContext) -> GoalPolicy:
    """A goal policy from a name, `module:Name`, an object, or a class or function of a `PolicyContext`.

    Raises:
        ValueError: If there is no such policy.
    """
    policy: GoalPolicy = GOAL.make(goal, context, field="goal")
    return policy


def _follower(*trusted: LinkState) -> Callable[[PolicyContext], Wireless]:
    """Maker of a policy that trusts some link states."""
    return lambda context: Wireless(context.explorer, trusted)


snr = _follower(LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER)
los = _follower(LinkState.LOS)
los_or_first = _follower(LinkState.LOS, LinkState.FIRST_ORDER)


def rss(context: PolicyContext) -> PowerSearch:
    """The policy `rss`."""
    return PowerSearch(context.explorer, context.fused)


def fused(context: PolicyContext) -> Fused:
    """The policy `fused`."""
    return Fused(context.explorer, context.fused, context.robot)
