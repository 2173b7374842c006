"""Our path estimator: detection at a set false-alarm rate, then maximum likelihood, path by path and jointly.

A path is a delay, an azimuth of arrival and one of departure, none bound to a grid, and a size that all arrays
share while their phases are free. So a direction between two faces is estimated from both arrays, by phase within
and by size across. Paths are found and refined by `wireless.estimation.loops`; the first that would be weaker
than the threshold ends the search. More are found than returned: the residual of unexplained paths pulls on
the others' sizes, and the strongest is mistaken (measured: 1.4 of 100 first-order links between 5 paths and 12).
Paths outside the window are known by the tails of their pulses: they are
explained, so that they are not mistaken for others, and left out of the result.

The threshold is the energy that the best match in noise exceeds in a set share of links without any path. It is
learnt from measurements of noise, drawn from a fixed seed: their largest tenth, whose excess is exponential as
for maxima of many energies of Gaussian noise.
Left out: elevation (paths are taken to be level).
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Complex, Float, Int

from wireless.estimates import PathEstimates, wrapped
from wireless.estimation import climb, look, loops, residual
from wireless.estimation.climb import Curve
from wireless.estimation.loops import Curves, find_paths
from wireless.estimation.residual import Layout
from wireless.sounding import draw
from wireless.sounding import sounder as sounder_module
from wireless.sounding.sounder import Rays, Sounder
from wireless.support.cached_array import cached_array
from wireless.tracing.blocks import in_threads

#: Intervals of a full turn, and of a sample, on the curves of paths.
TURN_INTERVALS, SAMPLE_INTERVALS = 360, 20
#: Samples before and after the window where paths are looked for, to be explained.
APRON = 8
#: Most paths that are looked for.
MOST_PATHS = 12
#: Links handed to a thread at once.
BLOCK_LINKS = 64
#: Links without a path, from which the threshold is learnt, and the share of them that makes its tail.
NOISE_LINKS, TAIL = 4000, 0.1
#: Files that say how noise is drawn and what is found in it.
_CODE = [Path(str(module.__file__)) for module in (climb, draw, look, loops, residual, sounder_module)]


class SageEstimator:
    """Likelihood of all paths together, off the grid."""

    def __init__(
        self,
        sounder: Sounder,
        *,
        n_paths: int = 5,
        false_alarm_rate: float = 0.01,
        workers: int | None = None,
    ) -> None:
        """Prepare curves and threshold (about a second).

        Args:
            sounder: Sounder of the measurements.
            n_paths: Most paths returned of each link.
            false_alarm_rate: Share of links without any path in which one is found.
            workers: Threads; None for one on each available core. Results do not depend on it.
        """
        if not 0 < false_alarm_rate < 1:
            raise ValueError(f"false_alarm_rate is {false_alarm_rate:g}, expected between 0 and 1.")
        self.sounder, self.n_paths, self.workers = sounder, n_paths, workers
        self.tx_basis = _beam_basis(sounder)
        self.curves = _curves(sounder, self.tx_basis)
        peak = self._noise_peaks()
        start = np.quantile(peak, 1 - max(TAIL, false_alarm_rate))
        excess = np.mean(peak[peak > start] - start)
        self.threshold = float(start + excess * np.log(max(1.0, TAIL / false_alarm_rate)))
        """Least energy of a path."""

    def estimate(self, tensor: Complex[np.ndarray, "links window n_basis beams"]) -> PathEstimates:
        """Paths of measurements."""
        self.sounder.check_tensor(tensor)
        n_max = max(self.n_paths, MOST_PATHS)
        at, energy, seen, count = self._find(tensor, self.threshold, n_max)
        half, sample_s = self.sounder.config.half_window, self.sounder.config.sample_s
        late = at[..., 0] / SAMPLE_INTERVALS - APRON - half
        is_path = (np.arange(n_max) < count[:, None]) & (np.abs(late) <= half + 0.5)
        turn = at[..., 1:] * (2 * np.pi / TURN_INTERVALS)
        snr_db = self.sounder.snr_of_seen_db(np.where(is_path, energy, 0.0), seen)
        order = np.argsort(-snr_db, axis=1, kind="stable")[:, : self.n_paths]
        late, snr_db, is_path = (np.take_along_axis(c, order, axis=1) for c in (late, snr_db, is_path))
        turn = np.take_along_axis(turn, order[..., None], axis=1)
        estimates = PathEstimates(
            aoa_rad=np.where(is_path, wrapped(turn[..., 0]), 0.0),
            aod_rad=np.where(is_path, wrapped(turn[..., 1]), 0.0),
            snr_db=snr_db,
            delay_s=np.where(is_path, late - late[:, :1], 0.0) * sample_s,
            count=is_path.sum(axis=1),
        )
        return self.sounder.resolved(estimates)

    def _noise_peaks(self) -> Float[np.ndarray, " links"]:
        """Energy of the best match in each of many links without a path, the same for all estimators alike."""
        config, beams, arrays = (
            self.sounder.config,
            self.sounder.tx.beam_array,
            self.sounder.rx.platform.face_rad,
        )
        c, steps = self.curves, [curve[1:] for curve in self.curves[:3]]
        numbers = c.layout, c.late_step, c.late_zero, steps
        settings = repr((config, beams.tolist(), arrays, NOISE_LINKS, numbers)).encode()
        tables = c.rx.table, c.tx.table, c.late.table, c.rx_grid, c.tx_grid, c.rx_start, c.tx_start
        values = [np.ascontiguousarray(array).tobytes() for array in (self.tx_basis, *tables)]

        def learn() -> Float[np.ndarray, " links"]:
            none = np.zeros((NOISE_LINKS, 1))
            rays = Rays(gain=none + 0j, delay_s=none, aoa_az=none, aoa_el=none, aod_az=none, aod_el=none)
            noise = self.sounder.measure(rays, np.random.default_rng(0), workers=self.workers)
            return self._find(noise, 0.0, 1)[1][:, 0]

        return cached_array("noise-peaks", [settings, *values], _CODE, learn)

    def _find(
        self, tensor: Complex[np.ndarray, "links window n_basis beams"], threshold: float, n_max: int
    ) -> tuple[
        Float[np.ndarray, "links m 3"],
        Float[np.ndarray, "links m"],
        Float[np.ndarray, "links m"],
        Int[np.ndarray, " links"],
    ]:
        """Coordinates of paths on their curves, energies, what is seen of them, numbers, in the order found."""
        n = len(tensor)
        at, energy, seen = np.zeros((n, n_max, 3)), np.zeros((n, n_max)), np.ones((n, n_max))
        count = np.zeros(n, np.int64)
        basis = self.tx_basis.T.astype(np.complex64)

        def run(start: int) -> None:
            links = slice(start, start + BLOCK_LINKS)
            small = np.ascontiguousarray((tensor[links] @ basis).transpose(0, 2, 1, 3))
            out = at[links], energy[links], seen[links], count[links]
            find_paths(small, self.curves, threshold, self.n_paths, *out)

        in_threads(run, range(0, n, BLOCK_LINKS), workers=self.workers)
        return at, energy, seen, count


def _beam_basis(sounder: Sounder) -> Complex[np.ndarray, "n_basis beams"]:
    """Orthonormal rows, as many for each array, that level waves excite among its beams; filled up with zeros."""
    # Eigenvectors of a small matrix rather than singular vectors of a tall one, and a plain sum rather than a product
    # of matrices: libraries split both over threads, and the last bits would depend on the number of cores.
    ring = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    response = sounder.tx_response(ring)
    rows = []
    for array in range(len(sounder.tx.platform.face_rad)):
        mine = np.flatnonzero(sounder.tx.beam_array == array)
        seen = response[:, mine]
        energy, mode = np.linalg.eigh(np.einsum("ka,kb->ab", seen.conj(), seen))
        basis = mode[:, energy > 1e-6 * energy[-1]].T[::-1]
        rows.append(np.zeros((len(basis), sounder.tx.n_beams), complex))
        rows[-1][:, mine] = basis
    # Where beams do not divide evenly among the arrays, some have fewer.
    n_max = max(map(len, rows))
    return np.concatenate([np.pad(block, ((0, n_max - len(block)), (0, 0))) for block in rows])


def _looks(
    curve: Complex[np.ndarray, "nodes dims"], bounds: Int[np.ndarray, " parts1"], step: int
) -> tuple[Complex[np.ndarray, "parts looks ports"], Float[np.ndarray, "parts looks"]]:
    """Azimuths that each array looks at first: where it has a tenth of its best directivity, or more."""
    start = np.arange(0, TURN_INTERVALS, step)
    views, starts = [], []
    for low, high in pairwise(bounds):
        view = curve[3 * start, low:high]
        size = np.linalg.norm(view, axis=1)
        seen = size**2 > 0.1 * size.max() ** 2
        views.append((view[seen] / size[seen, None]).conj())
        starts.append(start[seen])
    shape = len(views), max(map(len, views))
    grid = np.zeros((*shape, views[0].shape[1]), np.complex64)
    places = np.zeros(shape)
    for i, (view, start) in enumerate(zip(views, starts, strict=True)):
        grid[i, : len(view)], places[i, : len(view)] = view, start
    return grid, places


def _curves(sounder: Sounder, tx_basis: Complex[np.ndarray, "n_basis beams"]) -> Curves:
    """Compute the signatures of paths as measured by this sounder."""
    azimuth = 2 * np.pi * np.arange(3 * TURN_INTERVALS) / (3 * TURN_INTERVALS)
    rx, tx = sounder.rx_response(azimuth), sounder.tx_response(azimuth) @ tx_basis.T
    rx_part, tx_part = (
        np.linspace(0, curve.shape[1], len(end.platform.face_rad) + 1).astype(int)
        for curve, end in ((rx, sounder.rx), (tx, sounder.tx))
    )
    half = sounder.config.half_window
    reach = half + APRON
    late = np.arange(2 * reach * 3 * SAMPLE_INTERVALS + 1) / (3 * SAMPLE_INTERVALS) - reach
    # Two looks to a beam: an array of n ports across resolves 2 / n radians.
    rx_step, tx_step = (
        max(1, int(TURN_INTERVALS / (2 * np.pi * np.diff(bounds).max()))) for bounds in (rx_part, tx_part)
    )
    rx_grid, rx_start = _looks(rx, rx_part, rx_step)
    tx_grid, tx_start = _looks(tx, tx_part, tx_step)
    return Curves(
        rx=Curve(np.ascontiguousarray(rx), True, len(rx_grid), 0.25 * rx_step),
        tx=Curve(np.ascontiguousarray(tx), True, len(tx_grid), 0.25 * tx_step),
        late=Curve(
            sounder.pulse(np.arange(-half, half + 1) - late[:, None]), False, 1, 0.25 * SAMPLE_INTERVALS
        ),
        rx_grid=rx_grid,
        tx_grid=tx_grid,
        rx_start=rx_start,
        tx_start=tx_start,
        layout=Layout(rx_grid.shape[2], tx_grid.shape[2], len(rx_grid), len(tx_grid)),
        late_step=float(SAMPLE_INTERVALS),
        late_zero=float(APRON * SAMPLE_INTERVALS),
    )
