"""Exact cylinders obey what any exact solution obeys."""

import numpy as np
import pytest

from tests.wireless.em.cylinder import coefficients, cylinder_field


@pytest.mark.parametrize("parallel", [True, False])
def test_cylinder_of_air_scatters_nothing(parallel):
    places = np.array([[-30.0, 1.0], [25.0, 3.0]])
    assert np.allclose(cylinder_field(20.0, 1.0, 40.0, places, parallel=parallel), 1, atol=1e-12)


@pytest.mark.parametrize("parallel", [True, False])
def test_cylinder_without_losses_absorbs_nothing_in_any_order(parallel):
    assert np.allclose(np.abs(1 - 2 * coefficients(20.0, 4.0, parallel=parallel)), 1, atol=1e-12)


@pytest.mark.parametrize("parallel", [True, False])
def test_source_and_observer_are_interchangeable(parallel):
    eps, place = 16.6 - 16.6j, np.array([[-60.0, 25.0]])
    there = cylinder_field(20.0, eps, 35.0, place, parallel=parallel)
    angle = np.arctan2(*place[0][::-1])
    back = np.array([[35 * np.cos(angle), -35 * np.sin(angle)]])
    assert np.allclose(there, cylinder_field(20.0, eps, np.hypot(*place[0]), back, parallel=parallel))


def test_thin_cylinder_scatters_as_in_the_limit_of_long_waves():
    radius, eps = 0.02, 3.0 - 0.5j
    area = 1j * np.pi / 4 * radius**2
    assert coefficients(radius, eps, parallel=True)[0] == pytest.approx(area * (eps - 1), rel=2e-3)
    assert coefficients(radius, eps, parallel=False)[1] == pytest.approx(
        area * (eps - 1) / (eps + 1), rel=2e-3
    )
