"""The direct draw of measurements against full waveforms, and both against closed forms."""

import numpy as np
import pytest
from scipy import stats

from tests.wireless.sounding.waveforms import measure_waveform
from wireless.antennas.arrays import Platform, uniform_array
from wireless.antennas.codebook import Terminal, terminal_named
from wireless.estimation.pca import PcaEstimator
from wireless.paths import Paths
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig

#: Chance of a test failing though all is right, were the seed another.
RARE = 1e-4


@pytest.fixture(scope="module")
def small():
    """A sounder whose waveforms are cheap: two arrays at either end, 128 samples."""

    def terminal(columns, rows, beams):
        platform = Platform(array=uniform_array(columns, rows, element="3gpp"), face_rad=(0.0, np.pi / 2))
        return Terminal(platform=platform, n_beams=beams)

    return Sounder(
        terminal(2, 2, 6), terminal(3, 1, 6), SoundingConfig(n_samples=128, half_window=3, tx_power_dbm=0.0)
    )


def rays(n, sounder, snr_db, delays=(0.3,), angles=((0.4, 0.9),), relative_db=(0.0,)):
    """The same paths n times; SNR after correlation between isotropic antennas, delays in samples."""
    level = 10 ** ((snr_db - sounder.config.snr_per_gain_db + np.array(relative_db)) / 20)
    aoa, aod = np.array(angles).T
    columns = {
        "gain": level + 0j,
        "delay_s": np.array(delays) * sounder.config.sample_s,
        "aoa_az": aoa,
        "aoa_el": 0 * aoa,
        "aod_az": aod,
        "aod_el": 0 * aod,
    }
    return Rays(**{name: np.tile(value, (n, 1)) for name, value in columns.items()})


def same_clocks(sounder, links, seed):
    """Phases and offsets that all links share."""
    one = sounder.clocks(links[:1], np.random.default_rng(seed))
    return one[np.zeros(len(links), int)]


def test_link_budget_by_hand():
    """23 dBm over -174 dBm/Hz + 86.02 dBHz + 6 dB, times 2048 samples (33.11 dB): 138.09 dB."""
    assert SoundingConfig().snr_per_gain_db == pytest.approx(23 + 174 - 86.0206 - 6 + 33.1133, abs=1e-3)


@pytest.mark.parametrize("measure", ["draw", "waveform"])
def test_strong_path_is_the_outer_product_of_pulse_and_responses(small, measure):
    """At 150 dB the tensor is sqrt(SNR) D(l - tau) a_r b_k, phases of clocks aside, to rounding.

    A wrong sign of the delay, a conjugated response or a wrong basis breaks the match.
    """
    links = rays(1, small, 150.0)
    rng = np.random.default_rng(2)
    tensor = (small.measure if measure == "draw" else lambda *a: measure_waveform(small, *a))(links, rng)[0]
    peak = int(np.abs(tensor).max(axis=(1, 2)).argmax())
    assert peak == 3
    a, b = small.rx_response(links.aoa_az[0])[0], small.tx_response(links.aod_az[0])[0]
    for rx in range(2):
        for beams in (small.tx.beam_array == 0, small.tx.beam_array == 1):
            block = tensor[:, 3 * rx : 3 * rx + 3][..., beams]
            want = np.multiply.outer(a[3 * rx : 3 * rx + 3], b[beams])
            pulse = np.einsum("lrk,rk->l", block, want.conj()) / np.sum(np.abs(want) ** 2)
            np.testing.assert_allclose(block, pulse[:, None, None] * want, atol=1e-6 * 10**7.5)
    # One fractional delay explains the pulse, whatever its phase.
    delays = np.linspace(-0.5, 0.5, 20001)
    shape = small.pulse(np.arange(-3, 4) - delays[:, None])
    fit = np.abs(shape.conj() @ pulse) ** 2 / np.sum(np.abs(shape) ** 2, axis=1)
    assert fit.max() == pytest.approx(np.sum(np.abs(pulse) ** 2), rel=1e-6)
    assert np.abs(pulse).max() / np.abs(shape[fit.argmax()]).max() == pytest.approx(10**7.5, rel=1e-3)


def test_draw_and_waveform_agree_in_mean_and_covariance(small):
    """Two paths at 30 dB, the same clocks in all draws: means agree and noise is white, of unit variance.

    chi^2 of the difference of means and of both noise energies; the largest correlation between entries as
    of that many independent pairs.
    """
    n = 250
    links = rays(n, small, 30.0, (0.3, 2.1), ((0.4, 0.9), (1.2, 0.2)), (0.0, -3.0))
    clocks = same_clocks(small, links, 5)
    drawn = small.measure(links, np.random.default_rng(3), clocks=clocks).reshape(n, -1)
    waved = measure_waveform(small, links, np.random.default_rng(4), clocks=clocks).reshape(n, -1)
    off = n * np.sum(np.abs(drawn.mean(axis=0) - waved.mean(axis=0)) ** 2)
    assert RARE < stats.chi2.cdf(off, 2 * drawn.shape[1]) < 1 - RARE
    for tensor in (drawn, waved):
        noise = tensor - tensor.mean(axis=0)
        degrees = 2 * (n - 1) * noise.shape[1]
        assert RARE < stats.chi2.cdf(2 * np.sum(np.abs(noise) ** 2), degrees) < 1 - RARE
        pairs = np.abs(noise.T @ noise.conj()) ** 2 / n
        pairs = pairs[np.triu_indices(len(pairs), 1)]
        assert pairs.max() < np.log(len(pairs) / RARE) * 1.3  # of mean 1, nearly exponential


