"""A recorded episode for the tests of what is read and drawn from it."""

import numpy as np
import pytest

from robosim.episode_config import EpisodeConfig
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from tests.plans import two_rooms


@pytest.fixture(scope="package")
def recorded(tmp_path_factory):
    """An episode with radio, camera and a belief."""
    folder = tmp_path_factory.mktemp("episode")
    kinematic = SimulatorConfig(physics="kinematic")
    config = EpisodeConfig(goal="fused", link_states="true", seed=2, simulator=kinematic, max_steps=24)
    start, target = np.array([1.0, 0.6, 2.0]), np.array([5.0, 2.4])
    record_episode(two_rooms(0.8), config, folder, start=start, target=target)
    return folder
