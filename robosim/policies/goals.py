"""Goal policies: where the robot wants to be, given what it knows.

A policy is handed a `Situation`: the map and pose that the robot has estimated, what its radio measured, where its
camera saw the target; never the truth. The oracle is the exception by name: it is handed the target, and is the bar that
the others' arrival times are measured against. All policies are asked once a decision, and all arrive by one rule.

    oracle         knows the target
    explore        goes where the map ends; does not look for the target
    visual         explores until the camera sees the target, then goes there
    snr            follows the strongest path wherever there is one that is strong enough, else explores
    los            follows it where the link state is line of sight
    los-or-first   follows it where the link state is line of sight or first order: the published system
    fused          goes where radio, camera and map together say that the target is, or will tell most about it

Reference: arXiv 2110.14789 for all but the last.
"""

from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.policies.arrival import FollowArrival
from robosim.policies.belief import TargetBelief
from robosim.policies.fused import Fused, FusedConfig
from robosim.policies.situation import Situation
from robosim.support.checks import check_choice
from robosim.task.tasks import Task
from slam.exploration.explorer import FrontierExplorer
from slam.poses import to_map
from wireless.paths import LinkState

GoalName = Literal["oracle", "explore", "visual", "snr", "los", "los-or-first", "fused"]

#: Policies that look for the target.
SEEKERS: tuple[GoalName, ...] = tuple(name for name in get_args(GoalName) if name != "explore")

#: Link states in which a policy follows the strongest path.
_TRUSTED: dict[str, tuple[LinkState, ...]] = {
    "snr": (LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER),
    "los": (LinkState.LOS,),
    "los-or-first": (LinkState.LOS, LinkState.FIRST_ORDER),
}


@runtime_checkable
class GoalPolicy(Protocol):
    """Chooses a goal once a decision."""

    #: Whether the policy looks for the target, so that an episode ends on arrival.
    seeks_target: bool
    #: Whether it needs the radio.
    uses_radio: bool
    #: Whether it needs the target recognised in pictures.
    uses_camera: bool
    #: Where it takes the target to be; None if it keeps no such belief.
    belief: TargetBelief | None

    def goal(self, situation: Situation) -> Float[np.ndarray, "2"] | None:
        """A point of `map` to go to, or None when there is nothing left to do."""
        ...


class Oracle:
    """Knows where the target is."""

    seeks_target, uses_radio, uses_camera = True, False, False
    belief: TargetBelief | None = None

    def __init__(self, target: Float[np.ndarray, "2"]) -> None:
        self._target = target

    def goal(self, situation: Situation) -> Float[np.ndarray, "2"] | None:
        """The target."""
        return self._target


class Explore:
    """Goes where the map ends, until it ends nowhere."""

    seeks_target, uses_radio, uses_camera = False, False, False
    belief: TargetBelief | None = None

    def __init__(self, explorer: FrontierExplorer) -> None:
        self._explorer = explorer

    def goal(self, situation: Situation) -> Float[np.ndarray, "2"] | None:
        """A frontier, or None when all that can be reached is explored."""
        return self._explorer.goal(situation.estimate)


class Visual:
    """Explores until the target is seen, then goes to where it was seen last."""

    seeks_target, uses_radio, uses_camera = True, False, True
    belief: TargetBelief | None = None

    def __init__(self, explorer: FrontierExplorer) -> None:
        self._explorer = explorer
        self._seen: np.ndarray | None = None

    def goal(self, situation: Situation) -> Float[np.ndarray, "2"] | None:
        """The target if it was ever seen, else a frontier."""
        if situation.target is not None:
            self._seen = to_map(situation.estimate.pose, situation.target)
        return self._explorer.goal(situation.estimate) if self._seen is None else self._seen


class Wireless:
    """Follows the strongest path in trusted link states, and explores in others."""

    seeks_target, uses_radio, uses_camera = True, True, False
    belief: TargetBelief | None = None

    def __init__(self, explorer: FrontierExplorer, trusted: tuple[LinkState, ...]) -> None:
        self._explorer = explorer
        self._follow = FollowArrival(trusted)

    def goal(self, situation: Situation) -> Float[np.ndarray, "2"] | None:
        """A point along the strongest path, or a frontier."""
        ahead = self._follow.goal(situation.measured(), situation.estimate.pose)
        return self._explorer.goal(situation.estimate) if ahead is None else ahead


def make_policy(
    name: GoalName, task: Task, explorer: FrontierExplorer, fused: FusedConfig | None = None
) -> GoalPolicy:
    """A goal policy by its name.

    Args:
        name: Its name.
        task: What the oracle is told.
        explorer: Who chooses among frontiers.
        fused: How `fused` weighs what it knows.

    Raises:
        ValueError: If there is none of that name.
    """
    check_choice("goal", name, get_args(GoalName))
    if name == "oracle":
        return Oracle(task.target)
    if name == "explore":
        return Explore(explorer)
    if name == "visual":
        return Visual(explorer)
    if name in _TRUSTED:
        return Wireless(explorer, _TRUSTED[name])
    return Fused(explorer, fused)
