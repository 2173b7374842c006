"""Searches as a Minari data set, read back by Minari."""

import gymnasium
import minari
import numpy as np
import pytest
from rich.console import Console

from robosim.environments.collect import CollectSearchesConfig, collect_searches
from robosim.environments.sources import route_action
from robosim.plans.formats.ros_map import write_ros
from robosim.support.run_folder import FolderError
from tests.plans import two_rooms


@pytest.fixture
def config(tmp_path) -> CollectSearchesConfig:
    write_ros(two_rooms(0.8), tmp_path / "rooms.yaml")
    return CollectSearchesConfig(
        plan=str(tmp_path / "rooms.yaml"), episodes=3, targets=2, observe=("depth", "lidar", "radio", "pose")
    )


def test_minari_reads_what_the_environment_said(config, tmp_path):
    """The same seed and the actions of the data set give its observations, rewards and ends again, bit for bit."""
    data = collect_searches(config, tmp_path / "run", Console(quiet=True))
    found = minari.MinariDataset(data)
    assert found.total_episodes == 3
    env = gymnasium.make(
        "robosim/TargetSearch-v1", plan=config.plan, observe=config.observe, targets=config.targets
    )
    assert found.observation_space == env.observation_space
    for number, episode in enumerate(found.iterate_episodes()):
        observation, _ = env.reset(seed=config.seed + number)
        for step, action in enumerate(episode.actions):
            for key, value in observation.items():
                assert np.array_equal(episode.observations[key][step], value), key
            observation, reward, terminated, *_ = env.step(int(action))
            assert reward == episode.rewards[step]
            assert terminated == episode.terminations[step]
        assert terminated
    env.close()


def test_a_run_is_resumed_and_another_configuration_rejected(config, tmp_path):
    """Three searches, then two more: the same as five at once."""
    from dataclasses import replace

    quiet = Console(quiet=True)
    collect_searches(config, tmp_path / "run", quiet)
    more = replace(config, episodes=5)
    grown = minari.MinariDataset(collect_searches(more, tmp_path / "run", quiet))
    whole = minari.MinariDataset(collect_searches(more, tmp_path / "other", quiet))
    for a, b in zip(grown.iterate_episodes(), whole.iterate_episodes(), strict=True):
        assert np.array_equal(a.actions, b.actions)
        assert np.array_equal(a.observations["lidar"], b.observations["lidar"])
    with pytest.raises(FolderError):
        collect_searches(replace(config, seed=9), tmp_path / "run", quiet)


def test_the_route_is_followed_through_a_door(config):
    """From one room to the other without noise of choice: arrival within twice the steps of the shortest drive."""
    env = gymnasium.make("robosim/TargetSearch-v1", plan=two_rooms(0.8), observe=("pose",)).unwrapped
    _, info = env.reset(seed=0, options={"start": [0.7, 0.6, np.pi], "target": [5.4, 2.4]})
    least, steps, arrived = info["distance_m"] / 0.25, 0, False
    while not arrived and steps < 200:
        _, _, arrived, _, info = env.step(int(route_action(env.current.place, info["pose"], info["target"])))
        steps += 1
    assert arrived
    assert steps < 2 * least + 18  # half a turn at first
