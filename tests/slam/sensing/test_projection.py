"""A depth image becomes points and a scan that lie on the walls it shows."""

import math

import numpy as np
import pytest

from slam.poses import to_map
from slam.sensing.projection import Band, CameraModel, clean_depth, scan_from_depth
from tests.slam.rooms import Room

CAMERA = CameraModel(max_depth_m=50.0)


def _scan_points(scan):
    return np.column_stack([scan.depth_m, scan.depth_m * scan.left]).astype(float)


@pytest.mark.parametrize("size", [32, 96, 97])
def test_a_flat_wall_at_distance_d_projects_to_depth_d(size):
    """Facing a wall 3 m ahead and 20 m wide: all columns read 3 m, to float32, and what is clear ends there."""
    room = Room(low_xy=(-3.0, -10.0), high_xy=(3.0, 10.0))
    scan = scan_from_depth(room.depth(np.zeros(3), size=size), CAMERA)
    np.testing.assert_allclose(scan.depth_m, 3.0, atol=1e-4)
    np.testing.assert_allclose(scan.clear_m, 3.0, atol=1e-4)
    assert scan.hit.all()


@pytest.mark.parametrize("yaw", [0.0, 0.4, math.pi / 2, -2.5])
def test_scan_points_lie_on_the_walls_of_the_room(yaw):
    """Within 5 mm from any heading; a mirrored image or a field of view 1 degree off would be centimetres off."""
    room, pose = Room(low_xy=(-1.0, -2.0), high_xy=(4.0, 2.5)), np.array([0.7, 0.3, yaw])
    scan = scan_from_depth(room.depth(pose), CAMERA)
    assert scan.hit.all()
    assert room.wall_distance(to_map(pose, _scan_points(scan))).max() < 0.005


def test_columns_run_from_left_to_right():
    """With the left wall 1 m and the right wall 2 m away, the first column hits y = 1 and the last y = -2."""
    room = Room(low_xy=(-9.0, -2.0), high_xy=(9.0, 1.0))
    points = _scan_points(scan_from_depth(room.depth(np.zeros(3)), CAMERA))
    assert points[0, 1] == pytest.approx(1.0, abs=1e-3)
    assert points[-1, 1] == pytest.approx(-2.0, abs=1e-3)


def back_project(depth, camera):
    """Points (x forward, y left, z above the floor) [m] of all measured pixels, in the robot's frame."""
    left, down = camera.slopes(depth.shape)
    v, u = np.nonzero(np.isfinite(clean_depth(depth, camera)))
    z = depth[v, u]
    return np.column_stack([z, z * left[u], camera.height_m - z * down[v]]).astype(np.float32)


def test_every_back_projected_pixel_lies_on_the_box():
    """Floor z = 0, ceiling 2.5 m, or a wall: within 0.1 mm; catches half a pixel (5 mm at 1 m) in rows or columns."""
    room, pose = Room(), np.array([-1.2, 0.4, 0.9])
    points = back_project(room.depth(pose), CAMERA).astype(float)
    assert len(points) == 96 * 96
    off_wall = room.wall_distance(to_map(pose, points[:, :2]))
    off = np.minimum(off_wall, np.minimum(np.abs(points[:, 2]), np.abs(points[:, 2] - 2.5)))
    assert off.max() < 1e-4
    assert points[:, 2].min() > -1e-4
    assert points[:, 2].max() < 2.5 + 1e-4


def test_floor_and_ceiling_do_not_stop_the_robot():
    """In a hall whose walls are out of range nothing is hit, and what is clear is as deep as the floor was seen."""
    room = Room(low_xy=(-60.0, -60.0), high_xy=(60.0, 60.0))
    scan = scan_from_depth(room.depth(np.zeros(3)), CameraModel(max_depth_m=10.0))
    assert not scan.hit.any()
    assert np.isinf(scan.depth_m).all()
    # The lowest floor row within 10 m: rays fall by (2 k + 1) / 96 per metre; the deepest under 10 m is k = 6.
    np.testing.assert_allclose(scan.clear_m, 1.25 * 96 / 13, rtol=1e-4)


@pytest.mark.parametrize("wild", [0.0, -1.0, np.nan, np.inf, -np.inf])
def test_missing_depth_measures_nothing(wild):
    """No error, no NaN, no hit and nothing clear, whatever stands for a missing depth."""
    depth = np.full((48, 64), wild, np.float32)
    scan = scan_from_depth(depth, CAMERA)
    assert not scan.hit.any()
    for values in (scan.left, scan.depth_m, scan.clear_m, scan.top_m, scan.far_m):
        assert not np.isnan(values).any()
    assert (scan.clear_m == 0).all()
    assert back_project(depth, CAMERA).shape == (0, 3)
    assert np.isposinf(clean_depth(depth, CAMERA)).all()


def test_a_third_of_the_pixels_missing_leaves_the_wall_where_it_is():
    """Holes of 0, NaN and inf in a wall at 3 m: still 3 m in all columns."""
    depth = Room(low_xy=(-3.0, -10.0), high_xy=(3.0, 10.0)).depth(np.zeros(3))
    rng = np.random.default_rng(3)
    holes = rng.random(depth.shape) < 0.33
    depth[holes] = rng.choice(np.array([0.0, np.nan, np.inf], np.float32), int(holes.sum()))
    np.testing.assert_allclose(scan_from_depth(depth, CAMERA).depth_m, 3.0, atol=1e-4)


def test_one_wild_pixel_is_no_obstacle():
    """A single pixel at 1 m before a wall at 3 m changes nothing; three in a column do."""
    depth = Room(low_xy=(-3.0, -10.0), high_xy=(3.0, 10.0)).depth(np.zeros(3))
    depth[50, 20] = 1.0
    assert scan_from_depth(depth, CAMERA).depth_m[20] == pytest.approx(3.0, abs=1e-4)
    depth[49:52, 20] = 1.0
    assert scan_from_depth(depth, CAMERA).depth_m[20] == pytest.approx(1.0, abs=1e-4)


def test_what_passes_over_the_robot_does_not_stop_it():
    """A beam that hangs from the ceiling to 1.6 m is seen, but only the wall behind it counts; to 1.4 m it stops."""
    wall = Room(low_xy=(-3.0, -10.0), high_xy=(3.0, 10.0)).depth(np.zeros(3))
    up = (1 - (2 * np.arange(96) + 1) / 96)[:, None]
    for lower_edge_m, expected in ((1.6, 3.0), (1.4, 1.0)):
        height_at_1m = 1.25 + up
        depth = np.where(height_at_1m > lower_edge_m, np.minimum(wall, 1.0), wall).astype(np.float32)
        np.testing.assert_allclose(scan_from_depth(depth, CAMERA).depth_m, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: CameraModel(hfov_deg=1.57), "hfov_deg"),
        (lambda: CameraModel(hfov_deg=180.0), "hfov_deg"),
        (lambda: CameraModel(height_m=0.0), "height_m"),
        (lambda: CameraModel(min_depth_m=5.0, max_depth_m=4.0), "min_depth_m"),
        (lambda: Band(low_m=2.0, high_m=1.0), "low_m"),
    ],
)
def test_impossible_cameras_and_bands_are_rejected(make, name):
    """An angle in radians, too."""
    with pytest.raises(ValueError, match=name):
        make()
