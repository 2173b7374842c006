"""Frontiers that are left to other robots."""

import numpy as np

from slam.exploration.claims import auctioned, unclaimed
from slam.exploration.frontiers import Frontier
from slam.grid import Claim, GridFrame
from slam.planning.travel_time import TravelTime, travel_time


def _corridor() -> TravelTime:
    """Travel time from the middle of a corridor of 10 m, along x."""
    frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.1, shape=(5, 100))
    return travel_time(frame, np.ones(frame.shape), np.ones(frame.shape, bool), (2, 50))


def _frontier(x: float, times: TravelTime) -> Frontier:
    place = np.array([x, 0.25])
    return Frontier(goal_xy=place, near_xy=place, cost_m=float(times.at(place)), length_m=1.0)


def test_unclaimed_leaves_what_another_reaches_sooner() -> None:
    times = _corridor()
    west, near, east = (_frontier(x, times) for x in (0.55, 4.55, 9.55))
    # It has 1 m to a place 1 m from the eastern end: 2.05 m to there, where the robot has 4.5 m.
    claim = Claim(xy=np.array([8.55, 0.25]), cost_m=1.0)
    assert unclaimed([west, near, east], [claim], times) == [west, near]


def test_unclaimed_counts_the_path_to_the_goal() -> None:
    times = _corridor()
    west, east = (_frontier(x, times) for x in (0.55, 9.55))
    claim = Claim(xy=np.array([8.55, 0.25]), cost_m=6.0)
    assert unclaimed([west, east], [claim], times) == [west, east]


def test_unclaimed_is_all_where_everything_is_claimed() -> None:
    times = _corridor()
    east = _frontier(9.55, times)
    assert unclaimed([east], [Claim(xy=np.array([9.0, 0.25]), cost_m=0.0)], times) == [east]


def test_unclaimed_goal_in_a_wall_counts_from_the_nearest_floor() -> None:
    times = _corridor()
    east = _frontier(9.55, times)
    assert unclaimed([east, _frontier(1.0, times)], [Claim(xy=np.array([9.5, 3.0]), cost_m=0.0)], times) != [
        east
    ]


def _auctioned(gain: list[float], visits: list[float], robots: list[float]) -> list[bool]:
    """Which visits the first robot wins along a line [m], where gains fall by a factor of e in 10 m."""
    at, of = np.array(visits), np.array(robots)
    first, between = (np.exp(-np.abs(places[:, None] - at) / 10.0) for places in (of, at))
    return list(auctioned(np.array(gain), first, between))


def test_auctioned_visits_go_to_the_nearer_robot() -> None:
    assert _auctioned([1.0, 1.0], [1.0, 9.0], [0.0, 10.0]) == [True, False]
    assert _auctioned([1.0, 1.0], [1.0, 9.0], [10.0, 0.0]) == [False, True]


def test_auctioned_visits_are_divided_among_robots_at_one_place() -> None:
    """One to each side, though the first robot is a little nearer to both."""
    assert sum(_auctioned([1.0, 1.0], [-9.0, 9.0], [0.0, 0.0])) == 1


def test_auctioned_visit_goes_to_a_robot_without_any_though_it_is_farther_away() -> None:
    """The first one is 4 m from both, 8 m apart; the other is 5 m from the second, and has nothing else to visit."""
    assert _auctioned([1.0, 0.5], [-4.0, 4.0], [0.0, 9.0]) == [True, False]


def test_auctioned_visit_is_made_by_the_robot_that_passes_it() -> None:
    assert _auctioned([1.0, 1.0, 1.0], [4.0, 5.0, -30.0], [0.0, -20.0]) == [True, True, False]
