"""Pieces of the benchmark of estimation that judge: SNR of links, and errors of angles."""

import numpy as np
import pytest

from tests.benchmarks import estimation
from wireless.antennas.codebook import terminal_named
from wireless.estimates import PathEstimates
from wireless.sounding.sounder import Rays, Sounder


def test_snr_is_that_of_the_measured_tensor():
    """Energy of the strongest tensor without noise to speak of: 90 dB as set, less what leaves the window."""
    sounder = Sounder(terminal_named("gnb"), terminal_named("ue"))
    column = np.array([[0.7]])
    rays = Rays(
        gain=column * 1e-3 + 0j,
        delay_s=column * 0,
        aoa_az=column,
        aoa_el=column * 0,
        aod_az=-column,
        aod_el=column * 0,
    )
    tensor = sounder.measure(rays, np.random.default_rng(0))
    energy_db = 10 * np.log10(np.sum(np.abs(tensor) ** 2))
    assert estimation.strongest_energy_db(sounder, rays)[0] == pytest.approx(energy_db, abs=0.25)


def test_errors_wrap_and_missing_paths_are_half_a_turn():
    """From 179 to -179 degrees are 2; a link without a path is 180 degrees off."""

    class Fixed:
        def estimate(self, tensor):
            aoa = np.deg2rad([[-179.0, 0.0], [0.0, 0.0]])
            return PathEstimates(aoa_rad=aoa, aod_rad=aoa, snr_db=aoa, delay_s=aoa, count=np.array([1, 0]))

    true = np.deg2rad([[179.0, -170.0], [0.0, 90.0]])
    got = estimation.arrival_error_rad(Fixed(), np.zeros((2, 1, 1, 1), complex), true)
    np.testing.assert_allclose(np.rad2deg(got), [[2.0, 9.0], [180.0, 180.0]])