@pytest.mark.parametrize("snr_db", [-300.0, 3.0, 6.0])
def test_draw_and_waveform_agree_where_noise_may_win(small, snr_db):
    """No path, and paths that noise beats often: laws of the strongest cell, its delay's neighbours, the total.

    Kolmogorov-Smirnov on 400 draws each. A window that never falls on noise fails at once.
    """
    links = rays(400, small, snr_db, (0.3, 4.1), ((0.4, 0.9), (1.2, 0.2)), (0.0, -3.0))
    drawn = small.measure(links, np.random.default_rng(8))
    waved = measure_waveform(small, links, np.random.default_rng(9))

    def cells(tensor):
        return np.sum(np.abs(tensor.reshape(len(tensor), 7, 2, 3, 6)) ** 2, axis=3).max(axis=(2, 3))

    for read in (
        lambda t: cells(t)[:, 3],
        lambda t: cells(t)[:, 2],
        lambda t: cells(t)[:, 6],
        lambda t: np.sum(np.abs(t) ** 2, axis=(1, 2, 3)),
    ):
        assert stats.ks_2samp(read(drawn), read(waved)).pvalue > RARE
    assert np.all(cells(drawn).argmax(axis=1) == 3)


def test_estimates_of_draw_and_waveform_are_alike(small):
    """Errors of arrival and SNR of the reference's estimator follow one law, at 12 dB, with random clocks."""
    links = rays(400, small, 12.0, (0.3, 2.1), ((0.4, 0.9), (1.2, 0.2)), (0.0, -6.0))
    estimator = PcaEstimator(small)
    got = [
        estimator.estimate(measure(links, np.random.default_rng(seed)))
        for seed, measure in ((1, small.measure), (2, lambda *a: measure_waveform(small, *a)))
    ]
    for read in (lambda e: e.aoa_rad[:, 0], lambda e: e.snr_db[:, 0], lambda e: e.delay_s[:, 1]):
        assert stats.ks_2samp(read(got[0]), read(got[1])).pvalue > RARE


def test_arrays_have_phases_of_their_own():
    """Phase between what two receive arrays receive of one path is uniform over links, and so between beams."""
    sounder = Sounder(terminal_named("gnb"), terminal_named("ue"))
    links = rays(400, sounder, 40.0, (0.0,), ((np.pi / 3, np.pi / 3),))
    tensor = sounder.measure(links, np.random.default_rng(1))[:, 5]
    a, b = sounder.rx_response(links.aoa_az[0])[0], sounder.tx_response(links.aod_az[0])[0]
    stored = len(sounder.rx_basis)
    received = tensor * (a[:, None] * b).conj()
    by_rx = received.reshape(400, 3, stored, -1).sum(axis=(2, 3))
    by_tx = np.stack([received[..., sounder.tx.beam_array == i].sum(axis=(1, 2)) for i in range(2)], axis=1)
    for parts in (by_rx, by_tx):
        turn = np.angle(parts[:, 0] / parts[:, 1])
        assert stats.kstest(turn, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > RARE


def test_workers_do_not_change_a_bit():
    """One thread or three, the same tensors; another seed, others."""
    sounder = Sounder(terminal_named("ue"), terminal_named("gnb"))
    links = rays(150, sounder, 10.0)
    one = sounder.measure(links, np.random.default_rng(6), workers=1)
    assert np.array_equal(one, sounder.measure(links, np.random.default_rng(6), workers=3))
    assert not np.array_equal(one, sounder.measure(links, np.random.default_rng(7), workers=1))


def test_headings_turn_what_terminals_see():
    """Paths of two links, by hand: azimuths less the heading of each terminal, gains theta to theta."""
    paths = Paths(
        tx_position=np.zeros((1, 3)),
        rx_position=np.ones((2, 3)),
        frequency_hz=28e9,
        tx=np.array([0, 0, 0]),
        rx=np.array([0, 0, 1]),
        gain=np.array([[[3, 9], [9, 9]], [[2j, 9], [9, 9]], [[1, 9], [9, 9]]], complex),
        power=np.array([9.0, 4.0, 1.0]),
        delay_s=np.array([1e-8, 2e-8, 3e-8]),
        aoa_az=np.array([0.1, 0.2, 0.3]),
        aoa_el=np.zeros(3),
        aod_az=np.array([1.1, 1.2, 1.3]),
        aod_el=np.zeros(3),
        order=np.zeros(3, np.uint8),
        interaction=np.zeros((3, 1), np.uint8),
        primitive=np.full((3, 1), -1),
        point=np.full((3, 1, 3), np.nan),
    )
    got = Rays.from_paths(paths, rx_heading_rad=np.array([0.5, -0.5]), tx_heading_rad=1.0)
    np.testing.assert_allclose(got.gain, [[3, 2j], [1, 0]])
    np.testing.assert_allclose(got.aoa_az, [[-0.4, -0.3], [0.8, 0.0]])
    np.testing.assert_allclose(got.aod_az, [[0.1, 0.2], [0.3, 0.0]])


def test_bad_settings_are_named():
    """The message gives the value and what to do."""
    with pytest.raises(ValueError, match="half_window is 5 at n_samples 16"):
        SoundingConfig(n_samples=16)
    with pytest.raises(ValueError, match="bandwidth_mhz is 0"):
        SoundingConfig(bandwidth_mhz=0.0)
