"""Agents of episodes drive the robot of an environment."""

import gymnasium
import numpy as np
import pytest

from robosim.environments.baseline import Baseline
from tests.plans import two_rooms

PLAN = two_rooms(0.8)


@pytest.mark.parametrize("actions", ["discrete", "velocity"])
@pytest.mark.parametrize("goal", ["oracle", "fused"])
def test_baseline_arrives(goal, actions):
    """In two rooms with a door of 0.8 m, in two searches after each other: within 200 steps."""
    env = gymnasium.make(
        "robosim/TargetSearch-v1", plan=PLAN, targets=2, actions=actions, max_episode_steps=200
    )
    agent = Baseline(env, goal)
    for seed in range(2):
        env.reset(seed=seed)
        arrived = ended = False
        while not (arrived or ended):
            _, _, arrived, ended, _ = env.step(agent.act())
        assert arrived
    env.close()


def test_baseline_has_one_result_for_a_seed():
    """The same poses in two environments, exactly."""
    poses = []
    for _ in range(2):
        env = gymnasium.make("robosim/TargetSearch-v1", plan=PLAN, targets=2)
        agent = Baseline(env, "fused")
        env.reset(seed=5)
        poses.append([env.step(agent.act())[4]["pose"] for _ in range(15)])
    np.testing.assert_array_equal(*poses)


def test_baseline_names_what_is_missing():
    """Another environment, and a policy that needs the radio without one."""
    with pytest.raises(ValueError, match="expected robosim/TargetSearch-v1"):
        Baseline(gymnasium.make("CartPole-v1"))
    env = gymnasium.make("robosim/TargetSearch-v1", plan=PLAN, observe=("depth",))
    agent = Baseline(env, "fused")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="needs a radio"):
        agent.act()
