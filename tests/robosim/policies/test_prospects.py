"""Prospects: belief counts for the frontier on the route to it."""

import math

import numpy as np
import pytest

from robosim.policies.prospects import AT_ROBOT_M, Prospect, find_prospects
from robosim.policies.route_directions import MapSurvey
from slam.exploration.frontiers import Frontier
from slam.grid import GridFrame, MapEstimate

ONTO = GridFrame(origin_xy=(-10.0, -10.0), resolution_m=0.2, shape=(100, 100))


def seen_room(half_m: float) -> MapEstimate:
    """A square around the origin was seen and is free; nothing is known beyond."""
    frame = GridFrame(origin_xy=(-6.0, -6.0), resolution_m=0.05, shape=(240, 240))
    at = np.abs(np.arange(240) * 0.05 - 6 + 0.025) <= half_m
    seen = at[:, None] & at[None]
    return MapEstimate(
        frame=frame,
        obstacle_probability=np.where(seen, 0.1, 0.5).astype(np.float32),
        explored=seen,
        blocked=np.zeros(frame.shape, bool),
        pose=np.zeros(3),
    )


def at(x: float, y: float) -> np.ndarray:
    """All of the belief in one cell."""
    p = np.zeros(ONTO.shape, np.float32)
    p[tuple(int(i) for i in ONTO.index(np.array([x, y])))] = 1
    return p


def frontier(x: float, y: float) -> Frontier:
    place = np.array([x, y])
    return Frontier(goal_xy=place, near_xy=place, cost_m=math.hypot(x, y), length_m=1.0)


def found(frontiers: list[Frontier], p: np.ndarray, half_m: float, yaw: float = 0.0) -> list[Prospect]:
    map_ = seen_room(half_m)
    routes = MapSurvey(map_, ONTO).routes(np.zeros(2))
    return find_prospects(frontiers, routes, p, ONTO, np.array([0.0, 0.0, yaw]), head_start=10.0, count=12)


def test_belief_counts_for_the_frontier_on_its_route():
    """The target 5 m ahead, beyond the frontier at 2 m: 1 over 20 decisions of 0.25 m and 10 more."""
    ahead, left = found([frontier(2.0, 0.0), frontier(0.0, 2.0)], at(5.1, 0.1), 2.0)
    assert ahead.behind == pytest.approx(1 / (5.1 / 0.25 + 10), rel=0.02)
    assert left.behind == 0
    assert ahead.decisions == pytest.approx(8)
    assert left.decisions == pytest.approx(8 + 9)


def test_turning_counts():
    """The same behind the robot: 18 turns of 10 degrees more."""
    (behind,) = found([frontier(-2.0, 0.0)], at(-5.1, 0.1), 2.0)
    assert behind.behind == pytest.approx(1 / (5.1 / 0.25 + 18 + 10), rel=0.02)


def test_at_the_robot_the_direction_counts():
    """Seen to 0.4 m only, the target to the left at 3 m: one prospect 0.6 m in its direction."""
    (ahead,) = found([frontier(-0.4, 0.0), frontier(0.0, -0.4)], at(0.1, 3.1), 0.4)
    angle = math.atan2(ahead.goal_xy[1], ahead.goal_xy[0])
    assert abs(angle - math.atan2(3.1, 0.1)) < math.radians(45)
    assert math.hypot(*ahead.goal_xy) == pytest.approx(AT_ROBOT_M)
    assert ahead.behind == pytest.approx(1 / (3.1 / 0.25 + abs(angle) / math.radians(10) + 10), rel=0.1)


def test_without_frontiers_there_is_nowhere_to_go():
    assert found([], at(3.0, 0.0), 0.4) == []
