"""The patch ahead of the robot is the map turned into its frame."""

import math

import cv2
import numpy as np
import pytest
from scipy import ndimage

from slam.grid import GridFrame, MapEstimate
from slam.poses import to_map
from slam.sensing.egocentric import AHEAD
from tests.slam.sensing.nearest_cells import EXPLORED, OBSTACLE, egocentric_map

CELL = 0.05


def _estimate(obstacle, explored, pose=(0.0, 0.0, 0.0), origin_xy=(-5.0, -4.0)) -> MapEstimate:
    return MapEstimate(
        frame=GridFrame(origin_xy=origin_xy, resolution_m=CELL, shape=obstacle.shape),
        obstacle_probability=np.where(obstacle, 0.9, 0.1).astype(np.float32),
        explored=explored,
        blocked=np.zeros(obstacle.shape, bool),
        pose=np.array(pose, float),
    )


def _random(pose=(0.0, 0.0, 0.0)) -> MapEstimate:
    """160 x 200 random cells: row 80, column 100 begins at the origin of `map`."""
    rng = np.random.default_rng(4)
    return _estimate(rng.random((160, 200)) < 0.5, rng.random((160, 200)) < 0.5, pose)


def _smooth() -> MapEstimate:
    """Blobs of half a metre."""
    rng = np.random.default_rng(5)
    obstacle, explored = (ndimage.gaussian_filter(rng.normal(size=(160, 200)), 5) > 0 for _ in range(2))
    return _estimate(obstacle, explored)


@pytest.mark.parametrize("quarter", [0, 1, 2, -1])
def test_at_quarter_turns_the_patch_is_a_turned_cut_of_the_map(quarter):
    """On a corner of the lattice, bit for bit what `numpy.rot90` makes of a slice; one cell off would be noise.

    The robot at row 80, column 100 looks along +x, +y, -x or -y, at 64 cells ahead and 32 to each side.
    """
    estimate = _random((0.0, 0.0, quarter * math.pi / 2))
    cut = {
        0: np.s_[48:112, 100:164],
        1: np.s_[80:144, 68:132],
        2: np.s_[48:112, 36:100],
        -1: np.s_[16:80, 68:132],
    }[quarter]
    # y is up, so `rot90` turns opposite to its direction on paper: +1 brings +y to +x.
    expected = np.stack([np.rot90(a[cut], quarter) for a in (estimate.obstacle, estimate.explored)])
    np.testing.assert_array_equal(egocentric_map(estimate), expected)


@pytest.mark.parametrize("quarter", [0, 1, 2, -1])
def test_a_robot_at_the_centre_of_a_cell_sees_every_row_once(quarter):
    """Patch cells then straddle map cells exactly: the patch is the cut at one of the two, whole, at all 40 places.

    Without a rule for ties, rounding doubles some rows and drops others.
    """
    for k in range(40):
        here = np.array([0.025 - 0.05 * k, 0.025 + 0.05 * (k % 7), quarter * math.pi / 2])
        estimate = _random()
        got = egocentric_map(estimate, here)[OBSTACLE]
        others = [
            egocentric_map(estimate, here + np.array([dx, dy, 0.0]))[OBSTACLE]
            for dx in (-0.025, 0.025)
            for dy in (-0.025, 0.025)
        ]
        assert any((got == other).all() for other in others)


@pytest.mark.parametrize(
    "pose", [(0.0, 0.0, 0.5), (0.613, -0.777, 2.2), (-1.01, 0.34, -2.9), (4.2, 3.1, 0.8)]
)
def test_at_any_angle_it_agrees_with_opencv(pose):
    """`cv2.warpAffine` to the nearest cell, on blobs: but for ties at its 1/1024 of a cell, the same cells."""
    estimate = _smooth()
    # Patch cell centres (column, row) to map cell centres (column, row), in OpenCV's pixels of integer centres.
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, -s], [s, c]])
    at_zero = (np.array(pose[:2]) + turn @ [0.025, -1.575] - [-5.0, -4.0]) / CELL - 0.5
    warp = np.column_stack([turn, at_zero])
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    for channel, layer in ((OBSTACLE, estimate.obstacle), (EXPLORED, estimate.explored)):
        expected = cv2.warpAffine(layer.astype(np.uint8), warp, (64, 64), flags=flags, borderValue=0)
        got = egocentric_map(estimate, np.array(pose))[channel]
        assert np.mean(got != expected.astype(bool)) < 0.005


def test_it_agrees_with_the_linear_resampler_of_scipy_away_from_edges():
    """Where `map_coordinates` of order 1 finds all four neighbours alike, so does the patch: no exception."""
    estimate, pose = _smooth(), np.array([0.313, 0.171, 1.234])
    points = to_map(pose, AHEAD.centres(np.ones(AHEAD.shape, bool)))
    rows, columns = (points[:, 1] + 4.0) / CELL - 0.5, (points[:, 0] + 5.0) / CELL - 0.5
    mixed = ndimage.map_coordinates(estimate.obstacle.astype(float), [rows, columns], order=1)
    got = egocentric_map(estimate, pose)[OBSTACLE].ravel()
    sure = (mixed < 1e-9) | (mixed > 1 - 1e-9)
    assert sure.mean() > 0.6
    np.testing.assert_array_equal(got[sure], mixed[sure] > 0.5)


def test_the_picture_has_the_robot_at_the_middle_of_the_lower_edge():
    """A lone obstacle 1 m ahead, 0.5 m to the left: row 20 from below, column 10 left of the middle."""
    nothing = np.zeros((160, 200), bool)
    obstacle = nothing.copy()
    obstacle[80 + 10, 100 + 20] = True
    patch = egocentric_map(_estimate(obstacle, nothing))
    assert np.argwhere(patch[OBSTACLE]).tolist() == [[32 + 10, 20]]
    picture = patch[:, ::-1, ::-1].swapaxes(1, 2)
    assert np.argwhere(picture[OBSTACLE]).tolist() == [[63 - 20, 31 - 10]]


def test_beyond_the_map_nothing_is_known():
    """With the robot half a metre from the edge, 10 columns are map and the rest is neither; far away, all is."""
    full = np.ones((160, 200), bool)
    estimate = _estimate(full, full, (4.5, 0.0, 0.0))
    patch = egocentric_map(estimate)
    assert patch[:, :, :10].all()
    assert not patch[:, :, 10:].any()
    assert not egocentric_map(estimate, np.array([-300.0, 80.0, 1.0])).any()
