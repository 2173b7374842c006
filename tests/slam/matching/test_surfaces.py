"""Surfaces of a grid stay in their cells when it grows."""

import numpy as np
import pytest

from slam.grid import GridFrame
from slam.matching.surfaces import SurfaceGrid


@pytest.mark.parametrize(("left", "below"), [(0, 0), (7, 0), (0, 9), (7, 9), (30, 40)])
def test_grown_surfaces_keep_their_places_and_fronts(left, below):
    """Wherever cells are added, a surface begins where it did, and no other cell gets any."""
    frame = GridFrame(origin_xy=(0.0, 0.0), shape=(20, 30))
    rng = np.random.default_rng(0)
    angle = rng.uniform(-np.pi, np.pi, 40)
    points = np.column_stack([rng.uniform(0, 1.5, 40), rng.uniform(0, 1, 40)])
    surfaces = SurfaceGrid(frame)
    surfaces.add(points, np.column_stack([np.cos(angle), np.sin(angle)]), np.ones(40))
    before = surfaces.front_m.copy()
    assert before.any()
    planes = surfaces.planes()
    surfaces.grow(frame.padded(left, 5, below, 3), left, below)
    expected = np.zeros((20 + below + 3, 30 + left + 5, 2), np.float32)
    expected[below : below + 20, left : left + 30] = before
    np.testing.assert_array_equal(surfaces.front_m, expected)
    for grown, old in zip(surfaces.planes(), planes, strict=True):
        np.testing.assert_allclose(grown, old, atol=1e-6)
