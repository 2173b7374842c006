"""The closed form of the Cramér-Rao bound against the Fisher information of whole measurements."""

import numpy as np
import pytest

from tests.wireless.sounding.arrival_bounds import arrival_bound_rad, departure_bound_rad, window_share
from wireless.antennas.arrays import Platform, uniform_array
from wireless.antennas.codebook import Terminal, terminal_named
from wireless.sounding.sounder import Sounder


def fisher_bound_rad(sounder, snr_db, aoa, aod, late):
    """Cramér-Rao bound on the azimuths of arrival and departure of one path.

    Numerical Fisher information of mean tensors in unit noise, 2 Re(J^H J). Unknowns: both azimuths, delay,
    size, and a phase in each pair of arrays. The mean is written from signatures, not from the package's tables.
    """
    rx, tx = sounder.rx.platform, sounder.tx
    n_rx, n_tx = len(rx.face_rad), len(tx.platform.face_rad)

    def mean(unknown):
        theta, phi, tau, size = unknown[:4]
        turn = np.exp(1j * unknown[4:].reshape(n_rx, n_tx))[:, tx.beam_array]
        f = np.fft.fftfreq(sounder.config.n_samples)
        half = sounder.config.half_window
        pulse = np.exp(2j * np.pi * f * (np.arange(-half, half + 1)[:, None] - tau)).mean(axis=1)
        a = rx.signature(np.array([theta]))[0]
        b = tx.beam_response(np.array([phi]))[0]
        return np.exp(size) * np.einsum("l,am,ak,k->lamk", pulse, a, turn, b)

    at = np.concatenate([[aoa, aod, late, 0.0], np.zeros(n_rx * n_tx)])
    at[3] = np.log(10 ** (snr_db / 20) / np.linalg.norm(mean(at)))
    step = 1e-6
    columns = [(mean(at + step * e) - mean(at - step * e)).ravel() / (2 * step) for e in np.eye(len(at))]
    jacobian = np.stack(columns, axis=1)
    used = np.linalg.norm(jacobian, axis=0) > 1e-6 * np.linalg.norm(jacobian[:, 3])
    fisher = 2 * np.real(jacobian[:, used].conj().T @ jacobian[:, used])
    return np.sqrt(np.diag(np.linalg.inv(fisher))[:2])


@pytest.mark.parametrize("names", [("gnb", "ue"), ("ue", "gnb")])
@pytest.mark.parametrize("late", [-0.45, 0.2])
def test_closed_form_is_the_inverse_of_the_fisher_information(names, late):
    """Both azimuths at random, on a face, between faces: equal within 1e-4, wherever the delay is."""
    sounder = Sounder(*map(terminal_named, names))
    rng = np.random.default_rng(6)
    aoa = np.concatenate([[0.1, np.deg2rad(60.3), np.deg2rad(-179.0)], rng.uniform(-np.pi, np.pi, 4)])
    aod = np.roll(aoa, 3)
    got = arrival_bound_rad(sounder, aoa, 20.0), departure_bound_rad(sounder, aod, 20.0)
    want = [fisher_bound_rad(sounder, 20.0, a, d, late) for a, d in zip(aoa, aod, strict=True)]
    np.testing.assert_allclose(np.transpose(got), want, rtol=1e-4)


def test_a_line_of_isotropic_ports_has_the_textbook_bound():
    """M ports half a wavelength apart, E the energy: var = 6 / (E pi^2 cos^2 (M^2 - 1))."""
    ports, azimuth = 8, 0.4
    one = Terminal(
        platform=Platform(array=uniform_array(ports, element="isotropic"), face_rad=(0.0,)), n_beams=8
    )
    got = arrival_bound_rad(Sounder(one, one), np.array([azimuth]), 20.0)[0]
    want = np.sqrt(6 / (100 * np.pi**2 * np.cos(azimuth) ** 2 * (ports**2 - 1)))
    assert got == pytest.approx(want, rel=1e-6)


def test_window_holds_nearly_all_energy():
    """sin^2(pi x) / (pi x)^2 beyond 5.5 samples from the delay: 1 / (2 pi^2) * 2 / 5.5 = 0.018 on average."""
    share = window_share(Sounder(terminal_named("gnb"), terminal_named("ue")))
    assert share == pytest.approx(1 - 0.018, abs=0.001)
