"""The limit of resolution: what sums of fields do to the strongest path."""

import numpy as np
import pytest

from tests.benchmarks.resolution import signature_agreement, strongest_sum_rad
from wireless.antennas.codebook import terminal_named
from wireless.sounding.sounder import Rays, Sounder


@pytest.fixture(scope="module")
def sounder():
    return Sounder(terminal_named("gnb"), terminal_named("ue"))


def rays(gain, aoa_deg, *, delay=0.0, aod_deg=20.0, n=2000):
    """The same paths n times: gains, azimuths [deg], delays [samples of 2.5 ns]."""
    gain, aoa, delay, aod = np.broadcast_arrays(*map(np.atleast_1d, (gain, aoa_deg, delay, aod_deg)))
    zero = np.zeros((n, len(gain)))
    return Rays(
        gain=zero + gain + 0j,
        delay_s=zero + 2.5e-9 * delay,
        aoa_az=zero + np.deg2rad(aoa),
        aoa_el=zero,
        aod_az=zero + np.deg2rad(aod),
        aod_el=zero,
    )


def test_agreement_is_that_of_a_line_in_space_and_of_a_pulse_in_time(sounder):
    """Uncoupled ports at half a wavelength: sin(4 x) / (8 sin(x / 2)), x = pi sin 2.5 degrees, is 0.95.

    Coupling and elements change it by less than 0.02; half a sample apart sinc(1/2) = 2 / pi, which times the rest.
    """
    x = np.pi * np.sin(np.deg2rad(2.5))
    line = np.sin(4 * x) / (8 * np.sin(x / 2))
    agree = np.abs(signature_agreement(sounder, rays([1, 1], [0.0, 2.5], n=1))[0])
    np.testing.assert_allclose(np.diag(agree), 1.0, atol=1e-9)
    assert agree[0, 1] == agree[1, 0] == pytest.approx(line, abs=0.02)
    assert line == pytest.approx(0.95, abs=0.01)
    late = np.abs(signature_agreement(sounder, rays([1, 1], [0.0, 2.5], delay=[0, 0.5], n=1))[0, 0, 1])
    assert late == pytest.approx(agree[0, 1] * 2 / np.pi, rel=1e-3)


def test_paths_apart_are_distinguished_by_their_gains(sounder):
    """90 degrees apart, or alike but 2 samples later: the strongest path is the strongest sum, always."""
    rng = np.random.default_rng(0)
    for other in ({"aoa_deg": [0.0, 90.0]}, {"aoa_deg": [0.0, 5.0], "delay": [0.0, 2.0]}):
        assert np.all(strongest_sum_rad(sounder, rays([1.0, 0.99], **other), rng) == 0.0)


def test_two_alike_paths_lose_to_a_third_as_often_as_they_cancel(sounder):
    """Equal fields of random phases against one as large from another direction: |1 + e^(i phi)| < 1 in a third of all.

    10,000 links: within 4 standard deviations, 0.019. Powers instead of fields would never lose.
    """
    paths = rays([1.0, 1.0, 0.999], [0.0, 0.0, 90.0], n=10_000)
    got = np.rad2deg(strongest_sum_rad(sounder, paths, np.random.default_rng(1)))
    assert np.mean(got > 1) == pytest.approx(1 / 3, abs=0.02)
