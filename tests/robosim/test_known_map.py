"""Episodes in a building that the robot knows."""

from dataclasses import replace

import numpy as np
import pytest

from robosim import EpisodeConfig, SimulatorConfig, make_building, make_task, reach, read_plan, run_episode
from robosim.navigation import known_map_of
from robosim.support.reading import FileError
from slam.mapping.classical import ClassicalMapper

CONFIG = EpisodeConfig(
    goal="oracle", known_map="flat", simulator=SimulatorConfig(physics="kinematic"), max_steps=15
)


def test_known_map_is_explored_at_once_and_locates_the_robot():
    """All rooms are known at the first decision, and the pose stays within a cell."""
    building = make_building(read_plan("flat"))
    places = reach(building, radius_m=0.10)
    errors, coverage = [], []

    def record(log, step):
        errors.append(np.hypot(*(step.estimated.pose - step.true.pose)[:2]))
        coverage.append(step.estimated.map.explored.sum() * 0.05**2)

    run_episode(building, places, make_task(places, np.random.default_rng(2)), CONFIG, record)
    assert len(errors) == 15 and max(errors) < 0.05
    assert min(coverage) > building.free.area


def test_known_map_of_a_turned_plan_is_rejected():
    plan = replace(read_plan("flat"), origin=(0.0, 0.0, 0.5))
    with pytest.raises(FileError, match=r"flat: the origin of the map is turned by 0\.5 rad"):
        known_map_of(plan)


def test_known_map_with_another_mapper_is_rejected():
    with pytest.raises(ValueError, match="mapper is given with known_map"):
        replace(CONFIG, mapper=ClassicalMapper)
