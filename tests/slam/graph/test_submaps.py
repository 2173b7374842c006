"""Submaps fitted to each other: matched where they belong, rejected otherwise, with a realistic covariance."""

import math

import numpy as np
import pytest

from slam.graph.submaps import Submap, View, Views, covariance_of, fit, observed, seen_by
from slam.graph.tracker_config import TrackerConfig
from slam.matching.levels import SurfaceLevels
from slam.matching.scan_matching import MatchConfig, ScanPoints, match_scan
from slam.poses import between, compose
from tests.slam.beams import ranges, rectangle, seen

MATCHING = MatchConfig(max_range_m=12.0, sigma_m=0.02, outlier_m=0.06, iterations=12)
ROOM = [*rectangle(0, 0, 8, 6), *rectangle(3, 2, 4, 3.5), *rectangle(6, 0, 8, 1.2)]
OTHER = [*rectangle(0, 0, 5, 9), *rectangle(1, 6, 2.5, 7)]


def submap(walls, poses, seed=0) -> Submap:
    """Scans from poses, in the frame of the first."""
    rng, made = np.random.default_rng(seed), Submap(cell_m=0.05)
    for pose in poses:
        made.add(between(poses[0], pose), *seen(ranges(walls, pose, rng)))
    return made


def turning(x, y, yaw=0.0):
    return [np.array([x, y, yaw + k * math.pi / 4]) for k in range(8)]


@pytest.mark.parametrize(
    ("off", "deviation"),
    [((0.05, -0.05, 0.03), (0.05, 0.05, 0.03)), ((0.8, -0.6, 0.2), (0.5, 0.5, 0.15))],
    ids=["near", "searched"],
)
def test_two_submaps_of_a_room_are_fitted(off, deviation):
    """From 7 cm and 2 degrees off, and from 1 m and 11 degrees: within 1 cm and 0.15 degrees, agreeing."""
    here, there = turning(1.5, 1.5), turning(6.0, 4.5, 2.0)
    true = between(here[0], there[0])
    found = fit(
        submap(ROOM, there, 1),
        submap(ROOM, here),
        compose(true, np.array(off)),
        np.diag(deviation) ** 2,
        MATCHING,
    )
    assert found is not None
    away = between(true, found.pose)
    assert math.hypot(*away[:2]) < 0.01
    assert abs(away[2]) < math.radians(0.15)
    assert found.agreement > 0.95
    assert found.overlap > 200


def test_a_fit_is_as_uncertain_as_submaps_bend():
    """A fit of submaps that bend deviates by 6 cm and 0.7 degrees at least, however many points it has."""
    here, there = turning(1.5, 1.5), turning(6.0, 4.5, 2.0)
    maps, prior = (submap(ROOM, there, 1), submap(ROOM, here)), np.diag([0.05, 0.05, 0.03]) ** 2
    rigid, bent = (fit(*maps, between(here[0], there[0]), prior, MATCHING, error) for error in (0.3, 1.5))
    assert rigid is not None
    assert bent is not None
    assert (np.sqrt(np.diag(rigid.covariance)) < [0.03, 0.03, 0.01]).all()
    assert (np.sqrt(np.diag(bent.covariance)) > [0.059, 0.059, 0.0119]).all()


def test_two_rooms_contradict_each_other():
    """Wherever a search of 1.5 m and 30 degrees puts one upon the other, walls stand where the other looked through."""
    one, other = submap(ROOM, turning(1.5, 1.5)), submap(OTHER, turning(2.5, 4.0))
    found = fit(one, other, np.zeros(3), np.diag([0.5, 0.5, 0.17]) ** 2, MATCHING)
    assert found is None or found.agreement < TrackerConfig().searched_agreement


