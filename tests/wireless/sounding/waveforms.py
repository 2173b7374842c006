"""The same measurement as `wireless.sounding.sounder`, from waveforms: slow and simple.

Each beam sends a random waveform (random quarter turns on all frequencies, so that its spectrum is flat)
without pause. Every port of the receiver records one period, with noise of its own, and correlates by FFT.
Nothing of the closed form is used.
"""

import numpy as np
from jaxtyping import Complex

from wireless.channel import NOISE_DBM_PER_HZ
from wireless.sounding.sounder import Clocks, Rays, Sounder


def random_waveform(n_samples: int, rng: np.random.Generator) -> Complex[np.ndarray, " n"]:
    """Random samples of unit mean power, of flat spectrum."""
    spectrum = np.exp(0.5j * np.pi * rng.integers(0, 4, n_samples))
    return np.fft.ifft(spectrum) * np.sqrt(n_samples)


def measure_waveform(
    sounder: Sounder, rays: Rays, rng: np.random.Generator, *, clocks: Clocks | None = None
) -> Complex[np.ndarray, "links window n_basis beams"]:
    """Correlation tensors of links around their strongest delay, in units of the noise.

    Args:
        sounder: Terminals and waveform.
        rays: Paths of links.
        rng: Source of noise, waveforms, phases and offsets.
        clocks: Phases and offsets, if they are not to be drawn.
    """
    clocks = sounder.clocks(rays, rng) if clocks is None else clocks
    each = [slice(i, i + 1) for i in range(len(rays))]
    return np.stack([_measure_link(sounder, rays[i], clocks[i], rng) for i in each])


def _measure_link(
    sounder: Sounder, rays: Rays, clocks: Clocks, rng: np.random.Generator
) -> Complex[np.ndarray, "window n_basis beams"]:
    """The tensor of one link."""
    c, tx, rx = sounder.config, sounder.tx, sounder.rx
    n = c.n_samples
    sent_w = 10 ** (c.tx_power_dbm / 10 - 3)
    noise_w = 10 ** ((NOISE_DBM_PER_HZ + c.loss_db) / 10 - 3) * c.bandwidth_mhz * 1e6
    frequency = np.fft.fftfreq(n)
    late = np.exp(-2j * np.pi * frequency * sounder.arrival(rays, clocks)[0][:, None])
    signature = rx.platform.signature(rays.aoa_az[0], rays.aoa_el[0]) * clocks.rx[0, None, :, None]
    response = tx.beam_response(rays.aod_az[0], rays.aod_el[0])
    tensor = np.empty((n, sounder.n_rx, tx.n_beams), np.complex64)
    for k in range(tx.n_beams):
        waveform = random_waveform(n, rng)
        gain = (
            np.sqrt(sent_w) * rays.gain[0] * clocks.path[0] * response[:, k] * clocks.tx[0, tx.beam_array[k]]
        )
        arriving = np.fft.ifft(gain[:, None] * late * np.fft.fft(waveform))
        received = np.einsum("pam,pn->amn", signature, arriving)
        noise = rng.standard_normal((2, *received.shape)) * np.sqrt(noise_w / 2)
        received = received + noise[0] + 1j * noise[1]
        matched = np.fft.ifft(np.fft.fft(received) * np.fft.fft(waveform).conj()) / np.sqrt(n * noise_w)
        tensor[:, :, k] = np.einsum("bm,amn->nab", sounder.rx_basis, matched).reshape(n, -1)
    cells = tensor.reshape(n, len(rx.platform.face_rad), -1, tx.n_beams)
    energy = np.sum(np.abs(cells) ** 2, axis=2).max(axis=(1, 2))
    window = (energy.argmax() + np.arange(-c.half_window, c.half_window + 1)) % n
    return tensor[window]
