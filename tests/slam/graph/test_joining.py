"""Maps of two robots in made buildings: joined where they overlap without doubt, and apart otherwise."""

import math
from itertools import pairwise

import numpy as np
import pytest

from slam.graph.joining import join_maps, relative_pose
from slam.graph.links import Link, find_links, reverse_link
from slam.graph.tracker import Tracker
from slam.graph.tracker_config import TrackerConfig
from slam.matching.levels import difference
from slam.matching.scan_matching import MatchConfig
from slam.poses import between, compose
from tests.slam.beams import along, ranges, seen
from tests.slam.corridors import BUILDING, EAST, REGULAR, WEST, corridor

CONFIG = TrackerConfig(match=MatchConfig(max_range_m=12.0, sigma_m=0.02, outlier_m=0.06, iterations=12))
NOISE = np.diag([0.03, 0.03, 0.02]) ** 2


def track(walls: list, route: list[np.ndarray], seed: int) -> Tracker:
    """What a robot holds that drives a route; its map begins at (0, 0, 0)."""
    rng, tracker = np.random.default_rng(seed), Tracker(CONFIG)
    tracker.update(*seen(ranges(walls, route[0], rng)), np.zeros(3), 1e-10 * np.eye(3))
    for before, pose in pairwise(route):
        displacement = between(before, pose) + rng.multivariate_normal(np.zeros(3), NOISE)
        tracker.update(*seen(ranges(walls, pose, rng)), displacement, NOISE)
    tracker.finish()
    return tracker


@pytest.fixture(scope="module")
def team() -> list[Tracker]:
    return [track(BUILDING, WEST, 0), track(BUILDING, EAST, 1)]


def test_join_maps_places_a_robot_of_unknown_start(team):
    """16 m of overlap, driven in opposite directions: 0.15 m over 46 m of corridor, within four standard deviations."""
    before = [tracker.poses() for tracker in team]
    maps = join_maps(team, find_links(team, 0, 1))
    assert [joined.robots for joined in maps] == [[0, 1]]
    pose, covariance = relative_pose(maps, 1, 0)
    away = difference(pose, between(WEST[0], EAST[0]), 1.0)
    assert np.hypot(*away[:2]) < 0.3
    assert abs(away[2]) < math.radians(1.0)
    assert away @ np.linalg.solve(covariance, away) < 16.27
    # Where both were, walls are single.
    placed = np.array([compose(WEST[0], pose) for pose in maps[0].poses(1)])
    assert np.hypot(*(placed - np.array(EAST))[-20:, :2].T).max() < 0.15
    for tracker, poses in zip(team, before, strict=True):
        np.testing.assert_array_equal(tracker.poses(), poses)


def test_join_maps_is_deterministic(team):
    first, second = (join_maps(team, find_links(team, 0, 1))[0].poses(1) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    "other",
    [
        corridor(REGULAR, (36.0, -3.0, 44.0, 4.0)),
        corridor(tuple(x + 0.7 for x in REGULAR), (36.0, -1.0, 41.0, 6.0)),
    ],
    ids=["equal doors", "equal doors, shifted"],
)
def test_join_maps_leaves_equal_corridors_of_two_buildings_apart(other):
    """Doors every 3 m in both: many places agree, and as many after a shift by a door."""
    walls = corridor(REGULAR, (-6.0, -3.0, 0.0, 5.0))
    team = [track(walls, along([(-3, 1), (30, 1)]), 0), track(other, along([(40, 1), (4, 1)]), 1)]
    maps = join_maps(team, find_links(team, 0, 1))
    assert [joined.robots for joined in maps] == [[0], [1]]
    assert relative_pose(maps, 0, 1) is None


def test_join_maps_leaves_parts_that_do_not_overlap_apart():
    team = [track(BUILDING, along([(-4, 1), (6, 1)]), 0), track(BUILDING, along([(42, 1), (27, 1)]), 1)]
    assert [joined.robots for joined in join_maps(team, find_links(team, 0, 1))] == [[0], [1]]


def test_join_maps_takes_links_of_other_sensors_in_a_chain():
    """Robot 1 has measured the poses of 0 and 2 in six places each, one of them wrong by 5 m."""
    routes = along([(-5, 1), (13, 1)]), along([(42, 1), (28, 1)]), along([(10, 1), (26, 1)])
    team = [track(BUILDING, route, k) for k, route in enumerate(routes)]
    scans = [(1, 0), (10, 4), (12, 10), (19, 16), (28, 22), (32, 27)]
    links = [
        Link(
            robots=(1, other),
            scans=(j, k),
            pose=between(routes[1][j], routes[other][k]),
            covariance=1e-4 * np.eye(3),
        )
        for other in (0, 2)
        for k, j in scans
    ]
    links[2].pose[0] += 5.0
    maps = join_maps(team, links)
    assert sorted(maps[0].robots) == [0, 1, 2]
    for robot, other in ((1, 0), (2, 0), (1, 2)):
        pose, _ = relative_pose(maps, robot, other)
        assert np.hypot(*(pose - between(routes[other][0], routes[robot][0]))[:2]) < 0.3


def test_find_links_has_none_before_the_first_scan():
    assert find_links([Tracker(CONFIG), Tracker(CONFIG)], 0, 1) == []


def test_reverse_link_covariance_is_that_of_drawn_poses():
    """Against 20,000 drawn relative poses that are inverted."""
    rng, covariance = (
        np.random.default_rng(0),
        np.array([[4.0, 1.0, 0.2], [1.0, 2.0, -0.3], [0.2, -0.3, 1.0]]) * 1e-4,
    )
    link = Link(robots=(0, 1), scans=(3, 5), pose=np.array([2.0, -1.0, 0.7]), covariance=covariance)
    back = reverse_link(link)
    assert (back.robots, back.scans) == ((1, 0), (5, 3))
    drawn = link.pose + rng.multivariate_normal(np.zeros(3), covariance, 20_000)
    away = np.array([between(pose, np.zeros(3)) for pose in drawn]) - back.pose
    np.testing.assert_allclose(np.cov(away.T), back.covariance, atol=3e-5)
