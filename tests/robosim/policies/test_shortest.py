"""The policy `shortest`: its map is the building, and its path the shortest one."""

import numpy as np
import pytest
import shapely

from robosim.building.building import BuildingConfig, make_building
from robosim.building.reach import reach
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.policies.shortest import TrueMapper
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task
from slam.planning.clearance import Clearance
from tests.plans import turned, two_rooms


@pytest.mark.parametrize("degrees", [0.0, 31.0])
def test_its_map_is_the_building(degrees):
    """Floor and solid at random places, and how far the nearest wall is, within 3 cm."""
    plan = turned(two_rooms(0.8), degrees)
    building = make_building(plan, config=BuildingConfig(tolerance_m=0.0))
    estimate = TrueMapper(building, lambda: np.zeros(3)).estimate()
    rng, walls = np.random.default_rng(0), building.free.boundary
    low, high = np.array(building.free.bounds).reshape(2, 2)
    places = rng.uniform(low, high, (2000, 2))
    distance = shapely.distance(walls, shapely.points(places))
    free = shapely.contains_xy(building.free, *places.T)
    obstacle = estimate.obstacle_probability[estimate.frame.index(places)] > 0.5
    sure = distance > 0.08
    np.testing.assert_array_equal(obstacle[sure], ~free[sure])
    room = Clearance(estimate.frame, estimate.obstacle_probability > 0.5, estimate.surface_offset_m)
    near = free & (distance < 0.3)
    assert np.abs(room.at(places[near]) - distance[near]).max() < 0.03


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_it_drives_the_shortest_path(degrees):
    """Without noise: as long as the path of the hull's centre, except for turns in steps; no bump."""
    building = make_building(turned(read_plan("flat"), degrees))
    places = reach(building, 0.1)
    task = make_task(places, np.random.default_rng(3), min_path_m=6.0)
    simulated = SimulatorConfig(
        physics="kinematic", camera="none", robot=RobotConfig(lidar="lds-01", noise=NoiseModel(level=0.0))
    )
    log, _ = run_episode(
        building, places, task, EpisodeConfig(goal="shortest", mapper="classical", simulator=simulated)
    )
    result = log.result()
    assert log.ended == "arrived"
    assert result["path_length_m"] < 1.1 * task.shortest_m + 0.3
    assert result["collisions"] == 0
    np.testing.assert_array_equal(log.poses, log.estimates)
