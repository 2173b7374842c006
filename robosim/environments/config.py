"""What a robot observes, what it is rewarded for, and which tasks it gets."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from robosim.camera.model import CameraConfig
from robosim.environments.rewards import DEFAULT_WEIGHTS, OwnTerm, check_weights
from robosim.parts import ClassifierPart
from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import check_classifier
from robosim.simulator import SimulatorConfig
from robosim.support.checks import check_choice, check_numbers, check_some

Sense = Literal["rgb", "depth", "lidar", "odometry", "radio", "map", "pose"]
DepthScale = Literal["picture", "metres"]


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """A search for a target as a task to learn."""

    observe: tuple[Sense, ...] = ("depth", "odometry", "radio")
    """What the robot observes; `robosim.environments.senses` says what each gives."""
    depth: DepthScale = "picture"
    """picture: 8 bits, as networks for pictures take them. metres: 32-bit numbers."""
    continuous: bool = False
    """Whether actions are speeds instead of steps."""
    rewards: Mapping[str, float | OwnTerm] = field(default_factory=lambda: dict(DEFAULT_WEIGHTS))
    """Weight of each term of `robosim.environments.rewards`, or a function for a term of your own name; terms that are
    not named count nothing."""
    difficulty: float = 1.0
    """How far targets are away: 0 for a few metres, 1 for anywhere in the building."""
    curriculum: bool = False
    """Whether difficulty rises from there as the robot arrives more often, and falls as it arrives less often."""
    min_path_m: float = 3.0
    """Shortest drives are at least so long [m], where the building has room for it."""
    targets: int | None = None
    """Places of each plan that targets are drawn from; None for anywhere. Few places make tables of radio few."""
    map_cells: int = 64
    """Side of the map around the robot [cells]."""
    map_cell_m: float = 0.1
    """Side of one of its cells [m]."""
    link_states: ClassifierPart = "generated"
    """Who tells link states of measurements."""

    def __post_init__(self) -> None:
        check_some("observe", self.observe, f"some of {', '.join(get_args(Sense))}")
        for sense in self.observe:
            check_choice("observe", sense, get_args(Sense))
        check_choice("depth", self.depth, get_args(DepthScale))
        check_weights(self.rewards)
        check_numbers(
            self,
            difficulty=(0, 1),
            min_path_m=(0, 1000, "m"),
            map_cells=(8, 1024, "cells"),
            map_cell_m=(0.01, 10, "m"),
            targets=(1, 10_000, "places in each plan"),
        )
        if self.uses_radio:  # reading it takes seconds
            check_classifier(self.link_states)

    @property
    def uses_radio(self) -> bool:
        """Whether anything asks for measurements of the radio."""
        return "radio" in self.observe or any(self.rewards.get(term) for term in ("link_state", "snr"))

    @property
    def uses_coverage(self) -> bool:
        """Whether anything asks for what has been seen."""
        return "map" in self.observe or bool(self.rewards.get("coverage"))


def simulator_for(config: SearchConfig) -> SimulatorConfig:
    """The fastest simulator that gives what is to be observed: kinematic, pictures of 64 x 64, tables of radio."""
    seen = set(config.observe)
    camera = "pyrender" if "rgb" in seen else "plan" if "depth" in seen else "none"
    # What sees nothing covers nothing, and a simulator wants one of the two.
    lidar = "ring-64" if "lidar" in seen or camera == "none" else "none"
    return SimulatorConfig(
        physics="kinematic",
        camera=camera,
        image=CameraConfig(width=64, height=64),
        lidar=lidar,
        radio=RadioLinkConfig(engine="table"),
    )


def check_senses(config: SearchConfig, simulator: SimulatorConfig) -> None:
    """See that the robot carries what it is to observe by.

    Raises:
        ValueError: If it does not.
    """
    for sense, carrier in (("rgb", "camera"), ("depth", "camera"), ("lidar", "lidar")):
        if sense in config.observe and getattr(simulator, carrier) == "none":
            raise ValueError(
                f"observe has {sense!r}, but the simulator's {carrier} is 'none'. Give it one, or leave {sense!r} out."
            )
