"""Planar poses form a group, and their angles have one name each."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.poses import between, compose, to_map, wrap

_NUMBER = st.floats(-50.0, 50.0)
_POSES = st.builds(lambda x, y, yaw: np.array([x, y, wrap(yaw)]), _NUMBER, _NUMBER, _NUMBER)


def _matrix(pose):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])


@given(_NUMBER)
def test_a_wrapped_angle_is_the_same_direction_and_lies_in_its_range(angle):
    """Same sine and cosine to 1e-9, in [-pi, pi); would catch a wrap into (-pi, pi] or off by a turn."""
    wrapped = wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_half_a_turn_is_minus_pi():
    """The range is closed below and open above: pi, -pi and 3 pi are all -pi exactly."""
    assert wrap(math.pi) == wrap(-math.pi) == wrap(3 * math.pi) == -math.pi


@given(_POSES, _POSES)
def test_composing_poses_multiplies_their_matrices(pose, displacement):
    """Homogeneous 3 x 3 matrices are the reference; would catch a rotation by minus yaw."""
    expected = _matrix(pose) @ _matrix(displacement)
    np.testing.assert_allclose(_matrix(compose(pose, displacement)), expected, atol=1e-9)


@given(_POSES, _POSES)
def test_the_displacement_between_two_poses_leads_from_one_to_the_other(start, end):
    """compose(start, between(start, end)) = end, angles as directions, to 1e-9."""
    np.testing.assert_allclose(_matrix(compose(start, between(start, end))), _matrix(end), atol=1e-9)


@given(_POSES, _POSES)
def test_there_and_back_is_no_displacement(start, end):
    """between(a, b) and between(b, a) are inverse matrices."""
    product = _matrix(between(start, end)) @ _matrix(between(end, start))
    np.testing.assert_allclose(product, np.eye(3), atol=1e-9)


def test_a_step_ahead_of_a_robot_that_looks_left_goes_along_y():
    """From (1, 2) with yaw 90 degrees, 3 m ahead and 1 m left is (0, 5)."""
    pose = np.array([1.0, 2.0, math.pi / 2])
    np.testing.assert_allclose(compose(pose, np.array([3.0, 1.0, 0.0])), [0.0, 5.0, math.pi / 2], atol=1e-12)


@given(_POSES, st.lists(st.tuples(_NUMBER, _NUMBER), min_size=1, max_size=5))
def test_points_move_to_the_map_as_poses_do(pose, points):
    """A point is a pose whose yaw does not matter."""
    points = np.array(points)
    expected = [compose(pose, np.array([x, y, 0.0]))[:2] for x, y in points]
    np.testing.assert_allclose(to_map(pose, points), expected, atol=1e-9)
