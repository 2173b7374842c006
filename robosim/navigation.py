"""The navigator: mapper, planner, controller and explorer of one robot.

They know of the robot what its builder knows: the optics and height of its camera, the radius of its hull, and the mean
error of its odometry for each action, which a calibration run gives.
"""

import json
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robosim.parts import CONTROLLER, EXPLORER, MAPPER
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.robot.calibration import open_floor, run_actions
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.from_dict import from_dict
from robosim.support.installation import assets_dir, shipped_network
from robosim.support.parts import Part
from robosim.support.reading import FileError, naming
from slam.control.controller import LocalPolicy
from slam.exploration.choosing import load_chooser
from slam.exploration.explorer import LEARNED, Explorer, ExplorerConfig, ExplorerName, FrontierExplorer
from slam.grid import GridFrame
from slam.mapping.classical import Mapper, MapperConfig
from slam.mapping.known_map import KnownMap
from slam.mapping.known_map_mapper import KnownMapMapper
from slam.mapping.moving import MovingConfig
from slam.odometry import OdometryConfig, calibrated
from slam.planning.planner import Planner
from slam.robot import Robot
from slam.sensing.projection import Band

#: How often each action is run to calibrate the odometry of a robot without a calibration.
CALIBRATION_RUNS = 1000
#: Robots may look wider than they are by this [m].
_WIDER_M = 0.1


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
    known_map: str | None = None,
    *,
    others_m: float = 0.0,
) -> Navigator:
    """Make the navigator of the simulated robot, of classical parts where no others are named.

    `known_map` is a floor plan that the robot knows; its mapper is then `slam.mapping.known_map_mapper`. Other
    robots, the widest `others_m` wide [m], are tracked as people are; 0: it meets none.
    """
    robot = calibrated_robot(config)
    mapping = MapperConfig(
        # Obstacles higher than the mast and the camera on it do not stop the robot.
        band=Band(high_m=robot.mast_m + 0.1),
        moving=MovingConfig(
            tracks=(config.movers.any or others_m > 0) and config.movers.tracking,
            # What is wider than the robots is part of the building.
            width_m=MovingConfig.width_m if config.movers.any else others_m + _WIDER_M,
        ),
    )
    return Navigator(
        MAPPER.make(mapper, robot, mapping, field="mapper")
        if known_map is None
        else KnownMapMapper(read_known_map(known_map)[1], robot, mapping),
        Planner(robot),
        CONTROLLER.make(controller, robot, field="controller"),
        EXPLORER.make(explorer, robot, field="explorer"),
    )


def read_known_map(name: str) -> tuple[FloorPlan, KnownMap]:
    """Read a floor plan, and the map of it on which robots are located; FileError as of `known_map_of`."""
    plan = read_plan(name)
    with naming(name, "a known map"):
        return plan, known_map_of(plan)


def known_map_of(plan: FloorPlan) -> KnownMap:
    """Return a floor plan as a map on which robots are located.

    Raises:
        FileError: If its axes are turned against those of `map`, or it has no free or no occupied cell.
    """
    if plan.origin[2]:
        raise FileError(
            f"{plan.name}: the origin of the map is turned by {plan.origin[2]:g} rad, expected 0. Turn the "
            "image instead."
        )
    frame = GridFrame(origin_xy=plan.origin[:2], resolution_m=plan.resolution_m, shape=plan.occupancy.shape)
    try:
        return KnownMap(plan.occupancy == OCCUPIED, plan.occupancy == FREE, frame)
    except ValueError as error:
        raise FileError(f"{plan.name}: {error}") from error


def calibrated_robot(config: SimulatorConfig) -> RobotConfig:
    """The simulated robot with the errors of its odometry, by default those of its noise on an open floor."""
    return replace(config.robot, odometry=config.robot.odometry or odometry_of(config.robot.noise))


def _rated(rating: ExplorerName, robot: Robot) -> FrontierExplorer:
    return FrontierExplorer(robot, ExplorerConfig(rating=rating))


nearest_explorer = partial(_rated, "nearest")
cheapest_explorer = partial(_rated, "cheapest")
gain_explorer = partial(_rated, "gain")
tour_explorer = partial(_rated, "tour")


def learned_explorer(robot: Robot) -> FrontierExplorer:
    """Chooses among frontiers by the shipped network."""
    config = ExplorerConfig(rating="learned", **LEARNED)
    return FrontierExplorer(robot, config, load_chooser(shipped_network("explorer")))


def neural_mapper(robot: Robot, config: MapperConfig) -> Mapper:
    """The mapper with the shipped network."""
    return mapper_of_file(shipped_network("mapper"), robot, config)


def mapper_of_file(path: Path, robot: Robot, config: MapperConfig) -> Mapper:
    """A mapper with a network of its own."""
    from slam.mapping.neural import NeuralMapper
    from slam.networks.files import load_mapper

    return NeuralMapper(load_mapper(path)[0], robot, config)


@cache
def odometry_of(noise: NoiseModel) -> OdometryConfig:
    """Result of a calibration of the simulated robot's odometry on an open floor, with true motions as reference.

    Results for common noise models are shipped. Others are computed in each process, which takes 0.2 s.
    """
    return _shipped_odometry().get(noise) or calibrate_odometry(noise)


def calibrate_odometry(noise: NoiseModel) -> OdometryConfig:
    """Run each action `CALIBRATION_RUNS` times and estimate the errors."""
    runs = run_actions(KinematicWorld(open_floor()), noise, range(CALIBRATION_RUNS), np.random.default_rng(0))
    return calibrated(*runs)


@cache
def _shipped_odometry() -> dict[NoiseModel, OdometryConfig]:
    rows = json.loads((assets_dir() / "weights" / "odometry.json").read_bytes())
    return {from_dict(NoiseModel, row["noise"]): from_dict(OdometryConfig, row["odometry"]) for row in rows}
