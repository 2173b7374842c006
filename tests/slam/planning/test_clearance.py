"""Distances to obstacles, on whole maps and at points, are those of going through all of them."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from slam.grid import GridFrame
from slam.planning.clearance import LIMIT_M, Clearance

CELL = 0.05


def _strewn(density: float) -> tuple[Clearance, np.ndarray]:
    """Obstacles at random, with surfaces anywhere in their cells, and those surfaces."""
    rng = np.random.default_rng(3)
    frame = GridFrame(origin_xy=(1.0, -2.0), resolution_m=CELL, shape=(60, 70))
    obstacle = rng.random(frame.shape) < density
    offset_m = rng.uniform(-CELL / 2, CELL / 2, (*frame.shape, 2)).astype(np.float32)
    return Clearance(frame, obstacle, offset_m), frame.centres(obstacle) + offset_m[obstacle]


@pytest.mark.parametrize("density", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("sharp_m", [0.1, 0.18, 0.3])
def test_cells_are_exact_where_it_decides(density, sharp_m):
    """The best of five points where their centres leave it open, to a micrometre; otherwise to 0.71 of a cell."""
    clearance, surfaces = _strewn(density)
    found = clearance.cells(sharp_m).ravel()
    centres = clearance.frame.centres(np.ones(clearance.frame.shape, bool))
    exact = np.minimum(cdist(centres, surfaces).min(axis=1), LIMIT_M)
    assert np.abs(found - exact).max() < 0.71 * CELL
    np.testing.assert_array_equal(found[exact >= sharp_m] >= sharp_m - 1e-6, True)
    corners = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * 0.25 * CELL
    best = np.max([exact, *(cdist(centres + c, surfaces).min(axis=1) for c in corners)], axis=0)
    close = (exact < sharp_m) & (exact > sharp_m - 0.3 * CELL)
    assert close.any()
    np.testing.assert_allclose(found[close], np.minimum(best, LIMIT_M)[close], atol=1e-6)


@pytest.mark.parametrize("density", [0.003, 0.03, 0.5])
def test_points_are_exact(density):
    """To rounding, and no more than the limit; within the window, at its rim and far outside."""
    clearance, surfaces = _strewn(density)
    points = np.random.default_rng(4).uniform([0.0, -3.0], [5.5, 2.0], (3000, 2))
    exact = np.minimum(cdist(points, surfaces).min(axis=1), LIMIT_M)
    np.testing.assert_allclose(clearance.at(points), exact, rtol=1e-14)
    np.testing.assert_array_equal(clearance.at(points.reshape(30, 100, 2)).ravel(), clearance.at(points))
    assert clearance.at(np.array([np.nan, 0.0])) == LIMIT_M


def test_without_obstacles_all_is_open():
    """The limit everywhere."""
    clearance, _ = _strewn(0.0)
    assert (clearance.cells(0.1) == np.float32(LIMIT_M)).all()
    assert clearance.at(np.array([2.0, -1.0])) == LIMIT_M
