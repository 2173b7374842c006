"""The navigator: mapper, planner, controller and explorer, told about the robot that they serve.

They are told what a builder would know of a robot: the optics and height of its camera, the radius of its
hull, and the mean error of its odometry for each action, which a calibration run gives.
"""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

import slam
import wireless
from robosim.parts import CONTROLLER, EXPLORER, MAPPER
from robosim.robot.calibration import open_floor, run_actions
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from robosim.support.assets import shipped_network
from robosim.support.parts import Part
from slam.actions import Action
from slam.control.controller import ControlConfig, LocalPolicy
from slam.control.learned import LearnedController, load_steering
from slam.exploration.choosing import load_chooser
from slam.exploration.explorer import Explorer, ExplorerConfig, ExplorerName, FrontierExplorer
from slam.mapping.classical import ClassicalMapper, Mapper, MapperConfig
from slam.mapping.odometry import OdometryConfig, calibrated
from slam.planning.cost_map import CostConfig
from slam.planning.planner import Planner, PlannerConfig
from slam.sensing.projection import Band, CameraModel
from wireless.support.cached_array import cached_array

#: How often each action is run to calibrate the odometry of a robot that nobody has calibrated.
CALIBRATION_RUNS = 1000


class Navigator(NamedTuple):
    """The parts of a navigator."""

    mapper: Mapper
    planner: Planner
    controller: LocalPolicy
    explorer: Explorer


def make_navigator(
    config: SimulatorConfig,
    explorer: Part = "gain",
    mapper: Part = "classical",
    controller: Part = "planned",
) -> Navigator:
    """The navigator of the robot that is simulated, of classical parts where no others are named.

    Args:
        config: The robot and its camera.
        explorer: Who chooses among frontiers, of `robosim.parts.EXPLORER`.
        mapper: Who makes the map, of `robosim.parts.MAPPER`.
        controller: Who chooses actions, of `robosim.parts.CONTROLLER`.

    Raises:
        ValueError: If a part is unknown or a file damaged.
    """
    radius_m = config.robot.radius_m
    odometry = _odometry(config)
    cost = CostConfig(radius_m=radius_m)
    # What hangs higher than the mast and the camera on it does not stop the robot.
    top_m = config.robot.mast_m + 0.1
    camera = CameraModel(hfov_deg=config.image.hfov_deg, height_m=config.image.height_m)
    mapping = MapperConfig(radius_m=radius_m, camera=camera, odometry=odometry, band=Band(high_m=top_m))
    return Navigator(
        MAPPER.make(mapper, mapping, field="mapper"),
        Planner(PlannerConfig(cost=cost)),
        CONTROLLER.make(controller, control_of(config), field="controller"),
        EXPLORER.make(explorer, ExplorerConfig(cost=cost), field="explorer"),
    )


def control_of(config: SimulatorConfig) -> ControlConfig:
    """How the robot that is simulated is steered: its hull, and what its actions do."""
    motions = tuple(error.motion for error in _odometry(config).of_actions)
    return ControlConfig(radius_m=config.robot.radius_m, motions=motions)


def _odometry(config: SimulatorConfig) -> OdometryConfig:
    return config.robot.odometry or odometry_of(config.noise)


def _rated(rating: ExplorerName, config: ExplorerConfig) -> FrontierExplorer:
    return FrontierExplorer(replace(config, rating=rating))


nearest_explorer = partial(_rated, "nearest")
cheapest_explorer = partial(_rated, "cheapest")
gain_explorer = partial(_rated, "gain")


def learned_explorer(config: ExplorerConfig) -> FrontierExplorer:
    """Chooses among frontiers by the shipped network."""
    return FrontierExplorer(replace(config, rating="learned"), load_chooser(shipped_network("explorer")))


def learned_controller(config: ControlConfig) -> LearnedController:
    """Chooses actions by the shipped network."""
    return load_steering(shipped_network("steering"), config)


def neural_mapper(config: MapperConfig) -> Mapper:
    """The mapper with the shipped network."""
    return mapper_of_file(shipped_network("mapper"), config)


def mapper_of_file(path: Path, config: MapperConfig) -> Mapper:
    """A mapper with a network of its own."""
    from slam.mapping.neural import NeuralMapper
    from slam.networks.files import load_mapper

    return NeuralMapper(load_mapper(path)[0], config)


def learned_pose_mapper(config: MapperConfig) -> Mapper:
    """The classical mapper with the pose found by the shipped network instead of by scan matching."""
    from slam.mapping.learned_matching import LearnedMatcher
    from slam.networks.files import load_pose

    return ClassicalMapper(config, LearnedMatcher(load_pose(shipped_network("pose"))[0]))


@cache
def odometry_of(noise: NoiseModel) -> OdometryConfig:
    """What a calibration of the simulated robot's odometry finds, on an open floor, against its true motions.

    The runs are cached on disk, by all that they depend on.
    """

    def run() -> Float[np.ndarray, "2 actions runs 3"]:
        world, rng = KinematicWorld(open_floor()), np.random.default_rng(0)
        runs = run_actions(world, noise, range(CALIBRATION_RUNS), rng)
        return np.array([[part[action] for action in Action] for part in runs])

    made_of = [repr((noise, CALIBRATION_RUNS, shapely.__version__, shapely.geos_version)).encode()]
    errors, motions = (
        dict(zip(Action, part, strict=True))
        for part in cached_array("odometry", made_of, _code_of_runs(), run)
    )
    return calibrated(errors, motions)


def _code_of_runs() -> list[Path]:
    """Files of Python that may say how the robot moves on the open floor, and how that is measured: all of ours."""
    folders = [Path(str(file)).parent for file in (__file__, slam.__file__, wireless.__file__)]
    return [file for folder in folders for file in sorted(folder.rglob("*.py"))]
