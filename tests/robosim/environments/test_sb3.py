"""Searches as a vector environment of Stable-Baselines3."""

import sys

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from robosim import sb3_vec_env
from tests.plans import two_rooms

OPTIONS = {"plan": two_rooms(0.8), "observe": ("lidar", "odometry"), "targets": 2}


@pytest.fixture(autouse=True)
def threads():
    """As many threads of PyTorch after a test as before."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_ppo_learns_without_an_adapter():
    env = sb3_vec_env(4, max_episode_steps=20, **OPTIONS)
    policy = PPO("MultiInputPolicy", env, n_steps=32, batch_size=32, seed=0).learn(256)
    assert policy.num_timesteps == 256
    lengths = [episode["l"] for episode in policy.ep_info_buffer]
    assert len(lengths) >= 8 and max(lengths) == 20
    env.close()


def test_it_does_step_for_step_what_lone_environments_do():
    """Observations, rewards and infos; of a search that has ended its last observation, and the first of the next."""
    ours = sb3_vec_env(2, seed=4, max_episode_steps=7, **OPTIONS)
    lone = [gymnasium.make("robosim/TargetSearch-v1", max_episode_steps=7, **OPTIONS) for _ in range(2)]
    seen = ours.reset()
    for i, env in enumerate(lone):
        first, _ = env.reset(seed=4 + i)
        assert all(np.array_equal(seen[key][i], first[key]) for key in first)
    ended, rng = 0, np.random.default_rng(0)
    for _ in range(20):
        actions = rng.choice([0, 0, 1, 2], 2)
        seen, rewards, dones, infos = ours.step(actions)
        for i, env in enumerate(lone):
            last, reward, arrived, late, info = env.step(actions[i])
            assert rewards[i] == pytest.approx(reward, abs=1e-6)
            assert sum(infos[i]["rewards"].values()) == pytest.approx(reward)
            assert infos[i]["distance_m"] == info["distance_m"]
            assert dones[i] == (arrived or late) and infos[i]["TimeLimit.truncated"] == (late and not arrived)
            if dones[i]:
                final = infos[i]["terminal_observation"]
                assert all(np.array_equal(final[key], last[key]) for key in last)
                assert infos[i]["episode"]["l"] == 7
                last, _ = env.reset()
                ended += 1
            assert all(np.array_equal(seen[key][i], last[key]) for key in last)
    assert ended >= 4
    ours.close()


@pytest.mark.parametrize(("threads", "after"), [(1, 1), (2, 2), (None, 3)])
def test_one_thread_unless_something_else_is_asked_for(threads, after):
    torch.set_num_threads(3)
    sb3_vec_env(1, threads=threads, **OPTIONS)
    assert torch.get_num_threads() == after


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"threads": 0}, "threads is 0"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
    ],
)
def test_senseless_settings_are_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        sb3_vec_env(**{**OPTIONS, **options})


def test_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.monitor", None)
    with pytest.raises(ImportError, match="pip install stable-baselines3"):
        sb3_vec_env()
