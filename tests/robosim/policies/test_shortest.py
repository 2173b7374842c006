"""The policy `shortest`: its map is the building, and its path the shortest one."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode import EpisodeConfig, run_episode
from robosim.plans.files import read_plan
from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task
from tests.plans import turned


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_it_drives_the_shortest_path(degrees):
    """Without noise: as long as the path of the hull's centre, except for turns in steps; no bump."""
    building = make_building(turned(read_plan("flat"), degrees))
    places = reach(building, 0.1)
    task = make_task(places, np.random.default_rng(3), min_path_m=6.0)
    simulated = SimulatorConfig(
        physics="kinematic", camera="none", lidar="lds-01", noise=NoiseModel(level=0.0)
    )
    log, _ = run_episode(
        building, places, task, EpisodeConfig(goal="shortest", mapper="classical", simulator=simulated)
    )
    result = log.result()
    assert log.ended == "arrived"
    assert result["path_length_m"] < 1.1 * task.shortest_m + 0.3
    assert result["collisions"] == 0
    np.testing.assert_array_equal(log.poses, log.estimates)
