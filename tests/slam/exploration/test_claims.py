"""Frontiers that are left to other robots."""

import numpy as np

from slam.exploration.claims import unclaimed
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
