"""Settings of `fused` that remove one input, or give the truth about it."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.navigation import make_navigator
from robosim.policies.fused import FusedConfig
from robosim.policies.goals import PolicyContext, make_policy
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import Simulator, SimulatorConfig
from robosim.task.tasks import Task, make_task
from tests.plans import two_rooms


def test_fused_without_camera_does_not_see_the_target():
    """A metre ahead, its marker fills a quarter of the picture: seen by `fused` with a camera only."""
    building, task = make_building(two_rooms(0.8)), Task(np.array([3.9, 0.6, 0.0]), np.array([5.0, 0.6]), 0.8)
    seen = {}
    for uses_camera in (True, False):
        simulator = SimulatorConfig(physics="kinematic")
        config = EpisodeConfig(goal="fused", simulator=simulator, fused=FusedConfig(uses_camera=uses_camera))
        policy = make_policy(
            config.goal, PolicyContext(explorer=make_navigator(config.simulator).explorer, fused=config.fused)
        )
        simulator = Simulator(building, config.simulator, uses_camera=policy.uses_camera)
        seen[uses_camera] = simulator.reset(task, np.random.default_rng(0)).target
        simulator.close()
    assert seen[True] == pytest.approx([1.1, 0.0], abs=0.05)
    assert seen[False] is None


@pytest.mark.parametrize("mapper", ["classical", "neural"])
def test_exact_odometry_gives_the_true_pose(mapper):
    """Published noise of motion, 40 decisions: the estimate is the true pose to 0.1 mm, else off by 5 mm or more."""
    building = make_building(two_rooms(0.8))
    places = reach(building, 0.1)
    task = make_task(
        places, np.random.default_rng(0), start=np.array([0.6, 0.5, 2.0]), target=np.array([5.6, 2.5])
    )
    worst = {}
    for exact in (True, False):
        simulator = SimulatorConfig(
            physics="kinematic", robot=RobotConfig(noise=NoiseModel(exact_odometry=exact))
        )
        config = EpisodeConfig(goal="fused", simulator=simulator, mapper=mapper, max_steps=40)
        log, _ = run_episode(building, places, task, config)
        worst[exact] = np.abs(np.array(log.estimates) - log.poses)[:, :2].max()
    assert worst[True] < 1e-4
    assert worst[False] > 5e-3
