"""An agent along a recorded drive: its poses are those that `map_log` estimates from the same log."""

from dataclasses import replace

import numpy as np
import pytest

from robosim.agent import Agent
from robosim.logs.log_files import read_log
from robosim.logs.log_mapping import map_log
from robosim.logs.log_observations import mapper_of, observations
from robosim.navigation import make_navigator
from robosim.policies.goals import Explore, PolicyContext
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from slam.actions import Velocity
from slam.poses import between
from tests.robot_logs import Drive


def agent_of(log):
    """An agent that explores, with the errors of the log's odometry."""
    robot = RobotConfig(camera=None, lidar="rplidar-a1")
    navigator = make_navigator(SimulatorConfig(robot=robot))._replace(mapper=mapper_of(log))
    agent = Agent(navigator, Explore(PolicyContext(explorer=navigator.explorer)), robot)
    agent.reset(np.zeros(3))
    return agent


def poses_along(log):
    """Estimated poses, and the decisions made there."""
    agent = agent_of(log)
    decisions = [agent.act(sensed) for sensed in observations(log)]
    return np.array([decision.estimates.pose for decision in decisions if decision is not None]), decisions


def test_agent_follows_a_made_log(tmp_path):
    """A drive round a small building: within 5 cm and 0.5 degrees of the truth; measured 1 mm and 0.04 degrees."""
    drive = Drive()
    (path := tmp_path / "drive.log").write_text(drive.raw())
    log = read_log(path)
    poses, decisions = poses_along(log)
    true = np.array([between(drive.route[0], pose) for pose in drive.route])
    error = np.array([between(a, b) for a, b in zip(true, poses, strict=True)])
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.05
    assert np.degrees(np.abs(error[:, 2])).max() < 0.5
    assert all(len(decision.path) for decision in decisions)


def test_observations_have_the_velocity_of_odometry(tmp_path):
    """Displacement over time; none before the first scan."""
    (path := tmp_path / "drive.log").write_text(Drive().raw())
    log = read_log(path)
    first, second, *_ = observations(log)
    assert first.action is None and first.time_s is None
    v, w, duration_s = second.action
    assert isinstance(second.action, Velocity)
    assert duration_s == pytest.approx(log.times[1] - log.times[0])
    assert (v * duration_s, w * duration_s) == pytest.approx((second.odometry[0], second.odometry[2]))


def test_agent_agrees_with_the_mapping_of_a_public_log(shared):
    """Over 100 scans of Freiburg 101, places ten scans apart: 5 cm and 0.5 degrees; measured 2 cm and 0.2 degrees."""
    log = read_log(shared / "data/robot-logs/freiburg-101-corrected.log.gz")
    rows = slice(0, 100)
    log = replace(
        log,
        range_m=log.range_m[rows],
        displacement=log.displacement[rows],
        known=log.known[rows],
        times=log.times[rows],
        reference=None,
    )
    poses, _ = poses_along(log)
    expected = map_log(log).poses
    error = np.array(
        [
            between(between(expected[k], expected[k + 10]), between(poses[k], poses[k + 10]))
            for k in range(len(poses) - 10)
        ]
    )
    assert np.hypot(error[:, 0], error[:, 1]).mean() < 0.05
    assert np.degrees(np.abs(error[:, 2])).mean() < 0.5
