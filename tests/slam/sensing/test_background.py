"""Depths behind tracked things, on a map with a wall at a known distance."""

from dataclasses import replace

import numpy as np

from slam.grid import MovingThing
from slam.sensing.background import background
from tests.slam.floors import floor


def thing_at(*xy: float) -> MovingThing:
    return MovingThing(
        xy=np.array(xy), velocity=np.zeros(2), covariance=np.eye(4), stood_s=0.0, unseen_s=0.0, number=1
    )


def test_a_person_is_replaced_by_the_wall_behind():
    """A wall at x = 2 m, somebody at 1 m who covers the middle of the picture: to half a cell and a step."""
    estimate = floor((0.0, 0.0, 0.0), walls=[(2.0, -2.0, 2.2, 2.0)])
    left = np.linspace(0.5, -0.5, 41)
    depth_m = np.where(np.abs(left) < 0.15, 0.85, 2.0)
    seen = background(depth_m, left, replace(estimate, moving=(thing_at(1.0, 0.0),)))
    np.testing.assert_allclose(seen, 2.0, atol=0.08)
    np.testing.assert_array_equal(seen[np.abs(left) >= 0.15], 2.0)


def test_what_is_not_tracked_stays():
    """Somebody else's place, and pixels where nothing was measured."""
    estimate = floor((0.0, 0.0, 0.0))
    depth_m, left = np.array([0.85, 0.0, 1.2]), np.array([0.1, 0.0, -0.1])
    for moving in ((), (thing_at(1.0, 2.0),)):
        np.testing.assert_array_equal(background(depth_m, left, replace(estimate, moving=moving)), depth_m)
