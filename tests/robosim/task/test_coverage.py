"""What counts as seen."""

import numpy as np
import pytest

from robosim.task.coverage import VISION_RANGE_M, Coverage
from tests.plans import room

HFOV = np.radians(90)


def _wall_at(distance_m: float) -> np.ndarray:
    """Depth image of a wall across the view."""
    return np.full((64, 64), distance_m, np.float32)


def test_an_open_view_is_a_quarter_disk():
    """Nothing hit, 90 degrees wide, 3.2 m far, in the middle of 10 m x 10 m: pi/4 * 3.2^2 = 8.04 m2."""
    plan = room(10, 10)
    coverage = Coverage(plan, plan.free, HFOV)
    coverage.update(np.array([5.0, 5.0, 0.7]), _wall_at(0))
    assert coverage.area_m2 == pytest.approx(np.pi / 4 * VISION_RANGE_M**2, rel=0.01)
    assert coverage.fraction == pytest.approx(coverage.area_m2 / 100)


@pytest.mark.parametrize("distance_m", [1.01, 2.01])
def test_a_wall_ends_the_view(distance_m):
    """A wall across the view at distance d leaves the triangle of d^2 before it, plus half a cell of rim."""
    plan = room(10, 10)
    coverage = Coverage(plan, plan.free, HFOV)
    coverage.update(np.array([5.0, 5.0, 0.0]), _wall_at(distance_m))
    assert coverage.area_m2 == pytest.approx((distance_m + 0.025) ** 2, rel=0.04)
    iy, ix = np.nonzero(coverage.seen)
    assert (ix * 0.05 + 0.025 >= 5).all(), "behind the robot is not seen"
    assert abs(iy.mean() - 99.5) < 0.5, "the view is symmetric"


def test_columns_of_the_image_run_from_left_to_right():
    """A wall in the left half of the picture hides what lies to the left, at larger y when facing +x."""
    plan = room(10, 10)
    coverage = Coverage(plan, plan.free, HFOV)
    depth = np.zeros((64, 64), np.float32)
    depth[:, :32] = 0.5
    coverage.update(np.array([5.0, 5.0, 0.0]), depth)
    iy, _ = np.nonzero(coverage.seen)
    assert (iy < 100).sum() > 10 * (iy >= 100).sum()


def test_a_turned_plan_with_the_robot_at_its_edge_is_seen_alike():
    """Three quarter disks, one from half a metre outside, in a plan turned and moved too: no cell is lost."""
    seen = []
    for origin in ((0.0, 0.0, 0.0), (30.0, -7.0, 2.1)):
        plan = room(10, 10, origin=origin)
        coverage = Coverage(plan, plan.free, HFOV)
        for x, y, yaw in ((0.0, 0.0, 0.8), (-0.5, 5.0, 0.1), (9.9, 9.9, -2.3)):
            place = plan.to_map(np.array([x, y]) / plan.resolution_m)
            coverage.update(np.array([*place, yaw + origin[2]]), _wall_at(0))
        seen.append(coverage.seen)
    assert (seen[0] != seen[1]).sum() <= 5, "cells on the rim of a view may be rounded to either side"
    assert seen[0].sum() * 0.05**2 == pytest.approx(3 * np.pi / 4 * VISION_RANGE_M**2 - 0.5**2, rel=0.01)


def test_only_the_region_counts_and_counts_once():
    plan = room(10, 10)
    region = np.zeros(plan.shape, bool)
    region[:, 120:] = True
    coverage = Coverage(plan, region, HFOV)
    for _ in range(2):
        coverage.update(np.array([5.0, 5.0, 0.0]), _wall_at(2.0))
    assert coverage.area_m2 == pytest.approx(2.025**2 - 1, rel=0.05)
    assert not coverage.seen[:, :120].any()
    assert Coverage(plan, np.zeros(plan.shape, bool), HFOV).fraction == 1.0
