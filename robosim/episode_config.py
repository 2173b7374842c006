"""Configuration of an episode."""

from dataclasses import dataclass, field, replace
from typing import Annotated

import tyro

from robosim.building.building import BuildingConfig
from robosim.parts import ROBOT, ClassifierPart, ControllerPart, ExplorerPart, GoalPart, MapperPart
from robosim.policies.fused import FusedConfig
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.checks import ADVANCED, SEED, STEPS, checked
from robosim.team.team_config import TeamConfig


@dataclass(frozen=True, kw_only=True)
@checked
class EpisodeConfig:
    """How an episode is run."""

    goal: Annotated[GoalPart, tyro.conf.Suppress] = "learned"
    """Goal policy."""
    explorer: ExplorerPart = "learned"
    """Explorer: chooses among frontiers when the goal is to explore."""
    controller: ControllerPart = "planned"
    """Controller: planned, a search over turns and runs; velocity commands speeds and turn rates."""
    mapper: MapperPart = "neural"
    """Mapper: classical, neural, or a .safetensors file of a trained network."""
    known_map: Annotated[str | None, ADVANCED] = None
    """Floor plan that the robot knows, by name or file: it is located there, by the classical mapper."""
    seed: Annotated[int, SEED, tyro.conf.Suppress] = 0
    """Seed of everything random in the episode."""
    max_steps: Annotated[int, STEPS] = 1000
    """Actions before the episode is given up."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """How the plan becomes a building."""
    simulator: Annotated[SimulatorConfig, tyro.conf.arg(name="")] = field(default_factory=SimulatorConfig)
    """Simulated robot, radio and sensors."""
    link_states: ClassifierPart = "generated"
    """Link-state classifier: a shipped one by name, a .safetensors file, or "true" for the true states."""
    team: TeamConfig = field(default_factory=TeamConfig)
    """Robots that search together."""
    fused: FusedConfig = field(default_factory=FusedConfig)
    """How the goal policy `fused` weighs what it knows."""

    def __post_init__(self) -> None:
        if self.simulator.renderer == "none":
            if self.goal == "visual":
                raise ValueError(
                    f"goal is {self.goal!r}, which looks through the camera, but camera is 'none'. Give it one."
                )
            if self.mapper != "classical" and isinstance(self.mapper, str) and ":" not in self.mapper:
                raise ValueError(
                    f"mapper is {self.mapper!r}, which learned from pictures, but camera is 'none'. Give "
                    "--mapper classical."
                )

        if self.known_map is not None and self.mapper not in ("classical", "neural"):
            raise ValueError(
                "mapper is given with known_map, which has a mapper of its own. Leave one of them out."
            )

        for text in self.team.lose:
            if int(text.partition("@")[2]) >= self.max_steps:
                raise ValueError(
                    f"team.lose is {text}, expected a decision before max_steps = {self.max_steps}. Give more steps."
                )

    @property
    def robots(self) -> list[RobotConfig]:
        """Robots of the team; ValueError if there is none of a name."""
        models = self.team.models
        made = {model: ROBOT.make(model, field="robots") for model in dict.fromkeys(models)}
        return [made[model] for model in models] or [self.simulator.robot] * self.team.size

    def of_robot(self, robot: RobotConfig) -> "EpisodeConfig":
        """Return the configuration with another robot; without a camera with the classical mapper."""
        simulator = replace(self.simulator, robot=robot)
        return replace(
            self, simulator=simulator, mapper="classical" if simulator.renderer == "none" else self.mapper
        )

    def in_band(self, name: str) -> "EpisodeConfig":
        """Return the configuration in a radio band of `wireless.bands`, with the classifier of link states for it."""
        radio = self.simulator.radio.in_band(name)
        simulator = replace(self.simulator, radio=radio)
        return replace(self, simulator=simulator, link_states="generated" if name == "28ghz" else name)
