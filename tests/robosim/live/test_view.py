"""Where the page looks from: all of a plan is seen, as large as the window lets it."""

import math

import numpy as np
import pytest

from robosim.live.building_scene import FIELD_DEG, view_from_above
from robosim.live.client import COVERED


@pytest.mark.parametrize(("aspect", "covered"), [(0.46, COVERED), (0.85, 0.0), (1.24, 0.0), (1.78, 0.0)])
@pytest.mark.parametrize("size", [(6.2, 3.0), (4.0, 15.0), (30.0, 30.0)])
def test_all_of_a_plan_is_seen_and_no_smaller_than_need_be(size, aspect, covered):
    """Each corner of walls lies in the free part of the window, with 3 to 5 % to spare, and one reaches a border of it.

    Projected here by hand: an eye that looks along `ahead`, x to the right. Borders as shares of the window's half.
    """
    low, high, tall = np.array([-1.0, 2.0]), np.array([-1.0, 2.0]) + size, 2.5
    eye, target = view_from_above(low, high, aspect, tall, covered)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right, down = np.array([1.0, 0.0, 0.0]), np.cross(ahead, [1.0, 0.0, 0.0])
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (0.0, tall)])
    deep = (corners - eye) @ ahead
    half = math.tan(math.radians(FIELD_DEG) / 2)
    x, y = (corners - eye) @ right / deep / half / aspect, (corners - eye) @ down / deep / half
    lower = 1 - 2 * covered
    assert (np.abs(x) < 0.95).all() and (y > -0.95).all() and (y < lower - 0.03).all()
    assert np.abs(x).max() > 0.9 or (y.min() < -0.85 and y.max() > lower - 0.5)
    assert target[2] == pytest.approx(0, abs=1e-9), "it turns about a place on the floor"