def test_a_corridor_gives_no_information_along_it():
    """Fitted from 0.3 m off along a bare corridor: the place across is known to 4 cm, along it to 1 m at best."""
    corridor = [(-50, -1, 50, -1), (-50, 1, 50, 1)]
    poses = [np.array([x, 0.0, 0.0]) for x in (0.0, 0.5, 1.0)]
    found = fit(
        submap(corridor, poses, 1),
        submap(corridor, poses),
        np.array([0.3, 0.02, 0.01]),
        np.diag([0.3, 0.03, 0.02]) ** 2,
        MATCHING,
    )
    assert found is not None
    along_m, across_m, turn_rad = np.sqrt(np.diag(found.covariance))
    assert along_m > 1.0
    assert across_m < 0.04
    assert turn_rad < math.radians(1)


def test_information_of_a_room_is_unchanged():
    """Equal in all directions, it loses what the noise of normals makes, 2 %; a turn counts at 3 m as a shift."""
    scan = ScanPoints(points=np.array([[3.0, 0.0], [0.0, 3.0]]), normals=np.eye(2), weights=np.ones(2))
    information = np.diag([1e5, 1e5, 9e5])
    np.testing.assert_allclose(observed(information, scan), 0.98 * information, rtol=1e-6, atol=1e-6)
    found_m = math.sqrt(covariance_of(information, scan, 0.002)[0, 0])
    assert found_m == pytest.approx(math.hypot(0.002, 1 / math.sqrt(0.98e5)), rel=1e-3)


def test_a_corner_to_one_side_determines_the_pose():
    """Two walls 4 m ahead, seen from where shifts and turns are much alike: all is known to 3 cm and half a degree."""
    rng = np.random.default_rng(0)
    at = rng.uniform(-1, 1, 200)
    points = np.concatenate([np.column_stack([4 + 0 * at, at]), np.column_stack([4 + at, 1 + 0 * at])])
    normals = np.repeat([[-1.0, 0.0], [0.0, -1.0]], 200, axis=0)
    scan = ScanPoints(points=points, normals=normals, weights=np.ones(400))
    by_pose = np.column_stack([normals, points[:, 0] * normals[:, 1] - points[:, 1] * normals[:, 0]])
    information = by_pose.T @ by_pose / 0.02**2
    true = np.linalg.inv(information)
    found = covariance_of(information, scan, 0.002)
    assert np.all(np.linalg.eigvalsh(found - true) > -1e-9)
    assert np.sqrt(np.diag(found))[:2].max() < 0.03
    assert math.sqrt(found[2, 2]) < math.radians(0.5)


def test_a_wall_right_ahead_determines_the_turn():
    """From 0.5 m it does so to 1.5 degrees, and nothing of the place along it."""
    wall = [(0.5, -3, 0.5, 3)]
    scan, _ = seen(ranges(wall, np.zeros(3)))
    near = np.abs(scan.points[:, 1]) < 0.5
    scan = ScanPoints(points=scan.points[near], normals=scan.normals[near], weights=scan.weights[near])
    surfaces = SurfaceLevels(0.05)
    surfaces.enter(np.zeros(3), scan)
    match = match_scan(surfaces.fine, scan, np.zeros(3), np.diag([0.01, 0.01, 0.01]) ** 2, MATCHING)
    deviation = np.sqrt(np.diag(covariance_of(match.information, scan, 0.002)))
    assert deviation[0] < 0.01
    assert deviation[1] > 1.0
    assert deviation[2] < math.radians(1.5)


def test_beams_from_0_to_360_degrees_see_all_around():
    """As those from -180 to 180 degrees do: a point on a circle is seen, one half as far is looked through."""
    around = np.radians(np.arange(0.5, 360, 5))
    points = np.column_stack([np.cos(around), np.sin(around)])
    for first_deg in (-180, -90, 0):
        bearing = np.radians(np.arange(first_deg, first_deg + 360.0))
        views = Views.of([(np.zeros(3), View(bearing_rad=bearing, range_m=np.full(360, 4.0)))])
        same, through = seen_by(views, np.concatenate([4 * points, 2 * points]))
        n = len(points)
        assert same[:n].all() and not same[n:].any()
        assert through[n:].all() and not through[:n].any()
