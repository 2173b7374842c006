"""Sensors ahead of the robot's centre: the map is the same as with sensors above it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.camera.model import CameraConfig, camera_pose
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.lidar import LidarConfig
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task
from slam.grid import MapEstimate
from tests.plans import two_rooms

SIMULATOR = SimulatorConfig(physics="kinematic", camera="plan", robot=RobotConfig(noise=NoiseModel(level=0)))


def _with(**sensors: Any) -> SimulatorConfig:
    return replace(SIMULATOR, robot=replace(SIMULATOR.robot, **sensors))


def _explore(simulator: SimulatorConfig, mapper: str) -> tuple[MapEstimate, float]:
    """The map after 40 steps, and the largest distance of an obstacle on it from a true wall [m]."""
    building = make_building(two_rooms(0.8))
    places = reach(building, *simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng(0), start=np.array([1.0, 1.0, 0.4]))
    config = EpisodeConfig(goal="explore", mapper=mapper, explorer="gain", max_steps=40, simulator=simulator)
    _, estimate = run_episode(building, places, task, config)
    found = estimate.frame.centres(estimate.obstacle_probability > 0.5)
    return estimate, float(shapely.distance(shapely.points(found), building.free.boundary).max())


@pytest.mark.parametrize("ahead_m", [0.3, -0.25])
def test_a_camera_may_be_ahead_or_behind(ahead_m: float) -> None:
    estimate, farthest_m = _explore(_with(camera=CameraConfig(ahead_m=ahead_m)), "classical")
    assert farthest_m < 0.06 and estimate.explored.sum() > 1000


@pytest.mark.parametrize("ahead_m", [0.3, -0.25])
def test_a_lidar_may_be_ahead_or_behind(ahead_m: float) -> None:
    laser = LidarConfig(ahead_m=ahead_m, level=0)
    estimate, farthest_m = _explore(_with(camera=None, lidar="rplidar-a1", laser=laser), "classical")
    assert farthest_m < 0.06 and estimate.explored.sum() > 1000


def test_the_learned_map_is_ahead_of_the_camera() -> None:
    """It predicts walls to a cell or two; a patch that is not where the camera is errs by the 0.3 m."""
    _, farthest_m = _explore(_with(camera=CameraConfig(ahead_m=0.3)), "neural")
    _, at_centre_m = _explore(SIMULATOR, "neural")
    assert farthest_m < at_centre_m + 0.1


def test_the_camera_is_where_it_is_configured() -> None:
    pose = camera_pose(np.array([1.0, 2.0, np.pi / 2]), CameraConfig(ahead_m=0.3, height_m=0.5))
    np.testing.assert_allclose(pose[:3, 3], [1.0, 2.3, 0.5], atol=1e-12)
