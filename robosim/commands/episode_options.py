"""What `robosim episode` and `robosim evaluate` let one choose about an episode."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from robosim.episode import EpisodeConfig
    from robosim.evaluation.ablations import PolicyName


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """How an episode is simulated, whoever chooses the goals."""

    physics: Literal["dynamic", "kinematic"] = "dynamic"
    """dynamic drives wheels in MuJoCo; kinematic moves a disk, much faster."""
    camera: Literal["pyrender", "embree"] = "pyrender"
    """pyrender draws with OpenGL; embree casts rays, slower, and needs no OpenGL."""
    robot: Literal["turtlebot", "locobot"] = "turtlebot"
    """turtlebot has a hull of radius 0.10 m, locobot 0.18 m."""
    noise: float = 1.0
    """Level of actuation and odometry noise: 0 none, 1 as published for LoCoBot."""
    depth_noise: float = 0.0
    """Level of the depth camera's noise: 0 none, 1 as published for a Kinect."""
    radio: Literal["live", "cached"] = "live"
    """live traces radio paths at the robot's true place; cached at the middle of its square of 0.15 m."""
    explorer: Literal["nearest", "cheapest", "gain", "learned"] = "learned"
    """Who chooses among frontiers: a network, the nearest, the one cheapest in decisions, or gain against decisions."""
    controller: Literal["planned", "learned"] = "planned"
    """Who chooses actions: a search over turns and straight runs, or a network that has watched it."""
    mapper: str = "neural"
    """Who makes the map: neural with the shipped network, a .safetensors file of another, classical, which is three
    times as fast, or learned-pose: classical, with the pose found by a network."""
    link_states: str = "generated"
    """Who tells link states: a shipped classifier by name, a .safetensors file, or "true"."""
    recognition: Literal["marker", "perfect"] = "marker"
    """How the camera knows the target: by its ArUco marker, or perfectly whenever it is in view."""
    size: int = 128
    """Width and height of the camera's pictures [pixels]."""
    max_steps: int = 1000
    """Actions before giving up."""
    tolerance: float = 0.0
    """How far walls may be moved to straighten them [m]; 0 keeps every cell."""

    def config(self, goal: "PolicyName" = "fused", seed: int = 0) -> "EpisodeConfig":
        """The configuration of an episode with a goal policy and a seed.

        Raises:
            ValueError: If a number is out of its bounds, or a name unknown.
        """
        from robosim.building.building import BuildingConfig
        from robosim.camera.depth_noise import DepthNoise
        from robosim.camera.model import CameraConfig
        from robosim.episode import EpisodeConfig
        from robosim.evaluation.ablations import configured
        from robosim.radio.link import RadioLinkConfig
        from robosim.robot.odometry import NoiseModel
        from robosim.robot.robots import ROBOTS
        from robosim.simulator import SimulatorConfig
        from robosim.support.checks import check_choice

        check_choice("robot", self.robot, ROBOTS)
        config = EpisodeConfig(
            explorer=self.explorer,
            controller=self.controller,
            mapper=self.mapper,
            link_states=self.link_states,
            seed=seed,
            max_steps=self.max_steps,
            building=BuildingConfig(tolerance_m=self.tolerance),
            simulator=SimulatorConfig(
                physics=self.physics,
                camera=self.camera,
                image=CameraConfig(width=self.size, height=self.size),
                robot=ROBOTS[self.robot],
                noise=NoiseModel(level=self.noise),
                depth_noise=DepthNoise(level=self.depth_noise),
                radio=RadioLinkConfig(engine=self.radio),
                recognition=self.recognition,
            ),
        )
        return configured(config, goal)

    def words(self) -> str:
        """What to type to get these options: those that differ from their defaults."""
        words = []
        for field in fields(self):
            value, option = getattr(self, field.name), field.name.replace("_", "-")
            if value == field.default:
                continue
            if isinstance(value, bool):
                words.append(f"--{option}" if value else f"--no-{option}")
            else:
                words.append(f"--{option} {value}")
        return " ".join(words)


#: As published.
DEFAULT_OPTIONS = EpisodeOptions()
