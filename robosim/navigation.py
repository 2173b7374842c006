"""The navigator: mapper, planner, controller and explorer, told about the robot that they serve.

They are told what a builder would know of a robot: the optics and height of its camera, the radius of its
hull, and the mean error of its odometry for each action, which a calibration run gives.
"""

from pathlib import Path
from typing import Literal, NamedTuple, get_args

from robosim.simulator import SimulatorConfig
from robosim.support.assets import shipped_network
from robosim.support.checks import check_choice, check_network
from slam.actions import Action
from slam.control.controller import ControlConfig, Controller
from slam.control.learned import load_steering
from slam.exploration.choosing import load_chooser
from slam.exploration.explorer import ExplorerConfig, ExplorerName, FrontierExplorer
from slam.mapping.classical import ClassicalMapper, Mapper, MapperConfig
from slam.mapping.odometry import OdometryConfig
from slam.planning.cost_map import CostConfig
from slam.planning.planner import Planner, PlannerConfig
from slam.sensing.projection import Band, CameraModel

ControllerName = Literal["planned", "learned"]

#: Mappers by name; a file of weights makes another.
MAPPERS = ("neural", "classical", "learned-pose")


class Navigator(NamedTuple):
    """The parts of a navigator."""

    mapper: Mapper
    planner: Planner
    controller: Controller
    explorer: FrontierExplorer


def make_navigator(
    config: SimulatorConfig,
    explorer: ExplorerName = "gain",
    mapper: str = "classical",
    controller: ControllerName = "planned",
) -> Navigator:
    """The navigator of the robot that is simulated, of classical parts where no others are named.

    Args:
        config: The robot and its camera.
        explorer: Who rates frontiers.
        mapper: "classical", "neural" for the shipped network, or a .safetensors file of another; "learned-pose" for
            the classical one with the pose found by the shipped network instead of by scan matching.
        controller: Who chooses actions: the best of all turns and runs, or a network that has watched that.

    Raises:
        ValueError: If a part is unknown or a file damaged.
    """
    check_choice("controller", controller, get_args(ControllerName))
    radius_m = config.robot.radius_m
    odometry = (
        # So sure of it that no scan moves the pose.
        OdometryConfig(position_std_m=1e-6, yaw_std_rad=1e-6, learn=False)
        if config.noise.exact_odometry
        else OdometryConfig(
            forward_bias=_bias(config, Action.FORWARD),
            left_bias=_bias(config, Action.LEFT),
            right_bias=_bias(config, Action.RIGHT),
        )
    )
    cost, control = CostConfig(radius_m=radius_m), ControlConfig(radius_m=radius_m)
    # What hangs higher than the mast and the camera on it does not stop the robot.
    top_m = config.robot.mast_m + 0.1
    camera = CameraModel(hfov_deg=config.image.hfov_deg, height_m=config.image.height_m)
    mapping = MapperConfig(radius_m=radius_m, camera=camera, odometry=odometry, band=Band(high_m=top_m))
    return Navigator(
        _mapper(mapper, mapping),
        Planner(PlannerConfig(cost=cost)),
        load_steering(shipped_network("steering"), control)
        if controller == "learned"
        else Controller(control),
        FrontierExplorer(
            ExplorerConfig(rating=explorer, cost=cost),
            load_chooser(shipped_network("explorer")) if explorer == "learned" else None,
        ),
    )


def _mapper(name: str, config: MapperConfig) -> Mapper:
    check_network("mapper", name, MAPPERS)
    if name == "classical":
        return ClassicalMapper(config)
    from slam.mapping.learned_matching import LearnedMatcher  # brings torch, which takes seconds
    from slam.mapping.neural import NeuralMapper
    from slam.networks.files import load_mapper, load_pose

    if name == "learned-pose":
        return ClassicalMapper(config, LearnedMatcher(load_pose(shipped_network("pose"))[0]))

    path = shipped_network("mapper") if name == "neural" else Path(name)
    return NeuralMapper(load_mapper(path)[0], config)


def _bias(config: SimulatorConfig, action: Action) -> tuple[float, float, float]:
    dx, dy, dyaw = config.noise.sensor_bias(action).tolist()
    return dx, dy, dyaw
