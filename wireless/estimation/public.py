"""The receiver that the public measurements of mmwRobotNav come from: what it makes out of traced paths.

Like `wireless.estimation.pca` it takes the strongest singular pairs of the measured tensor between receive ports
and (delay, beam), but one path of each, without a second split. A path's SNR is the largest entry of its term,
after the receive beam that fits best, over the mean energy of all entries of the whole recording, the signal's
own included: it says how peaked a term is rather than how strong, and saturates where noise does not matter. The
height of its peak is the match of its receive signature over azimuth: largest over mean.

Energies are per sample, without the gain of correlating many: 30 dB less than `wireless.sounding.sounder` has for as
many samples, which the power here makes up for. Of delays only a window around the strongest is looked at; the
published files leave delays out.

Reference: Yin et al., arXiv 2110.14789, and the receiver in its repository mmwRobotNav, from which the rules are.
"""

import numpy as np
from jaxtyping import Complex, Float

from wireless.antennas.codebook import terminal_named
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig

#: Samples of a recording, power [dBm], and noise figure [dB].
N_SAMPLES, TX_POWER_DBM, NOISE_FIGURE_DB = 1024, 23.0, 7.0
#: Paths of a link.
N_PATHS = 5
#: Links that are measured at once.
BLOCK_LINKS = 256


class PublicReceiver:
    """The published base station sends, the published robot listens."""

    def __init__(self) -> None:
        config = SoundingConfig(
            tx_power_dbm=TX_POWER_DBM - 10 * np.log10(N_SAMPLES),
            n_samples=N_SAMPLES,
            loss_db=NOISE_FIGURE_DB,
        )
        self.sounder = Sounder(terminal_named("gnb"), terminal_named("ue"), config)
        self.azimuth_rad = np.radians(np.arange(-179.0, 181.0))
        response = self.sounder.rx_response(self.azimuth_rad)
        response = response / np.linalg.norm(response, axis=1, keepdims=True)
        arrays = len(self.sounder.rx.platform.face_rad)
        self._match = response.conj().reshape(len(response), arrays, -1).astype(np.complex64)

    def receive(self, rays: Rays, rng: np.random.Generator) -> tuple[Float[np.ndarray, "n 5"], ...]:
        """Azimuths of arrival and departure [rad], SNRs [dB] and heights of peaks, strongest term first.

        A link without rays gets SNRs of -inf.
        """
        columns = tuple(np.zeros((len(rays), N_PATHS)) for _ in range(4))
        for start in range(0, len(rays), BLOCK_LINKS):
            block = slice(start, start + BLOCK_LINKS)
            measured = self.sounder.measure(rays[block], rng, workers=1)
            for column, values in zip(columns, self.estimate(measured), strict=True):
                column[block] = values
        columns[2][~(rays.gain != 0).any(axis=1)] = -np.inf
        return columns

    def estimate(
        self, tensor: Complex[np.ndarray, "n window n_basis beams"]
    ) -> tuple[Float[np.ndarray, "n 5"], ...]:
        """Estimate the paths of measurements."""
        n, window, n_basis, beams = tensor.shape
        ports_first = tensor.transpose(0, 2, 1, 3).reshape(n, n_basis, window * beams)
        energy, signature = np.linalg.eigh(ports_first @ ports_first.conj().swapaxes(1, 2))
        energy = np.maximum(energy[:, ::-1][:, :N_PATHS], 1e-30)
        signature = signature[:, :, ::-1][:, :, :N_PATHS].swapaxes(1, 2)
        share = np.abs(signature.conj() @ ports_first) ** 2 / energy[..., None]
        parts = signature.reshape(n, N_PATHS, self._match.shape[1], -1)
        match = sum(np.abs(parts[:, :, i] @ self._match[:, i].T) ** 2 for i in range(parts.shape[2]))
        # Outside of the window there is noise of unit variance, and paths too weak or late to matter.
        outside = (N_SAMPLES - window) * n_basis * beams
        mean = (np.sum(np.abs(tensor) ** 2, axis=(1, 2, 3)) + outside) / (N_SAMPLES * n_basis * beams)
        snr = match.max(axis=2) * energy * share.max(axis=2) / mean[:, None]
        return (
            self.azimuth_rad[match.argmax(axis=2)],
            self.sounder.tx.beam_rad[share.argmax(axis=2) % beams],
            10 * np.log10(snr),
            match.max(axis=2) / match.mean(axis=2),
        )
