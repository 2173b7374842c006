"""Diffraction by lossy wedges against a full-wave solution, which knows nothing of rays; more in the benchmarks."""

import numpy as np
import pytest

from tests.wireless.em.full_wave import diffracted, errors, traced


@pytest.fixture(scope="module")
def drywall():
    """A wedge of drywall at 28 GHz, ends 3 wavelengths from the edge, 14 nodes a wavelength."""
    eps = 2.94 - 0.0787j
    return eps, diffracted(eps, 40.0, np.arange(6.0, 266.0, 10.0), distance=3.0, per_wavelength=14)


def test_a_conducting_wedge_is_that_of_the_uniform_theory():
    """The judge judged: a wedge that conducts is off by 1 % of the incident field at most (measured 0.8 %)."""
    eps = 1 - 1e6j
    truth = diffracted(eps, 40.0, np.arange(6.0, 266.0, 10.0), distance=3.0, per_wavelength=14)
    assert errors(truth, traced(truth, eps, bisector=False)).field < 0.01


def test_a_lossy_edge_is_as_strong_as_full_waves_have_it(drywall):
    """Off by 4 % of the incident field at most (measured 3.1 %), in the shadow by 1.3 dB (1.05).

    Bisectors are off by 5.5 % and 2.4 dB.
    """
    eps, truth = drywall
    nearer, bisector = (errors(truth, traced(truth, eps, bisector=law)) for law in (False, True))
    assert nearer.field < 0.04 and nearer.shadow_db < 1.3
    assert bisector.field > 1.5 * nearer.field and bisector.shadow_db > 1.5 * nearer.shadow_db
