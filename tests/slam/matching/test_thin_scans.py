"""Scans of few beams: lines of several scans are surfaces, and nothing else is."""

import math

import numpy as np
import pytest

from slam.graph.submaps import View, Views, seen_by
from slam.graph.tracker import Tracker
from slam.graph.tracker_config import TrackerConfig
from slam.matching.scan_matching import MatchConfig
from slam.matching.thin_scans import RecentPoints, is_thin, thin_scan
from slam.poses import between, compose
from tests.slam.beams import along, ranges, rectangle

ROOM = [*rectangle(0, 0, 8, 6), *rectangle(3, 2, 4, 3.5), *rectangle(6, 0, 8, 1.2)]
BEARING = np.radians(np.arange(-90, 91, 15.0))
RANGE_M = 12.0
ROUTE = along([(1, 1), (5, 1), (5, 5), (1, 5), (1, 1.5)], step_m=0.2)


def off_walls(points: np.ndarray, walls) -> np.ndarray:
    """Distance of points from the nearest wall [m]."""
    a, b = np.array(walls)[:, :2], np.array(walls)[:, 2:]
    along_wall = b - a
    share = ((points[:, None] - a) * along_wall).sum(axis=2) / (along_wall**2).sum(axis=1)
    nearest = a + np.clip(share, 0, 1)[..., None] * along_wall
    return np.hypot(*np.moveaxis(points[:, None] - nearest, 2, 0)).min(axis=1)


def surfaces_of(walls, route):
    """Points and normals of all surfaces found along a route; ranges err by a millimetre."""
    rng, recent, views, found = np.random.default_rng(1), RecentPoints(0.05), [], []
    for pose in route:
        reach = ranges(walls, pose, rng, 0.001, BEARING)
        views.append((pose, View(bearing_rad=BEARING, range_m=np.where(np.isfinite(reach), reach, -RANGE_M))))
        recent.add(pose, thin_scan(BEARING, reach, RANGE_M, 0.02))
        one = recent.new_surfaces(lambda points: seen_by(Views.of(views), points)[1])
        found.append(np.column_stack([one.points, one.normals]))
    return np.concatenate(found)


def test_surfaces_lie_on_walls_and_face_the_robot():
    """Of 13 beams per scan: within 3 cm of a wall nearly everywhere, and all long walls are found."""
    found = surfaces_of(ROOM, ROUTE)
    assert np.percentile(off_walls(found[:, :2], ROOM), 97) < 0.03
    # The inside of the room: normals point to its middle, or away from the cupboard.
    left = found[(found[:, 0] < 0.03) & (np.abs(found[:, 1] - 3) < 2)]
    assert len(left) > 20
    np.testing.assert_allclose(left[:, 2], 1.0, atol=0.02)


def test_a_door_stays_open():
    """Beams go through the gap of a wall between two posts that are in line: no surface closes it."""
    walls = [(4, 0, 4, 2.4), (4, 3.4, 4, 6), (9, 0, 9, 6)]
    found = surfaces_of(walls, along([(1, 1), (1, 5)], step_m=0.1))
    in_gap = (np.abs(found[:, 0] - 4) < 0.1) & (found[:, 1] > 2.55) & (found[:, 1] < 3.25)
    assert (np.abs(found[:, 0] - 4) < 0.1).sum() > 40
    assert in_gap.mean() < 0.02


def test_a_frame_changes_nothing():
    """A rigid motion of the frame moves surfaces with it."""
    frame = np.array([3.0, -1.0, 0.7])
    rng, recent, shifted = np.random.default_rng(2), RecentPoints(0.05), RecentPoints(0.05)
    for pose in ROUTE[:6]:
        scan = thin_scan(BEARING, ranges(ROOM, pose, rng, 0.001, BEARING), RANGE_M, 0.02)
        recent.add(pose, scan)
        shifted.add(between(frame, pose), scan)
    shifted.move(frame)
    expected, found = (one.new_surfaces(lambda p: np.zeros(len(p), bool)) for one in (recent, shifted))
    np.testing.assert_allclose(found.points, expected.points, atol=1e-9)
    np.testing.assert_allclose(found.normals, expected.normals, atol=1e-9)


def test_a_surface_is_entered_once():
    recent = RecentPoints(0.05)
    for pose in ROUTE[:6]:
        recent.add(pose, thin_scan(BEARING, ranges(ROOM, pose, bearing=BEARING), RANGE_M, 0.02))
    assert len(recent.new_surfaces(lambda p: np.zeros(len(p), bool)).points)
    assert not len(recent.new_surfaces(lambda p: np.zeros(len(p), bool)).points)


def test_points_alone_are_no_surface():
    """One scan of 13 beams in a round hall has no three ends in line within a metre."""
    reach = np.full(len(BEARING), 6.0)
    recent = RecentPoints(0.05)
    recent.add(np.zeros(3), thin_scan(BEARING, reach, RANGE_M, 0.02))
    assert not len(recent.new_surfaces(lambda p: np.zeros(len(p), bool)).points)


@pytest.mark.parametrize(("beams", "thin"), [(181, False), (91, True), (13, True)])
def test_what_is_thin(beams, thin):
    assert is_thin(np.linspace(-math.pi / 2, math.pi / 2, beams)) is (thin and beams < 91)


def test_a_robot_with_thirteen_beams_keeps_its_pose():
    """Round a room with a cupboard, odometry off by 20 cm and 6 degrees at the end: within 4 cm and 1 degree."""
    rng, match = np.random.default_rng(3), MatchConfig(max_range_m=RANGE_M, sigma_m=0.02, outlier_m=0.06)
    tracker = Tracker(TrackerConfig(match=match))
    tracker.reset(ROUTE[0])
    driven = ROUTE[0]
    for before, pose in zip([ROUTE[0], *ROUTE], ROUTE, strict=False):
        step = between(before, pose)
        turn = abs(step[2]) + 0.1 * abs(step[0])
        measured = step + rng.normal(0, [0.01, 0.01, 0.01]) + [0, 0, 0.02 * turn]
        driven = compose(driven, measured)
        reach = ranges(ROOM, pose, rng, bearing=BEARING)
        view = View(bearing_rad=BEARING, range_m=np.where(np.isfinite(reach), reach, -RANGE_M))
        scan = thin_scan(BEARING, reach, RANGE_M, 0.02)
        tracker.update(scan, view, measured, np.diag([0.015, 0.015, 0.02]) ** 2)
    off, blind = between(ROUTE[-1], tracker.pose), between(ROUTE[-1], driven)
    assert math.hypot(*blind[:2]) > 0.1
    assert math.hypot(*off[:2]) < 0.04
    assert abs(off[2]) < math.radians(1.0)
