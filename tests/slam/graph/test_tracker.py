"""A robot that drives round a ring of corridors: odometry drifts, loops close, and the past is put right."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from robosim.logs.trajectory_scores import compare_trajectories
from slam.graph.least_squares import Constraint
from slam.graph.loop_closing import Pending
from slam.graph.submaps import Fit
from slam.graph.tracker import Tracker
from slam.graph.tracker_config import TrackerConfig
from slam.matching.scan_matching import Match, MatchConfig, ScanPoints
from slam.poses import between, compose
from tests.slam.beams import along, ranges, rectangle, seen

MATCHING = MatchConfig(max_range_m=12.0, sigma_m=0.02, outlier_m=0.06, iterations=12)
# A ring 24 m x 16 m of corridors 2 m wide, with doors' recesses that distinguish places.
RING = [
    *rectangle(0, 0, 24, 16),
    *rectangle(2, 2, 22, 14),
    *[side for x in (5, 11, 18) for side in rectangle(x, 0, x + 0.9, 0.3)],
    *[side for y in (4, 9) for side in rectangle(23.7, y, 24, y + 0.9)],
    *[side for x in (4, 13, 19) for side in rectangle(x, 15.7, x + 0.9, 16)],
    *[side for y in (6, 11) for side in rectangle(0, y, 0.3, y + 0.9)],
]
ROUTE = along([(1, 1), (23, 1), (23, 15), (1, 15), (1, 1), (23, 1), (23, 8)])
NOISE = np.diag([0.03, 0.03, 0.02]) ** 2


def driven(loops: bool, seed: int = 0) -> tuple[Tracker, np.ndarray]:
    """The tracker after the route, and distances from ground truth [m]."""
    rng = np.random.default_rng(seed)
    tracker = Tracker(TrackerConfig(loops=loops, match=MATCHING))
    tracker.reset(ROUTE[0])
    tracker.update(*seen(ranges(RING, ROUTE[0], rng)), np.zeros(3), 1e-10 * np.eye(3))
    for before, pose in pairwise(ROUTE):
        displacement = between(before, pose) + rng.multivariate_normal(np.zeros(3), NOISE)
        tracker.update(*seen(ranges(RING, pose, rng)), displacement, NOISE)
    tracker.finish()
    return tracker, np.hypot(*(tracker.poses() - np.array(ROUTE))[:, :2].T)


@pytest.fixture(scope="module")
def closed():
    return driven(loops=True)


def test_loops_close_and_put_the_past_right(closed):
    """103 m, the second round over the first: 3 cm between places 1 to 5 m apart, 0.6 of that without loops.

    The heading of the first scan, known to half a degree, moves the far side by 20 cm, loops or not.
    """
    tracker, off_m = closed
    matched, _ = driven(loops=False)
    assert tracker.closed > 5
    assert off_m.max() < 0.2
    with_loops, without = (
        compare_trajectories(one.poses(), np.array(ROUTE))["rpe_m"] for one in (tracker, matched)
    )
    assert with_loops < min(0.03, 0.6 * without)


def test_odometry_alone_is_far_off():
    """The same steps added up: metres, so that the test above tests something."""
    rng, pose = np.random.default_rng(0), ROUTE[0]
    for before, after in pairwise(ROUTE):
        pose = compose(pose, between(before, after) + rng.multivariate_normal(np.zeros(3), NOISE))
    assert math.hypot(*(pose - ROUTE[-1])[:2]) > 1.0


def test_one_seed_one_trajectory(closed):
    tracker, _ = closed
    again, _ = driven(loops=True)
    np.testing.assert_array_equal(tracker.poses(), again.poses())


def test_poses_of_the_past_move_with_the_graph(closed):
    """The present pose is the last one's, and each submap's scans stay as they were to each other."""
    tracker, _ = closed
    poses = tracker.poses()
    np.testing.assert_allclose(tracker.pose, poses[-1], atol=1e-9)
    submap = tracker.submaps[2]
    inside = sum(len(one.poses) for one in tracker.submaps[:2])
    for k, pose in enumerate(submap.poses):
        anchored = compose(tracker.graph.poses[2], pose)
        np.testing.assert_allclose(poses[inside + k], anchored, atol=1e-12)


def test_nothing_seen_leaves_odometry():
    """Scans without a point: the trajectory is the sum of the steps, and the pose ever less sure."""
    tracker = Tracker(TrackerConfig(match=MATCHING))
    nothing = seen(np.full(271, np.inf))
    step, spread = np.array([0.5, 0.0, 0.1]), []
    expected = np.zeros(3)
    for _ in range(30):
        tracker.update(*nothing, step, NOISE)
        expected = compose(expected, step)
        spread.append(float(np.trace(tracker.covariance)))
    np.testing.assert_allclose(tracker.pose, expected, atol=1e-9)
    assert spread[5] > spread[1]


def test_after_scans_that_saw_nothing_the_robot_is_found_again():
    """Four of them, while odometry loses it by 0.6 m: the next scan puts it within 0.1 m of where it is."""
    rng, tracker = np.random.default_rng(0), Tracker(TrackerConfig(match=MATCHING))
    tracker.reset(ROUTE[0])
    tracker.update(*seen(ranges(RING, ROUTE[0], rng)), np.zeros(3), 1e-10 * np.eye(3))
    for before, pose in pairwise(ROUTE[:12]):
        tracker.update(*seen(ranges(RING, pose, rng)), between(before, pose), NOISE)
    for _ in range(4):
        tracker.update(*seen(np.full(271, np.inf)), np.array([0.1, 0.1, 0.0]), np.diag([0.2, 0.2, 0.05]) ** 2)
    tracker.update(*seen(ranges(RING, ROUTE[11], rng)), np.zeros(3), NOISE)
    assert np.hypot(*(tracker.pose - ROUTE[11])[:2]) < 0.1


def test_a_jump_leaves_open_what_the_match_does_not_say_by_decimetres_only() -> None:
    """Found 0.3 m off against a bare wall: along it half a metre is left open, not the building."""
    tracker = Tracker()
    wall = np.column_stack([np.full(40, 2.0), np.linspace(-1, 1, 40)])
    scan = ScanPoints(points=wall, normals=np.tile([-1.0, 0.0], (40, 1)), weights=np.ones(40))
    tracker.predict(np.array([0.25, 0.0, 0.0]), np.diag([0.003, 0.003, 0.001]) ** 2)
    across = np.diag([1e6, 0.0, 1e6])
    found = tracker.pose + np.array([0.3, 0.1, 0.05])
    tracker.jump(Match(pose=found, information=across, paired=np.ones(40, bool)), scan)
    np.testing.assert_allclose(tracker.pose, found, atol=1e-12)
    std = np.sqrt(np.diag(tracker.graph.uncertainty(0)[1]))
    assert std[0] < 0.05
    assert 0.2 < std[1] < 0.6


def test_the_graph_grows_with_the_area_not_with_the_time():
    """Ten rounds of the same ring: hardly more submaps than after six, and every scan keeps its pose, to 0.2 m."""
    rng, tracker = np.random.default_rng(0), Tracker(TrackerConfig(match=MATCHING))
    route = along([(1, 1), *[(23, 1), (23, 15), (1, 15), (1, 1)] * 10])
    tracker.reset(route[0])
    tracker.update(*seen(ranges(RING, route[0], rng)), np.zeros(3), 1e-10 * np.eye(3))
    counts = []
    for k, (before, pose) in enumerate(pairwise(route)):
        displacement = between(before, pose) + rng.multivariate_normal(np.zeros(3), NOISE)
        tracker.update(*seen(ranges(RING, pose, rng)), displacement, NOISE)
        if k in (6 * len(route) // 10, len(route) - 2):
            counts.append(len(tracker.submaps))
    assert counts[1] <= counts[0] + 4
    poses = tracker.poses()
    assert len(poses) == len(route)
    assert np.hypot(*(poses - np.array(route))[:, :2].T).max() < 0.2


def _searched(here: int, there: int, x_m: float, wide_m: float = 0.02) -> Pending:
    """A fit of a submap 50 m along a corridor to one at its beginning."""
    found = Fit(
        pose=np.array([x_m, 0.0, 0.0]),
        covariance=np.diag([wide_m, 0.02, 0.01]) ** 2,
        overlap=100,
        agreement=1.0,
    )
    return Pending(here, there, found, True)


@pytest.mark.parametrize(
    ("others", "counts"),
    [
        ([], False),
        ([_searched(9, 1, 0.0)], True),
        ([_searched(9, 1, 0.0, wide_m=10.0)], False),
        ([_searched(9, 1, 0.0), _searched(9, 2, 4.6)], False),
        ([_searched(9, 1, 4.6)], False),
    ],
    ids=["alone", "confirmed", "by one that leaves it open", "as many contradict", "contradicted"],
)
def test_a_fit_that_was_searched_for_counts_if_more_confirm_it_than_contradict(others, counts):
    """Submaps 1, 2 and 8, 9 on a straight line, 5 m between neighbours: fits agree by the closed form of the chain."""
    tracker = Tracker()
    for k in range(1, 11):
        node = tracker.graph.add(np.array([5.0 * k, 0.0, 0.0]))
        step = np.diag([0.05, 0.05, 0.005]) ** 2
        tracker.graph.hold(Constraint(first=k - 1, second=node, pose=np.array([5.0, 0, 0]), covariance=step))
    # Where 1 and 2 lie in the frame of 8 and 9, if odometry between them is right and each fit is off by as much.
    off_m = -39.0
    new = _searched(8, 1, off_m + 5.0)
    tracker._loops.pending = [
        one._replace(
            fit=replace(
                one.fit,
                pose=one.fit.pose
                + np.array([off_m + 5.0 * (one.there - 1) - 5.0 * (one.here - 8) + 5.0, 0, 0]),
            )
        )
        for one in others
    ]
    assert bool(tracker._loops.confirmed(new)) == counts
