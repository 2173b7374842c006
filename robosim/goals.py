"""Goal policies: where the robot wants to be, given what it knows.

A policy sees the map and the pose that the robot has estimated, never the truth. The oracle is the exception
by name: it is handed the target, and is the bar that the others' arrival times are measured against.
"""

from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.tasks import Task
from slam.exploration import FrontierExplorer
from slam.grid import MapEstimate

GoalName = Literal["oracle", "explore"]


@runtime_checkable
class GoalPolicy(Protocol):
    """Chooses a goal once a decision."""

    #: Whether the policy looks for the target, so that an episode ends on arrival.
    seeks_target: bool

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """A point of `map` to go to, or None when there is nothing left to do."""
        ...


class Oracle:
    """Knows where the target is."""

    seeks_target = True

    def __init__(self, target: Float[np.ndarray, "2"]) -> None:
        self._target = target

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """The target."""
        return self._target


class Explore:
    """Goes where the map ends, until it ends nowhere."""

    seeks_target = False

    def __init__(self, explorer: FrontierExplorer) -> None:
        self._explorer = explorer

    def goal(self, estimate: MapEstimate) -> Float[np.ndarray, "2"] | None:
        """A frontier, or None when all that can be reached is explored."""
        return self._explorer.goal(estimate)


def make_policy(name: GoalName, task: Task, explorer: FrontierExplorer) -> GoalPolicy:
    """A goal policy by its name.

    Raises:
        ValueError: If there is none of that name.
    """
    if name == "oracle":
        return Oracle(task.target)
    if name == "explore":
        return Explore(explorer)
    raise ValueError(f"Unknown goal policy {name!r}. Known: oracle, explore.")
