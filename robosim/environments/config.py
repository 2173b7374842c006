"""Configuration of a search: observations, rewards and tasks."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

from robosim.camera.model import CameraConfig
from robosim.environments.rewards import DEFAULT_WEIGHTS, OwnTerm, check_weights
from robosim.parts import ClassifierPart
from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import check_classifier
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.checks import Range, check_some, checked

Sense = Literal["rgb", "depth", "lidar", "odometry", "radio", "map", "pose"]
DepthScale = Literal["picture", "metres"]
Actions = Literal["discrete", "velocity"]


@dataclass(frozen=True, kw_only=True)
@checked
class SearchConfig:
    """Observations, rewards and tasks of the search for a target."""

    observe: tuple[Sense, ...] = ("depth", "odometry", "radio")
    """Observations of the robot: see `robosim.environments.senses`."""
    depth: DepthScale = "picture"
    """Depth images: picture has 8 bits, as networks for pictures take them; metres are 32-bit numbers."""
    actions: Actions = "discrete"
    """Actions: steps and turns, or velocity, speed and turn rate as fractions of the robot's limits."""
    rewards: Mapping[str, float | OwnTerm] = field(default_factory=lambda: dict(DEFAULT_WEIGHTS))
    """Weight of each term of `robosim.environments.rewards`, or a function for a term of another name; other terms have
    no weight."""
    difficulty: Annotated[float, Range(0, 1)] = 1.0
    """Distance of targets: 0 for a few metres, 1 for anywhere in the building."""
    curriculum: bool = False
    """Whether difficulty rises with the share of arrivals, and falls with it."""
    min_path_m: Annotated[float, Range(0, 1000, "m")] = 3.0
    """Least length of the shortest drive [m], where the building has room for it."""
    targets: Annotated[int | None, Range(1, 10_000, "places in each plan")] = None
    """Places of each plan that targets are drawn from; None for anywhere. Each place needs a table of radio."""
    map_cells: Annotated[int, Range(8, 1024, "cells")] = 64
    """Side of the map around the robot [cells]."""
    map_cell_m: Annotated[float, Range(0.01, 10, "m")] = 0.1
    """Side of one of its cells [m]."""
    link_states: ClassifierPart = "generated"
    """Link-state classifier."""

    def __post_init__(self) -> None:
        check_some("observe", self.observe, f"some of {', '.join(get_args(Sense))}")
        check_weights(self.rewards)

    @property
    def uses_radio(self) -> bool:
        """Whether observations or rewards need radio measurements."""
        return "radio" in self.observe or any(self.rewards.get(term) for term in ("link_state", "snr"))

    @property
    def uses_coverage(self) -> bool:
        """Whether observations or rewards need the floor seen so far."""
        return "map" in self.observe or bool(self.rewards.get("coverage"))


def simulator_for(config: SearchConfig) -> SimulatorConfig:
    """The fastest simulator with the needed sensors: kinematic, pictures of 64 x 64, tables of radio."""
    seen = set(config.observe)
    camera = "pyrender" if "rgb" in seen else "plan" if "depth" in seen else "none"
    # A simulator needs one of the two, which coverage is computed from.
    lidar = "ring-64" if "lidar" in seen or camera == "none" else "none"
    return SimulatorConfig(
        physics="kinematic",
        camera=camera,
        robot=RobotConfig(camera=CameraConfig(width=64, height=64), lidar=lidar),
        radio=RadioLinkConfig(engine="table"),
    )


def check_senses(config: SearchConfig, simulator: SimulatorConfig) -> None:
    """Raise ValueError if the robot lacks a sensor that it observes by, or not what the classifier needs."""
    if config.uses_radio:  # reading a classifier takes seconds
        check_classifier(config.link_states, simulator.radio)
    camera, lidar = ("camera", simulator.renderer), ("lidar", simulator.robot.lidar)
    for sense, (carrier, kind) in (("rgb", camera), ("depth", camera), ("lidar", lidar)):
        if sense in config.observe and kind == "none":
            raise ValueError(
                f"observe has {sense!r}, but the simulator's {carrier} is 'none'. Give it one, or leave {sense!r} out."
            )
