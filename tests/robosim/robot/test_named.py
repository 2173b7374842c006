"""Robots that are sold: they drive as closed forms say, at the speeds of their makers."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tyro

from robosim.camera.model import CameraConfig
from robosim.commands.episode_config import command_options, read_config, start_values
from robosim.environments.target_search import TargetSearch
from robosim.episode_config import EpisodeConfig
from robosim.lidar import LidarConfig
from robosim.parts import ROBOT
from robosim.robot.calibration import open_floor
from robosim.robot.dynamic import World
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.named import JACKAL, TURTLEBOT3_BURGER
from robosim.robot.robot_files import read_robot
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.files import write_json
from robosim.support.parts import to_dict
from robosim.support.reading import FileError
from robosim.team.team_config import TeamConfig
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


@pytest.mark.parametrize("name", ["turtlebot4", "turtlebot3_burger"])
def test_a_robot_is_the_same_wherever_it_is_named(tmp_path: Path, name: str) -> None:
    """In the simulator, on the command line, in the settings of an evaluation, and in an environment."""
    robot: RobotConfig = ROBOT.make(name)
    settings = tyro.cli(EpisodeConfig, default=start_values({}, ["--robot", name])["settings"], args=[])
    episode = EpisodeConfig().of_robot(robot)
    write_json(tmp_path / "settings.json", {"settings": {"episode": to_dict(episode)}})
    environment = TargetSearch("flat", config=SimulatorConfig(robot=robot), observe=("lidar",))
    configs = [
        SimulatorConfig(robot=robot),
        settings.simulator,
        episode.simulator,
        read_config(tmp_path / "settings.json").simulator,
        environment.current.simulator_config,
    ]
    sensors = [(config.robot, config.renderer, config.image) for config in configs]
    assert sensors == 5 * [(robot, "pyrender" if robot.camera else "none", robot.camera or CameraConfig())]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"outline_m": JACKAL.outline_m, "radius_m": 0.4}, "Leave one of them out"),
        ({"mast_m": 0.4}, "--image.height-m"),
        ({"lidar": "lds-01", "laser": LidarConfig(height_m=1.3)}, "--laser.height-m"),
        ({"laser": LidarConfig(ahead_m=0.1)}, "Name the lidar"),
    ],
)
def test_a_robot_rejects_what_contradicts_it(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RobotConfig(**fields)
    assert replace(JACKAL, mass_kg=20.0).hull == JACKAL.hull


@pytest.mark.parametrize(
    "words",
    ["--robot jackal --image.hfov-deg 60", "--robot jackal --camera embree", "--lidar none --laser.level 0"],
)
def test_options_of_missing_sensors_are_rejected(words: str) -> None:
    with pytest.raises(ValueError, match="the robot has no"):
        start_values({}, words.split())


def test_files_of_version_0_3_are_rejected(tmp_path: Path) -> None:
    """Sensors stood in other places: the messages name the file and the key."""
    robot, result = tmp_path / "robot.json", tmp_path / "result.json"
    robot.write_text(json.dumps({"mast_m": 0.3, "sensors": {"lidar": "lds-01"}}))
    with pytest.raises(FileError, match=r"robot\.json.*'sensors'"):
        read_robot(robot)
    result.write_text(json.dumps({"config": {"simulator": {"image": {"width": 64}}}}))
    with pytest.raises(FileError, match=r"result\.json.*'image'"):
        read_config(result)


def test_options_of_a_robot_with_sensors_are_in_the_settings() -> None:
    options = command_options(EpisodeConfig().of_robot(TURTLEBOT3_BURGER))
    assert options.startswith("--config settings.json ") and "--lidar lds-01" in options
    assert "outline" not in options and "sensors" not in options


def test_options_of_a_team_are_those_of_the_command_line() -> None:
    team = TeamConfig(robots="jackal,turtlebot4", exchange="none", lose=("1@5", "2@7"))
    options = command_options(EpisodeConfig(team=team))
    assert options == "--robots jackal,turtlebot4 --team.exchange none --team.lose 1@5 2@7"
