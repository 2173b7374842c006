"""The interface of things that move in a building by themselves, such as people.

A mover is one thing or a group of things that react to each other. Its bodies are upright cylinders to the robot and
to the radio; the camera and lidars see their surfaces (`robosim.movers.person` for people).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.support.checks import Range, checked


@dataclass(frozen=True, kw_only=True)
@checked
class Body:
    """A moving body. The default radius is the mean of half the breadth and half the depth of a person."""

    radius_m: Annotated[float, Range(0.01, 5, "m")] = 0.17
    """Radius of the cylinder that stops a robot [m]."""
    height_m: Annotated[float, Range(0.05, 10, "m")] = 1.7
    """Height above the floor [m]."""
    look: Literal["person", "cylinder"] = "person"
    """Shape that cameras and lidars see."""


class Surroundings(NamedTuple):
    """Surroundings of a mover when an episode begins."""

    building: Building
    robot: Float[np.ndarray, "3"]
    """Pose of the robot x [m], y [m], yaw [rad] in `map`."""
    robot_radius_m: float
    others: Float[np.ndarray, "robots 3"] = np.zeros((0, 3))
    """Other robots x [m], y [m], radius [m]; the array follows them as they go."""


@runtime_checkable
class Mover(Protocol):
    """Moves one body, or several."""

    @property
    def bodies(self) -> Sequence[Body]:
        """Return the moving bodies, always in the same order."""

    def reset(self, surroundings: Surroundings, rng: np.random.Generator) -> None:
        """Begin at time 0; all that is random is drawn from a generator."""

    def poses(self, time_s: float, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses x [m], y [m], yaw [rad] in `map`; NaN for absent bodies. `time_s` since the reset never decreases."""


class Group:
    """Several movers as one."""

    def __init__(self, movers: Sequence[Mover]) -> None:
        self._movers = movers
        self.bodies: Sequence[Body] = [body for mover in movers for body in mover.bodies]

    def reset(self, surroundings: Surroundings, rng: np.random.Generator) -> None:
        """Begin with all of them."""
        for mover, mover_rng in zip(self._movers, rng.spawn(len(self._movers)), strict=True):
            mover.reset(surroundings, mover_rng)

    def poses(self, time_s: float, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses of all of them; see `robosim.movers.mover.Mover`."""
        return np.concatenate([mover.poses(time_s, robot) for mover in self._movers])
