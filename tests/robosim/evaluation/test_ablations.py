"""Variants of `fused`: each removes one thing, or gives the truth about it."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.cli import main
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.ablations import POLICY, configured
from robosim.evaluation.episodes import make_jobs
from robosim.evaluation.evaluate import check_policies
from robosim.evaluation.suite import Suite, SuiteTask
from robosim.navigation import make_navigator
from robosim.parts import GOAL
from robosim.policies.goals import PolicyContext, make_policy
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import Simulator, SimulatorConfig
from robosim.task.tasks import Task, make_task
from tests.plans import two_rooms


def test_without_vision_the_target_before_the_camera_is_not_seen():
    """A metre ahead, its marker fills a quarter of the picture: seen by `fused`, not by its variant."""
    building, task = make_building(two_rooms(0.8)), Task(np.array([3.9, 0.6, 0.0]), np.array([5.0, 0.6]), 0.8)
    seen = {}
    for name in ("fused", "fused-no-vision"):
        config = configured(EpisodeConfig(simulator=SimulatorConfig(physics="kinematic")), name)
        policy = make_policy(
            config.goal, PolicyContext(explorer=make_navigator(config.simulator).explorer, fused=config.fused)
        )
        simulator = Simulator(building, config.simulator, uses_camera=policy.uses_camera)
        seen[name] = simulator.reset(task, np.random.default_rng(0)).target
        simulator.close()
    assert seen["fused"] == pytest.approx([1.1, 0.0], abs=0.05)
    assert seen["fused-no-vision"] is None


@pytest.mark.parametrize("mapper", ["classical", "neural"])
def test_with_the_true_pose_the_map_lies_true(mapper):
    """Published noise of motion, 40 decisions: the estimate is the true pose to 0.1 mm, else off by 5 mm or more."""
    building = make_building(two_rooms(0.8))
    places = reach(building, 0.1)
    task = make_task(
        places, np.random.default_rng(0), start=np.array([0.6, 0.5, 2.0]), target=np.array([5.6, 2.5])
    )
    worst = {}
    for name in ("fused", "fused-true-pose"):
        base = EpisodeConfig(simulator=SimulatorConfig(physics="kinematic"), mapper=mapper, max_steps=40)
        log, _ = run_episode(building, places, task, configured(base, name))
        worst[name] = np.abs(np.array(log.estimates) - log.poses)[:, :2].max()
    assert worst["fused-true-pose"] < 1e-4
    assert worst["fused"] > 5e-3


def test_a_variant_is_replayed_as_it_was_evaluated(tmp_path):
    """What `robosim episode --goal NAME` runs is what the evaluation ran, to the last setting."""
    task = SuiteTask(plan="flat", number=0, start=(1.0, 1.0, 0.0), target=(2.0, 2.0))
    suite = Suite(plans={"flat": tmp_path}, tasks=(task,))
    base = EpisodeConfig(simulator=SimulatorConfig(robot=RobotConfig(noise=NoiseModel(level=0.5))))
    for job in make_jobs(suite, base, POLICY.names, 1, ""):
        assert job.config == replace(configured(base, job.policy), seed=job.config.seed)
        assert job.name == f"flat/000-{job.policy}-0"


def test_variants_run_only_if_asked_for():
    assert check_policies([]) == tuple(name for name in GOAL.names if name != "explore")
    assert check_policies(["fused-no-aod", "oracle"]) == ("oracle", "fused-no-aod")
    with pytest.raises(
        ValueError, match=r"policies is 'fused-no-aot'\. Did you mean 'fused-no-aod'\? Known: oracle"
    ):
        check_policies(["fused-no-aot"])


def test_a_variant_is_evaluated(tmp_path):
    """One is no goal policy by its own name: what is checked before the work is its configuration."""
    main(
        "evaluate flat --policies fused-no-aod --targets 1 --max-steps 2 --mapper classical --physics kinematic "
        f"--camera embree --image.height 32 --workers 1 --out {tmp_path / 'out'}".split()
    )
    rows = pq.read_table(tmp_path / "out" / "episodes.parquet").to_pylist()
    assert [row["policy"] for row in rows] == ["oracle", "fused-no-aod"]
