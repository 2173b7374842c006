"""TargetSearch-v0, which goes on as it was."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from tests.plans import two_rooms

#: Gymnasium says so whenever there is a later version.
pytestmark = pytest.mark.filterwarnings("ignore:.*The environment robosim/TargetSearch-v0 is out of date")

FAST = SimulatorConfig(physics="kinematic")


@pytest.fixture(params=["steps", "speeds"])
def env(request):
    made = gymnasium.make(
        "robosim/TargetSearch-v0",
        plan=two_rooms(0.8),
        continuous=request.param == "speeds",
        config=FAST,
        render_mode="rgb_array",
    )
    yield made
    made.close()


def test_gymnasium_accepts_it(env):
    check_env(env.unwrapped)


# Stable-Baselines takes any array with three axes for a picture; depth in metres does not fit into uint8.
@pytest.mark.filterwarnings("ignore:It seems that your observation.* depth is an image")
def test_stable_baselines_accepts_it(env):
    check_env_sb3(env.unwrapped)


def _rollout(env, seed: int, steps: int = 30):
    env.action_space.seed(seed)
    observation, info = env.reset(seed=seed)
    seen = [(observation, 0.0, info)]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        seen.append((observation, reward, info))
        if terminated or truncated:
            break
    return seen


def test_same_seed_same_rollout(env):
    """Bit for bit, pictures, odometry, rewards and true poses."""
    first, second = _rollout(env, 5), _rollout(env, 5)
    assert len(first) == len(second)
    for (a, reward_a, info_a), (b, reward_b, info_b) in zip(first, second, strict=True):
        assert all(np.array_equal(a[key], b[key]) for key in a)
        assert reward_a == reward_b
        assert np.array_equal(info_a["pose"], info_b["pose"])
    other = _rollout(env, 6)
    assert not np.array_equal(first[0][2]["pose"], other[0][2]["pose"])


def test_dynamic_physics_is_reproducible_too():
    env = gymnasium.make("robosim/TargetSearch-v0", plan=two_rooms(0.8))
    poses = [[info["pose"] for *_, info in _rollout(env, 3, 12)] for _ in range(2)]
    env.close()
    assert np.array_equal(poses[0], poses[1])


def test_driving_onto_the_target_ends_with_the_reward_of_arrival():
    """1.2 m ahead without noise: four steps of 0.25 m bring it within 0.3 m.

    Rewards sum to the drive saved, 1.0 m, less the cost of 4 steps, plus 10.
    """
    config = SimulatorConfig(physics="kinematic", noise=NoiseModel(level=0))
    env = gymnasium.make("robosim/TargetSearch-v0", plan=two_rooms(0.8), config=config)
    env.reset(seed=0, options={"start": [1.0, 1.5, 0.0], "target": [2.2, 1.5]})
    rewards = []
    for step in range(4):
        _, reward, terminated, truncated, info = env.step(0)
        rewards.append(reward)
        assert terminated == info["arrived"] == (step == 3)
        assert not truncated
    env.close()
    assert sum(rewards) == pytest.approx(10 + 1.0 - 0.04, abs=0.03)


def test_unknown_options_are_rejected():
    env = gymnasium.make("robosim/TargetSearch-v0", plan=two_rooms(0.8), config=FAST)
    with pytest.raises(ValueError, match=r"Known: start, target"):
        env.reset(options={"goal": [1, 1]})
    env.close()


def test_an_episode_is_truncated_after_a_thousand_steps():
    assert gymnasium.spec("robosim/TargetSearch-v0").max_episode_steps == 1000
