"""Movers among several robots."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.movers.crowd import Crowd, CrowdAsMet
from robosim.movers.mover import Body
from robosim.movers.walkers import Walkers
from tests.plans import room

BUILDING = make_building(room(8.0, 4.0))
ROBOTS = np.array([[1.0, 1.0, 0.0], [1.0, 3.0, 0.0]])


class Noted:
    """A body that goes ahead at 1 m/s, and notes the times of its poses, and where the other robot was."""

    bodies = (Body(),)

    def reset(self, surroundings, rng) -> None:
        self.times, self.others, self._live = [], [], surroundings.others

    def poses(self, time_s, robot):
        self.times.append(time_s)
        self.others.append(self._live[0, :2].copy())
        return np.array([[time_s, 2.0, 0.0]])


def begun(mover) -> tuple[Crowd, list[CrowdAsMet]]:
    crowd = Crowd([mover], [0.1, 0.1])
    crowd.reset(BUILDING, ROBOTS, np.random.default_rng(0))
    return crowd, [CrowdAsMet(crowd, number) for number in range(2)]


def test_robots_meet_movers_where_they_were_at_their_time():
    """Each goes once through each time, for as long as the longest action."""
    mover = Noted()
    crowd, (first, second) = begun(mover)
    for begin_s, lengths_s in ((0.0, (0.9, 0.5)), (0.9, (0.3, 1.04)), (1.94, (0.2, 0.2))):
        crowd.begin_step(begin_s, ROBOTS, ROBOTS[:, :2])
        for met, robot, length_s in zip((first, second), ROBOTS, lengths_s, strict=True):
            for time_s in begin_s + np.linspace(0, length_s, 7):
                assert met.poses(time_s, robot)[0, 0] == pytest.approx(time_s)
    assert mover.times == pytest.approx(0.1 * np.arange(len(mover.times)))


def test_robots_that_act_later_are_expected_on_their_course():
    mover = Noted()
    crowd, (first, _) = begun(mover)
    crowd.begin_step(0.0, ROBOTS, ROBOTS[:, :2] + [0.5, 0.0])
    first.poses(0.5, ROBOTS[0])
    assert mover.others[-1] == pytest.approx([1.25, 3.0])


@pytest.mark.parametrize("number", [0, 1])
def test_people_do_not_enter_any_robot(number):
    _, met = begun(Walkers(8))
    places = np.array([met[number].poses(0.1 * k, ROBOTS[number])[:, :2] for k in range(600)])
    gaps_m = np.hypot(*np.moveaxis(places[:, :, None] - ROBOTS[:, :2], -1, 0))
    assert gaps_m.min() > Body().radius_m + 0.1
    # At first they keep away from both.
    assert gaps_m[0].min() > 1.5
