"""The classical navigator: mapper, planner, controller and explorer, told about the robot that they serve.

They are told what a builder would know of a robot: the optics and height of its camera, the radius of its
hull, and the mean error of its odometry for each action, which a calibration run gives.
"""

from typing import NamedTuple

from robosim.simulator import SimulatorConfig
from slam.actions import Action
from slam.control import ControlConfig, Controller
from slam.cost_map import CostConfig
from slam.exploration import ExplorerConfig, ExplorerName, FrontierExplorer
from slam.mapping import ClassicalMapper, MapperConfig
from slam.odometry import OdometryConfig
from slam.planning import Planner, PlannerConfig
from slam.projection import Band, CameraModel


class Navigator(NamedTuple):
    """The parts of a navigator."""

    mapper: ClassicalMapper
    planner: Planner
    controller: Controller
    explorer: FrontierExplorer


def make_navigator(config: SimulatorConfig, explorer: ExplorerName = "gain") -> Navigator:
    """The navigator of the robot that is simulated.

    Args:
        config: The robot and its camera.
        explorer: Who rates frontiers.
    """
    radius_m = config.robot.radius_m
    odometry = OdometryConfig(
        forward_bias=_bias(config, Action.FORWARD),
        left_bias=_bias(config, Action.LEFT),
        right_bias=_bias(config, Action.RIGHT),
    )
    cost = CostConfig(radius_m=radius_m)
    # What hangs higher than the mast and the camera on it does not stop the robot.
    top_m = config.robot.mast_m + 0.1
    camera = CameraModel(hfov_deg=config.image.hfov_deg, height_m=config.image.height_m)
    return Navigator(
        ClassicalMapper(
            MapperConfig(radius_m=radius_m, camera=camera, odometry=odometry, band=Band(high_m=top_m))
        ),
        Planner(PlannerConfig(cost=cost)),
        Controller(ControlConfig(radius_m=radius_m)),
        FrontierExplorer(ExplorerConfig(rating=explorer, cost=cost)),
    )


def _bias(config: SimulatorConfig, action: Action) -> tuple[float, float, float]:
    dx, dy, dyaw = config.noise.sensor_bias(action).tolist()
    return dx, dy, dyaw
