"""Robots that are sold: they drive as closed forms say, at the speeds of their makers."""

import numpy as np
import pytest

from robosim.commands.episode_config import command_options
from robosim.episode_config import EpisodeConfig
from robosim.parts import ROBOT
from robosim.robot.calibration import open_floor
from robosim.robot.dynamic import World
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.named import TURTLEBOT3_BURGER
from robosim.robot.robots import RobotConfig
from slam.poses import between

START = np.array([2.0, 2.0, 0.3])
NAMES = ("turtlebot3_burger", "turtlebot3_waffle", "turtlebot4", "create3", "jackal", "locobot")


@pytest.fixture(params=NAMES)
def robot(request: pytest.FixtureRequest) -> RobotConfig:
    made: RobotConfig = ROBOT.make(request.param)
    return made


@pytest.fixture(params=[KinematicWorld, World])
def world(request: pytest.FixtureRequest, robot: RobotConfig) -> KinematicWorld | World:
    made: KinematicWorld | World = request.param(open_floor(), robot=robot)
    return made


@pytest.mark.parametrize(
    "wanted", [(1.0, 0.0, 0.0), (-0.25, 0.0, 0.0), (0.0, 0.0, np.pi / 2), (0.0, 0.0, -0.175)]
)
def test_moves_end_where_they_were_sent(world: KinematicWorld | World, wanted: tuple[float, ...]) -> None:
    world.reset(START)
    assert not world.move(np.array(wanted)).collided
    np.testing.assert_allclose(between(START, world.pose), wanted, atol=5e-4)


def test_an_arc_is_a_circle(world: KinematicWorld | World) -> None:
    """Of radius v / w, after the wheels have their speeds."""
    v, w, time_s = 0.12, 0.25, 1.5
    world.reset(START)
    world.drive(v, w, 1.0)
    begin = world.pose
    world.drive(v, w, time_s)
    turn = w * time_s
    wanted = [v / w * np.sin(turn), v / w * (1 - np.cos(turn)), turn]
    np.testing.assert_allclose(between(begin, world.pose), wanted, atol=1e-3)


def test_top_speeds_are_those_of_the_maker(robot: RobotConfig) -> None:
    world = World(open_floor(), robot=robot)
    world.reset(np.array([0.5, 2.0, 0.0]))
    world.drive(99.0, 0.0, 1.0)
    begin = world.pose
    world.drive(99.0, 0.0, 0.1)
    reached = min(robot.max_speed_mps, robot.max_accel_mps2 * 1.0)
    assert between(begin, world.pose)[0] / 0.1 == pytest.approx(reached, rel=0.06)
    world.reset(START)
    world.drive(0.0, 99.0, 1.5)
    begin = world.pose
    world.drive(0.0, 99.0, 0.2)
    assert between(begin, world.pose)[2] / 0.2 == pytest.approx(robot.turn_rate_radps, rel=0.01)


def test_a_robot_brings_its_sensors() -> None:
    burger = EpisodeConfig().of_robot(TURTLEBOT3_BURGER)
    simulator = burger.simulator
    assert (simulator.camera, simulator.lidar, burger.mapper) == ("none", "lds-01", "classical")
    assert (simulator.laser.ahead_m, simulator.laser.height_m) == (-0.032, 0.182)
    waffle = EpisodeConfig().of_robot(ROBOT.make("turtlebot3_waffle")).simulator
    assert waffle.camera == EpisodeConfig().simulator.camera
    assert (waffle.image.ahead_m, waffle.image.height_m, waffle.image.hfov_deg) == (0.069, 0.117, 59.0)
    create = EpisodeConfig().of_robot(ROBOT.make("create3")).simulator
    assert create.image == EpisodeConfig().simulator.image and create.lidar == "none"


def test_options_of_a_robot_with_sensors_are_in_the_settings() -> None:
    options = command_options(EpisodeConfig().of_robot(TURTLEBOT3_BURGER))
    assert options.startswith("--config settings.json ") and "--lidar lds-01" in options
    assert "outline" not in options and "sensors" not in options
