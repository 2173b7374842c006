"""A scan finds the pose at which it was taken, as far as the walls determine it, and no further."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.grid import GridFrame
from slam.matching.scan_matching import MatchConfig, match_scan, points_of_scan
from slam.matching.surfaces import SurfaceGrid
from slam.poses import between, compose, to_map
from slam.sensing.projection import CameraModel, scan_from_depth
from tests.slam.rooms import Room

CELL = 0.05
CAMERA = CameraModel()
TRUST_ODOMETRY_LITTLE = np.diag([0.05**2, 0.05**2, math.radians(3) ** 2])


def _points(room: Room, pose):
    return points_of_scan(scan_from_depth(room.depth(pose), CAMERA), MatchConfig(), CELL)


def _surfaces(room: Room, poses) -> SurfaceGrid:
    frame = GridFrame(origin_xy=(-10.0, -10.0), resolution_m=CELL, shape=(400, 400))
    surfaces = SurfaceGrid(frame)
    for pose in poses:
        scan = _points(room, pose)
        heading = np.array([0.0, 0.0, pose[2]])
        surfaces.add(to_map(pose, scan.points), to_map(heading, scan.normals), scan.weights)
    return surfaces


def _spin(x: float, y: float):
    return [np.array([x, y, math.radians(a)]) for a in range(-180, 180, 10)]


@pytest.mark.parametrize("yaw", [0.2, 0.9, 2.4, -1.3])
@pytest.mark.parametrize("offset", [(0.03, -0.03, 2.0), (-0.03, 0.03, -2.0), (0.03, 0.03, 2.0)])
def test_a_known_offset_is_recovered_in_a_room(yaw, offset):
    """3 cm and 2 degrees off, looking into a corner: below 1 cm and 0.2 degrees afterwards."""
    room, true = Room(), np.array([0.4, 0.3, yaw])
    surfaces = _surfaces(room, _spin(0.0, 0.0))
    predicted = compose(true, np.array([offset[0], offset[1], math.radians(offset[2])]))
    match = match_scan(surfaces, _points(room, true), predicted, TRUST_ODOMETRY_LITTLE)
    off = between(true, match.pose)
    assert np.hypot(*off[:2]) < 0.01
    assert abs(off[2]) < math.radians(0.2)
    assert match.paired.mean() > 0.8


def test_in_a_long_corridor_the_pose_does_not_slide_along_it():
    """Walls at y = +-1 m alone leave x as odometry has it, to 1 mm, while y and yaw are found."""
    corridor = Room(low_xy=(-40.0, -1.0), high_xy=(40.0, 1.0))
    surfaces = _surfaces(corridor, _spin(-0.5, 0.0) + _spin(0.5, 0.0))
    true = np.array([0.013, 0.02, 0.0])
    predicted = true + np.array([0.04, -0.03, math.radians(1.5)])
    match = match_scan(surfaces, _points(corridor, true), predicted, TRUST_ODOMETRY_LITTLE)
    assert match.pose[0] == pytest.approx(predicted[0], abs=0.001)
    assert match.pose[1] == pytest.approx(true[1], abs=0.01)
    assert match.pose[2] == pytest.approx(true[2], abs=math.radians(0.2))
    assert match.information[0, 0] < 0.01 * match.information[1, 1]


def test_a_corridor_driven_for_long_does_not_drift():
    """60 matches with exact odometry, the map built meanwhile: within 1 cm along the axis and 5 mm across."""
    corridor = Room(low_xy=(-40.0, -1.0), high_xy=(40.0, 1.0))
    surfaces = _surfaces(corridor, [np.zeros(3)])
    pose, step = np.zeros(3), np.array([0.05, 0.0, 0.0])
    covariance = np.diag([0.02**2, 0.02**2, 0.005**2])
    for k in range(1, 61):
        scan = _points(corridor, np.array([0.05 * k, 0.0, 0.0]))
        pose = match_scan(surfaces, scan, compose(pose, step), covariance).pose
        surfaces.add(to_map(pose, scan.points), to_map(pose * [0, 0, 1], scan.normals), scan.weights)
    assert pose[0] == pytest.approx(3.0, abs=0.01)
    assert abs(pose[1]) < 0.005
    assert abs(pose[2]) < math.radians(0.2)


def _before_a_wall(distance_m: float) -> tuple[SurfaceGrid, np.ndarray]:
    """A wall in view at a distance, and the robot before it."""
    room, pose = Room(low_xy=(-10.0, -10.0), high_xy=(distance_m, 10.0)), np.zeros(3)
    return _surfaces(room, [pose]), pose


def test_a_wall_close_by_holds_the_heading_as_well_as_one_far_away():
    """0.4 m of wall at 0.2 m, and 6 m of it at 3 m: the heading is known within 0.2 degrees before either.

    The camera sees the near one ten times as exactly; with one deviation for all points it says less than a degree.
    """
    for distance_m, sigma_m in ((0.2, 0.001), (3.0, 0.003)):
        surfaces, pose = _before_a_wall(distance_m)
        scan = _points(Room(low_xy=(-10.0, -10.0), high_xy=(distance_m, 10.0)), pose)
        assert scan.sigma_m is not None
        assert float(np.median(scan.sigma_m)) == pytest.approx(sigma_m, rel=0.5)
        match = match_scan(surfaces, scan, pose, TRUST_ODOMETRY_LITTLE)
        assert 1 / math.sqrt(match.information[2, 2]) < math.radians(0.2)


def test_a_wall_at_the_far_end_of_the_range_still_determines_the_heading():
    """At 7 m points err by 2 cm: 12 m of wall hold the heading within 0.2 degrees, and what is drawn ends before it."""
    surfaces, pose = _before_a_wall(7.0)
    scan = _points(Room(low_xy=(-10.0, -10.0), high_xy=(7.0, 10.0)), pose)
    assert scan.sigma_m is not None
    ahead = np.abs(scan.points[:, 1]) < 1
    np.testing.assert_allclose(scan.sigma_m[ahead], 0.021, atol=0.002)
    match = match_scan(surfaces, scan, pose, TRUST_ODOMETRY_LITTLE)
    assert 1 / math.sqrt(match.information[2, 2]) < math.radians(0.2)
    assert not len(scan.within(6.0).points)


def test_what_errs_by_more_is_wild_only_farther_away():
    """5 cm off, a third of the points of a wall at 7.9 m still pull; those of a wall at 2 m are wild."""
    pulls = []
    for distance_m in (7.9, 2.0):
        surfaces, pose = _before_a_wall(distance_m)
        scan = _points(Room(low_xy=(-10.0, -10.0), high_xy=(distance_m, 10.0)), pose)
        assert scan.sigma_m is not None
        off = replace(scan, points=scan.points + np.array([0.05, 0.0]))
        exact = replace(off, sigma_m=np.full(len(off.points), 1e-3))
        odd = np.arange(len(off.points)) % 3 == 0
        moderate, sure = (
            replace(scan, points=np.where(odd[:, None], one.points, scan.points), sigma_m=one.sigma_m)
            for one in (replace(off, sigma_m=scan.sigma_m), exact)
        )
        offsets = [match_scan(surfaces, one, pose, TRUST_ODOMETRY_LITTLE).pose[0] for one in (moderate, sure)]
        pulls.append(abs(offsets[0]) - abs(offsets[1]))
    assert pulls[0] > 0.002
    assert abs(pulls[1]) < 0.001


def test_near_points_are_those_within_a_range():
    """All arrays of a scan are cut alike, loose points too."""
    scan = _points(Room(), np.array([0.0, 0.0, 0.6]))
    near = scan.within(3.0)
    assert near.sigma_m is not None
    assert near.loose is not None
    assert 0 < len(near.points) < len(scan.points)
    assert len(near.points) == len(near.normals) == len(near.weights) == len(near.sigma_m)
    assert np.hypot(*near.every().T).max() <= 3.0


def test_a_bad_fit_says_less_than_a_good_one():
    """Surfaces that err by 4 mm where the scan should by 1: a sixteenth of the information, or less."""
    surfaces, pose = _before_a_wall(1.0)
    room, rng = Room(low_xy=(-10.0, -10.0), high_xy=(1.0, 10.0)), np.random.default_rng(1)
    good = _points(room, pose)
    along = good.points / np.hypot(*good.points.T)[:, None]
    bad = replace(good, points=good.points + 0.004 * rng.standard_normal((len(along), 1)) * along)
    known, doubted = (
        match_scan(surfaces, scan, pose, TRUST_ODOMETRY_LITTLE).information[2, 2] for scan in (good, bad)
    )
    assert known / 40 < doubted < known / 5


def test_without_a_map_the_prediction_stands():
    """Nothing to pair with: the pose predicted, bit for bit, and no information."""
    empty = SurfaceGrid(GridFrame(origin_xy=(-10.0, -10.0), shape=(400, 400)))
    predicted = np.array([0.3, -0.2, 1.0])
    match = match_scan(empty, _points(Room(), predicted), predicted, TRUST_ODOMETRY_LITTLE)
    np.testing.assert_array_equal(match.pose, predicted)
    assert not match.information.any()
    assert not match.paired.any()


def test_without_points_the_prediction_stands():
    """An image without any depth moves nothing."""
    room, predicted = Room(), np.array([0.3, -0.2, 1.0])
    blind = points_of_scan(scan_from_depth(np.zeros((96, 96), np.float32), CAMERA), MatchConfig(), CELL)
    assert len(blind.points) == 0
    match = match_scan(_surfaces(room, _spin(0, 0)), blind, predicted, TRUST_ODOMETRY_LITTLE)
    np.testing.assert_array_equal(match.pose, predicted)


def test_normals_are_those_of_the_walls_and_face_the_robot():
    """Of unit length, within 3 degrees of an axis but at the corner, and against the view."""
    pose = np.array([0.0, 0.0, 0.6])
    scan = _points(Room(), pose)
    normals = to_map(np.array([0.0, 0.0, 0.6]), scan.normals)
    np.testing.assert_allclose(np.hypot(*normals.T), 1.0, atol=1e-6)
    off_axis = np.degrees(np.arctan2(np.abs(normals).min(axis=1), np.abs(normals).max(axis=1)))
    assert np.mean(off_axis < 3.0) > 0.8
    assert ((scan.normals * scan.points).sum(axis=1) < 0).all()
