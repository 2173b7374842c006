"""Radio bands: link budgets against closed forms, and what a lone path looks like in each."""

import numpy as np
import pytest
from scipy.constants import Boltzmann, speed_of_light

from wireless.antennas.arrays import Platform, circular_array
from wireless.antennas.codebook import terminal_named
from wireless.bands import BANDS, band_named
from wireless.estimates import wrapped
from wireless.estimation.pca import PcaEstimator
from wireless.estimation.sage import SageEstimator
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig

FAR_M, N_LINKS = 5.0, 64


def sounder_of(name: str) -> Sounder:
    band = BANDS[name]
    return Sounder(terminal_named(band.transmitter), terminal_named(band.receiver), band.sounding)


def test_the_reference_is_a_band():
    assert BANDS["28ghz"].sounding == SoundingConfig()


def test_an_unknown_band():
    with pytest.raises(ValueError, match=r"band is 'wifi-7'\. Did you mean 'wifi-\d.*Known: ble, .*140ghz"):
        band_named("wifi-7")


@pytest.mark.parametrize("name", BANDS)
def test_noise_is_thermal(name):
    """SNR before correlation is P / (k T B F) at 290 K: within 0.03 dB, by which -174 dBm/Hz is rounded."""
    band = BANDS[name]
    noise_w = Boltzmann * 290 * band.bandwidth_mhz * 1e6 * 10 ** (band.loss_db / 10)
    snr_db = band.tx_power_dbm - 30 - 10 * np.log10(noise_w)
    assert band.sounding.snr_per_gain_db - 10 * np.log10(band.n_samples) == pytest.approx(snr_db, abs=0.03)


def test_uwb_power_is_that_of_the_limit_of_density():
    """-41.3 dBm/MHz over the bandwidth."""
    band = BANDS["uwb-6.5"]
    assert band.tx_power_dbm == pytest.approx(-41.3 + 10 * np.log10(band.bandwidth_mhz), abs=0.05)


@pytest.mark.parametrize("name", BANDS)
@pytest.mark.parametrize("kind", [SageEstimator, PcaEstimator])
def test_a_lone_path_is_measured_all_around(name, kind):
    """Five metres away in free space: arrivals within 0.1 degrees (PCA: 1.5), gains within 1 dB of Friis' law.

    Measured at worst: 0.06 degrees (1.35) and 0.7 dB. Departures and delays are finite where the band resolves them,
    and otherwise NaN.
    """
    band, rng, none = BANDS[name], np.random.default_rng(0), np.zeros((N_LINKS, 1))
    gain = np.full(none.shape, speed_of_light / band.frequency_hz / (4 * np.pi * FAR_M), complex)
    aoa, aod = (rng.uniform(-np.pi, np.pi, none.shape) for _ in range(2))
    sounder = sounder_of(name)
    rays = Rays(gain=gain, delay_s=none, aoa_az=aoa, aoa_el=none, aod_az=aod, aod_el=none)
    paths = kind(sounder).estimate(sounder.measure(rays, rng, workers=1))
    off_deg = np.degrees(np.abs(wrapped(paths.aoa_rad[:, 0] - aoa[:, 0])))
    assert off_deg.max() < (0.1 if kind is SageEstimator else 1.5)
    assert sounder.gain_db(paths)[:, 0] == pytest.approx(20 * np.log10(abs(gain[:, 0])), abs=1.0)
    assert np.isfinite(paths.aod_rad).all() == (band.transmitter != "tag")
    assert np.isfinite(paths.delay_s).all() == (name not in ("ble", "wifi-2.4"))


def test_a_ring_looks_to_all_sides():
    """Signatures more than 45 degrees apart differ; those of four antennas half a wavelength apart do not always."""
    ring = np.radians(np.arange(0, 360, 3))

    def likeness(n: int, spacing_wl: float) -> np.ndarray:
        platform = Platform(array=circular_array(n, spacing_wl=spacing_wl), face_rad=(0.0,))
        seen = platform.signature(ring)[:, 0]
        seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
        return np.abs(seen.conj() @ seen.T)[np.abs(wrapped(ring[:, None] - ring)) > np.radians(45)]

    assert likeness(8, 0.4).max() < 0.5
    assert likeness(4, 0.5).max() == pytest.approx(1.0, abs=1e-9)
