"""The reference's path estimator: principal components of the measured tensor.

The tensor (delay, receive port, beam) is first split between receive ports and the rest: each singular pair is
a receive signature times a (delay, beam) matrix. Each such matrix is split between delay and beam. Of these
rank-one terms the strongest are used. A term's delay is where its delay vector peaks, its departure the beam
where its beam vector peaks, its arrival the azimuth on a grid whose signature matches best, arrays combined
without their phases. Its SNR (`wireless.estimates`) comes of its energy; the reference divides
that by the mean of the whole tensor, of which strong paths are a part.

As in the reference there is no threshold: it always returns the requested number of paths, those in noise too.
Terms are orthogonal, paths are not: close paths share terms, and strong ones leak into others.
Reference: arXiv 2110.14789, section on path estimation; the public code scans arrivals in steps of 1 degree.
"""

import numpy as np
from jaxtyping import Complex, Float

from wireless.estimates import PathEstimates
from wireless.sounding.sounder import Sounder

#: Links that are decomposed at once.
BLOCK_LINKS = 256


class PcaEstimator:
    """Two-sided principal components, read on grids."""

    def __init__(self, sounder: Sounder, *, n_paths: int = 5, n_azimuths: int = 360) -> None:
        """Prepare the grid.

        Args:
            sounder: Sounder of the measurements.
            n_paths: Number of paths returned of each link.
            n_azimuths: Number of azimuths of arrival tried.
        """
        self.sounder, self.n_paths = sounder, n_paths
        self.azimuth_rad = 2 * np.pi * np.arange(n_azimuths) / n_azimuths - np.pi
        arrays = len(sounder.rx.platform.face_rad)
        response = sounder.rx_response(self.azimuth_rad)
        response = response / np.maximum(np.linalg.norm(response, axis=-1, keepdims=True), 1e-12)
        self.match = response.conj().reshape(n_azimuths, arrays, -1).transpose(1, 0, 2).astype(np.complex64)

    def estimate(self, tensor: Complex[np.ndarray, "links window n_basis beams"]) -> PathEstimates:
        """The strongest terms of measurements."""
        self.sounder.check_tensor(tensor)
        n = self.n_paths
        columns = [np.empty((len(tensor), n)) for _ in range(4)]
        for start in range(0, len(tensor), BLOCK_LINKS):
            links = slice(start, start + BLOCK_LINKS)
            for column, values in zip(columns, self._estimate_block(tensor[links]), strict=True):
                column[links] = values
        aoa, aod, snr, delay = columns
        count = np.full(len(tensor), n)
        estimates = PathEstimates(aoa_rad=aoa, aod_rad=aod, snr_db=snr, delay_s=delay, count=count)
        return self.sounder.resolved(estimates)

    def _estimate_block(self, tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        n, window, n_basis, beams = tensor.shape
        n_paths = self.n_paths
        ports_first = np.ascontiguousarray(tensor.transpose(0, 2, 1, 3)).reshape(n, n_basis, -1)
        _, signature = _strongest_modes(ports_first, n_paths)
        rest = (signature.conj().transpose(0, 2, 1) @ ports_first).reshape(n, -1, window, beams)
        inner_energy, timing = _strongest_modes(rest, n_paths)
        inner_energy = inner_energy[..., :n_paths]
        beam = timing.conj().swapaxes(-1, -2) @ rest
        # The strongest of all pairs of components.
        flat = inner_energy.reshape(n, -1)
        order = np.argsort(-flat, axis=1, kind="stable")[:, :n_paths]
        row = np.arange(n)[:, None]
        outer, inner = np.divmod(order, inner_energy.shape[2])
        aoa = self._read_arrivals(signature)[row, outer]
        late = np.abs(timing).argmax(axis=-2)[row, outer, inner]
        aod = self.sounder.tx.beam_rad[np.abs(beam[row, outer, inner]).argmax(axis=-1)]
        snr_db = self.sounder.snr_db(np.maximum(flat[row, order], 1e-30), aoa, aod)
        again = np.argsort(-snr_db, axis=1, kind="stable")
        aoa, aod, snr_db, late = (np.take_along_axis(c, again, axis=1) for c in (aoa, aod, snr_db, late))
        return aoa, aod, snr_db, (late - late[:, :1]) * self.sounder.config.sample_s

    def _read_arrivals(
        self, signature: Complex[np.ndarray, "links n_basis components"]
    ) -> Float[np.ndarray, "links components"]:
        """Azimuth whose signature fits best."""
        n, _, components = signature.shape
        parts = signature.transpose(0, 2, 1).reshape(n * components, len(self.match), -1).swapaxes(0, 1)
        fit = sum(np.abs(pattern @ match.T) ** 2 for pattern, match in zip(parts, self.match, strict=True))
        return self.azimuth_rad[fit.argmax(axis=1).reshape(n, components)]


def _strongest_modes(
    matrix: Complex[np.ndarray, "*batch rows columns"], n_modes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Energies of all left singular vectors, falling, and the first few vectors as columns."""
    power, mode = np.linalg.eigh(matrix @ matrix.conj().swapaxes(-1, -2))
    return np.maximum(power[..., ::-1], 0), mode[..., ::-1][..., :n_modes]
