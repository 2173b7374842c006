"""The beam-swept measurement of a link: what a receiver can know of its paths.

For each beam of the transmitter, every port of the receiver records one period of a known waveform of N
samples with a flat spectrum, and correlates with it. A path of amplitude g, delay tau (in samples), signature
a at the receiver and beam response b at the transmitter then adds

    sqrt(P N / N0 B F) g D(l - tau) a_r b_k,    D(x) = mean over f of exp(2 pi j f x / N),

at delay l, port r, beam k, on noise that is white with unit variance over l, r and k: correlation with a flat
spectrum is unitary. Thus this tensor can be drawn directly, at a small part of the cost of the waveforms;
the tests compare it with waveforms.

Clocks are not locked: delays have a common random offset, each path a random phase, each array of either end
an oscillator phase of its own. So the receiver looks for the delay where one of its arrays, in one beam,
received the most energy, and keeps a window around. Of all other delays only the one thing is drawn that
matters: whether noise was stronger there (`wireless.sounding.draw`).

Of each receive array the measurement keeps its projection on what waves of zero elevation can excite: all
ports of a line, 4 of the 16 of the reference's plane.
Left out: Doppler, carrier offset, quantisation, phase noise.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.constants import speed_of_light
from scipy.special import gammainccinv

from robosim.support.checks import Range, checked
from wireless.antennas.codebook import Terminal
from wireless.channel import noise_power_dbm
from wireless.estimates import PathEstimates
from wireless.paths import Paths
from wireless.sounding.draw import draw_windows, find_candidates
from wireless.tracing.blocks import in_threads

#: Numbers of any shape.
Numbers = Float[np.ndarray, "*batch"]


#: Size of a room [m], which paths of a link differ by.
_ROOM_M = 5.0
#: Links that share one stream of random numbers: results depend on it, but on no number of workers.
BLOCK_LINKS = 64


@dataclass(frozen=True, kw_only=True)
@checked
class SoundingConfig:
    """Power, waveform and window of the measurement; as in the reference."""

    tx_power_dbm: Annotated[float, Range(-200, 200, "dBm")] = 23.0
    """Transmit power [dBm]."""
    bandwidth_mhz: Annotated[float, Range(1e-3, 1e5, "MHz")] = 400.0
    """Bandwidth, and rate of complex samples [MHz]."""
    n_samples: Annotated[int, Range(8, 1 << 24, "samples")] = 2048
    """Samples of the waveform, sent once in each beam."""
    loss_db: Annotated[float, Range(-200, 200, "dB")] = 6.0
    """Noise figure and other losses [dB]."""
    half_window: Annotated[int, Range(1, 1 << 16, "samples")] = 5
    """Samples that are recorded before and after the strongest delay."""

    def __post_init__(self) -> None:
        if 8 * self.half_window > self.n_samples:
            raise ValueError(
                f"half_window is {self.half_window} at n_samples {self.n_samples}, expected at most an eighth of the "
                "samples. Shorten the window or lengthen the waveform."
            )

    @property
    def sample_s(self) -> float:
        """Time between samples."""
        return 1e-6 / self.bandwidth_mhz

    @property
    def noise_dbm(self) -> float:
        """Noise of the receiver, with its losses [dBm]."""
        return noise_power_dbm(self.bandwidth_mhz, self.loss_db)

    @property
    def snr_per_gain_db(self) -> float:
        """SNR after correlation of a path of unit power gain, between isotropic antennas."""
        return self.tx_power_dbm - self.noise_dbm + 10 * float(np.log10(self.n_samples))

    @property
    def resolves_delays(self) -> bool:
        """Whether a wave travels no farther than the size of a room in a sample: otherwise paths arrive at once."""
        return speed_of_light * self.sample_s <= _ROOM_M

    @property
    def window(self) -> int:
        """Number of delays in the window."""
        return 2 * self.half_window + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """Paths of many links as seen by their two terminals; unused places have no gain."""

    gain: Complex[np.ndarray, "links rays"]
    """Complex gain between isotropic antennas; 0 for none."""
    delay_s: Float[np.ndarray, "links rays"]
    """Time of flight."""
    aoa_az: Float[np.ndarray, "links rays"]
    """Azimuth of arrival in the receiver's frame [rad]."""
    aoa_el: Float[np.ndarray, "links rays"]
    """Elevation of arrival [rad]."""
    aod_az: Float[np.ndarray, "links rays"]
    """Azimuth of departure in the transmitter's frame [rad]."""
    aod_el: Float[np.ndarray, "links rays"]
    """Elevation of departure [rad]."""

    def __len__(self) -> int:
        return len(self.gain)

    def __getitem__(self, links: slice) -> "Rays":
        """Return the rays of a slice of the links."""
        return replace(self, **{f.name: getattr(self, f.name)[links] for f in fields(self)})

    @classmethod
    def from_paths(
        cls,
        paths: Paths,
        *,
        n_max: int = 25,
        rx_heading_rad: float | Float[np.ndarray, " rx"] = 0.0,
        tx_heading_rad: float | Float[np.ndarray, " tx"] = 0.0,
    ) -> "Rays":
        """Traced paths between vertically polarised antennas: links by transmitter, then receiver.

        Args:
            paths: What the tracer found, for all pairs of transmitters and receivers.
            n_max: Most paths of a link, the strongest.
            rx_heading_rad: Azimuth in the scene of each receiver's own +x.
            tx_heading_rad: Likewise of each transmitter.
        """
        paths = paths.strongest(n_max)
        n_tx, n_rx = len(paths.tx_position), len(paths.rx_position)
        at = paths.link, paths.rank
        shape = n_tx * n_rx, int(paths.rank.max(initial=0)) + 1
        rx_heading = np.broadcast_to(np.asarray(rx_heading_rad, float), n_rx)
        tx_heading = np.broadcast_to(np.asarray(tx_heading_rad, float), n_tx)

        def padded(values: np.ndarray) -> np.ndarray:
            column = np.zeros(shape, values.dtype)
            column[at] = values
            return column

        return cls(
            gain=padded(np.ascontiguousarray(paths.gain[:, 0, 0])),
            delay_s=padded(paths.delay_s),
            aoa_az=padded(paths.aoa_az - rx_heading[paths.rx]),
            aoa_el=padded(paths.aoa_el),
            aod_az=padded(paths.aod_az - tx_heading[paths.tx]),
            aod_el=padded(paths.aod_el),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Clocks:
    """Random clocks of links, besides noise."""

    offset: Float[np.ndarray, " links"]
    """Delay of the strongest path in the receiver's recording [samples]."""
    path: Complex[np.ndarray, "links rays"]
    """Phase factor of each path."""
    rx: Complex[np.ndarray, "links arrays_rx"]
    """Phase factor of each receive array's oscillator."""
    tx: Complex[np.ndarray, "links arrays_tx"]
    """Phase factor of each transmit array's oscillator."""

    def __getitem__(self, links: slice | Int[np.ndarray, " n"]) -> "Clocks":
        """Select some of the links."""
        return Clocks(**{f.name: getattr(self, f.name)[links] for f in fields(self)})


class Sounder:
    """Two terminals and a waveform: makes measurements of links."""

    def __init__(self, tx: Terminal, rx: Terminal, config: SoundingConfig | None = None) -> None:
        self.tx, self.rx = tx, rx
        self.config = SoundingConfig() if config is None else config

    @cached_property
    def rx_basis(self) -> Complex[np.ndarray, "n_basis ports"]:
        """Orthonormal rows that waves of zero elevation excite at an array of the receiver."""
        ring = np.linspace(-np.pi, np.pi, 720, endpoint=False)
        single = replace(self.rx.platform, face_rad=(0.0,))
        _, size, mode = np.linalg.svd(single.signature(ring)[:, 0], full_matrices=False)
        return mode[size > 1e-6 * size[0]].conj()

    @property
    def n_rx(self) -> int:
        """Receive dimensions of the tensor, over all arrays."""
        return len(self.rx_basis) * len(self.rx.platform.face_rad)

    def rx_response(
        self, azimuth_rad: Numbers, elevation_rad: float | Float[np.ndarray, "*#batch"] = 0.0
    ) -> Complex[np.ndarray, "*batch n_basis"]:
        """Signature of the receiver in the tensor's dimensions, array by array."""
        signature = self.rx.platform.signature(azimuth_rad, elevation_rad) @ self.rx_basis.T
        return signature.reshape(*azimuth_rad.shape, -1)

    def tx_response(
        self, azimuth_rad: Numbers, elevation_rad: float | Float[np.ndarray, "*#batch"] = 0.0
    ) -> Complex[np.ndarray, "*batch beams"]:
        """Field of each transmit beam."""
        return self.tx.beam_response(azimuth_rad, elevation_rad)

    @cached_property
    def budget_db(self) -> float:
        """SNR of a path of unit power gain as estimates give it (`wireless.estimates`): by the link budget."""
        ring = np.linspace(-np.pi, np.pi, 1440, endpoint=False)
        rx = self.rx.platform.directivity(ring).max()
        tx = np.abs(self.tx_response(ring)).max() ** 2
        before_correlation = self.config.snr_per_gain_db - 10 * np.log10(self.config.n_samples)
        return float(before_correlation + 10 * np.log10(rx * tx))

    def snr_db(self, energy: Numbers, aoa_rad: Numbers, aod_rad: Numbers) -> Numbers:
        """SNR of level paths, as estimates give it, from their energy in the measurement; -inf for no energy.

        Args:
            energy: Over that of noise in one entry of the tensor.
            aoa_rad: Azimuths of arrival in the receiver's frame.
            aod_rad: Azimuths of departure in the transmitter's frame.
        """
        rx = np.sum(np.abs(self.rx_response(aoa_rad)) ** 2, axis=-1)
        tx = np.sum(np.abs(self.tx_response(aod_rad)) ** 2, axis=-1)
        return self.snr_of_seen_db(energy, rx * tx)

    def snr_of_seen_db(self, energy: Numbers, seen: Numbers) -> Numbers:
        """SNR [dB], where the squared norm of a path's receive and transmit signatures together is known."""
        with np.errstate(divide="ignore"):
            gain_db = 10 * np.log10(energy / seen) - self.config.snr_per_gain_db
        return gain_db + self.budget_db

    def gain_db(self, paths: PathEstimates) -> Float[np.ndarray, "links paths"]:
        """Power gain of estimated paths between isotropic antennas; -inf where there is none."""
        return paths.snr_db - self.budget_db

    @property
    def knows_departures(self) -> bool:
        """Whether the transmitter has several beams, whose powers depend on the direction of departure."""
        return self.tx.n_beams > 1

    def resolved(self, paths: PathEstimates) -> PathEstimates:
        """Estimates with NaN in place of what this measurement cannot resolve: departures, or delays."""
        nan = np.full_like(paths.aod_rad, np.nan)
        if not self.knows_departures:
            paths = replace(paths, aod_rad=nan)
        return paths if self.config.resolves_delays else replace(paths, delay_s=nan)

    def pulse(self, delay: Numbers) -> Complex[np.ndarray, "*batch"]:
        """Correlation of the waveform with itself, delayed by some samples: 1 at zero, 0 at other integers."""
        n = self.config.n_samples
        turn = np.sin(np.pi * delay / n)
        near = np.abs(turn) < 1e-12
        size = np.where(near, 1.0, np.sin(np.pi * delay) / np.where(near, 1.0, n * turn))
        return size * np.exp(-1j * np.pi * delay / n)

    def check_tensor(self, tensor: Complex[np.ndarray, "links window n_basis beams"]) -> None:
        """Raise ValueError if a correlation tensor is not of the shape that this sounder measures."""
        expected = self.config.window, self.n_rx, self.tx.n_beams
        if tensor.shape[1:] != expected:
            raise ValueError(
                f"tensor has shape {tensor.shape}, expected (links, {', '.join(map(str, expected))}). Estimate with "
                "the sounder that measured it."
            )

    def clocks(self, rays: Rays, rng: np.random.Generator) -> Clocks:
        """Draw what is random about links besides noise."""
        n, n_rx, n_tx = len(rays), len(self.rx.platform.face_rad), len(self.tx.platform.face_rad)
        turn = np.exp(2j * np.pi * rng.random((n, rays.gain.shape[1] + n_rx + n_tx)))
        path, rx, tx = np.split(turn, [rays.gain.shape[1], rays.gain.shape[1] + n_rx], axis=1)
        return Clocks(offset=rng.random(n) * self.config.n_samples, path=path, rx=rx, tx=tx)

    def amplitude(self, rays: Rays, clocks: Clocks) -> Complex[np.ndarray, "links rays"]:
        """Size and phase of each path after correlation, in units of the noise, before antennas."""
        return 10 ** (self.config.snr_per_gain_db / 20) * rays.gain * clocks.path

    def arrival(self, rays: Rays, clocks: Clocks) -> Float[np.ndarray, "links rays"]:
        """Delays in the receiver's recording [samples], relative to the strongest path's random place."""
        first = np.take_along_axis(rays.delay_s, np.abs(rays.gain).argmax(axis=1)[:, None], axis=1)
        return (rays.delay_s - first) / self.config.sample_s + clocks.offset[:, None]

    def measure(
        self,
        rays: Rays,
        rng: np.random.Generator,
        *,
        clocks: Clocks | None = None,
        workers: int | None = None,
    ) -> Complex[np.ndarray, "links window n_basis beams"]:
        """Correlation tensors of links around their strongest delay, with noise of unit variance.

        Args:
            rays: Paths of links.
            rng: Source of noise, phases and offsets.
            clocks: Phases and offsets, if they are not to be drawn.
            workers: Threads; None for one on each available core. The result does not depend on it.
        """
        n, c = len(rays), self.config
        out = np.empty((n, c.window, self.n_rx, self.tx.n_beams), np.complex64)
        starts = range(0, n, BLOCK_LINKS)
        streams = rng.spawn(len(starts))

        def run(start: int, stream: np.random.Generator) -> None:
            links = slice(start, start + BLOCK_LINKS)
            mine = self.clocks(rays[links], stream) if clocks is None else clocks[links]
            self._measure_block(rays[links], mine, stream, out[links])

        in_threads(run, starts, streams, workers=workers)
        return out

    def _measure_block(self, rays: Rays, clocks: Clocks, rng: np.random.Generator, out: np.ndarray) -> None:
        """Draw the tensors of some links into place."""
        n_basis = len(self.rx_basis)
        a = self.rx_response(rays.aoa_az, rays.aoa_el) * np.repeat(clocks.rx, n_basis, axis=1)[:, None]
        b = self.tx_response(rays.aod_az, rays.aod_el) * clocks.tx[:, None, self.tx.beam_array]
        a *= self.amplitude(rays, clocks)[..., None]
        tau = self.arrival(rays, clocks) - np.floor(clocks.offset)[:, None]
        # Strongest an array receives in a beam: the bound on what a path can add anywhere.
        reach = np.linalg.norm(a.reshape(*rays.gain.shape, -1, n_basis), axis=-1).max(axis=-1, initial=0.0)
        reach *= np.abs(b).max(axis=-1)
        n_cells = len(self.rx.platform.face_rad) * self.tx.n_beams
        noise_reach = float(np.sqrt(gammainccinv(n_basis, 1e-15)))
        a, b = a.astype(np.complex64), b.astype(np.complex64)
        candidates = find_candidates(tau, reach, a, b, n_basis, noise_reach, self.config.n_samples)
        # Strongest of so many noise-only cells: 1 - F(t) = 1 - u^(1 / cells), F of Gamma(n_basis).
        with np.errstate(divide="ignore"):
            tail = -np.expm1(np.log(rng.random(len(rays))) / np.maximum(candidates.n_noise * n_cells, 1))
        rival = np.where(candidates.n_noise > 0, gammainccinv(n_basis, tail), 0.0)
        draw_windows(tau, reach, a, b, n_basis, rival, candidates, self.config.n_samples, rng, out)
