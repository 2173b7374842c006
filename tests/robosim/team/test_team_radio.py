"""The radio between robots."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.radio.link import RadioLink
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import Task
from robosim.team.team_radio import TeamRadio
from robosim.world import World
from slam.poses import wrap
from tests.robosim.team.test_team_episode import three_rooms
from wireless.paths import LinkState

#: Poses in two rooms, which see each other through the door.
_POSES = {"a": (1.0, 2.05, 0.3), "b": (5.0, 2.05, -2.0)}


@pytest.fixture
def radio() -> TeamRadio:
    config = SimulatorConfig(physics="kinematic", camera="plan")
    world = World(make_building(three_rooms()), dict.fromkeys(_POSES, config))
    tasks = {name: Task(np.array(pose), np.array([6.0, 1.0]), 1.0) for name, pose in _POSES.items()}
    world.reset(tasks, np.random.default_rng(0))
    return TeamRadio(world.robots, "generated", np.random.default_rng(0))


def test_robots_in_sight_measure_directions_of_each_other(radio: TeamRadio) -> None:
    measured = radio.measure(_POSES)()
    for receiver, sender in (("a", "b"), ("b", "a")):
        (x, y, yaw), there = _POSES[receiver], _POSES[sender]
        measurement = measured[receiver][sender]
        bearing_rad = np.arctan2(there[1] - y, there[0] - x) - yaw
        assert abs(wrap(measurement.aoa_rad[0] - bearing_rad)) < np.radians(1.0)
        assert measurement.probability.argmax() == LinkState.LOS
        assert np.isnan(measurement.aod_rad).all()
    assert radio.rate_bps(("a", "b")) > 1e8


def test_links_are_sounded_once_and_only_if_their_measurements_are_read(
    radio: TeamRadio, monkeypatch: pytest.MonkeyPatch
) -> None:
    soundings, measure = [], RadioLink.measure
    monkeypatch.setattr(RadioLink, "measure", lambda *args: soundings.append(args) or measure(*args))
    measured = radio.measure(_POSES)
    assert radio.rate_bps(("a", "b")) > 0
    assert not soundings
    assert measured() is measured()
    assert len(soundings) == 2


def test_robots_that_were_lost_are_not_measured(radio: TeamRadio) -> None:
    assert radio.measure(["a"])() == {"a": {}, "b": {}}
