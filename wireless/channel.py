"""The channel between the ports of two arrays: impulse and frequency responses, taps, powers and spreads.

The coefficient of a path between two ports is h_p = F_rx^T G_p F_tx, with G_p its gain (`wireless.paths.Paths.gain`,
which holds the phase of the carrier e^(-j 2 pi f_c tau_p)) and F the fields of the ports along theta and phi
(`wireless.antennas.mounting`). With the Doppler shift nu_p of each path:

    impulse response     sum_p h_p e^(j 2 pi nu_p t) delta(tau - tau_p(t)),   tau_p(t) = tau_p - nu_p t / f_c
    frequency response   H(f) = sum_p h_p e^(j 2 pi nu_p t) e^(-j 2 pi f tau_p(t)),   f counted from the carrier
    tap l at bandwidth W     sum_p h_p e^(j 2 pi nu_p t) sinc(l - W tau_p(t)),   sinc(x) = sin(pi x) / (pi x)

Taps are the samples at rate W of a channel between ideal low-pass filters of W, as Sionna RT defines them
(its `taps` of paths, `cir_to_time_channel`); without Doppler shifts, the frequency response is that of its
`cir_to_ofdm_channel`.
Spreads are those of TR 38.901, annex A: paths weighted by their powers, summed over all pairs of ports.
Left out: arrays so large that waves at them are not plane, or that the bandwidth changes their phases.
References: Aoudia et al., Sionna RT, arXiv:2504.21719 (2025); 3GPP TR 38.901 V17, annex A, equations (A-1) and (A-2).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pyarrow as pa
from jaxtyping import Complex, Float, Shaped
from numpy.typing import ArrayLike

from wireless.antennas.mounting import MountedArray
from wireless.paths import Paths
from wireless.support.arrays import to_array

#: Thermal noise at 290 K.
NOISE_DBM_PER_HZ = -174.0
#: Taps before the first and after the last delay: the square sum of a sinc beyond is 3 % of the whole.
_MARGIN = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """Paths between the ports of arrays, at one time."""

    paths: Paths
    """Delays and directions of the paths, and their links."""
    coefficient: Complex[np.ndarray, "n rx_ports tx_ports"]
    """Complex gain of each path between each receive and transmit port, at the carrier."""
    doppler_hz: Float[np.ndarray, " n"]
    """Doppler shift of each path."""

    @classmethod
    def from_paths(
        cls,
        paths: Paths,
        *,
        tx: MountedArray | None = None,
        rx: MountedArray | None = None,
        doppler_hz: ArrayLike | None = None,
    ) -> "Channel":
        """The channel of traced paths at the time they were traced, 0.

        Args:
            paths: What the tracer found.
            tx: Arrays of the transmitters; None for isotropic, vertically polarised antennas.
            rx: Arrays of the receivers; likewise.
            doppler_hz: Doppler shifts, such as of `Paths.doppler_hz`; None for none.

        Raises:
            ValueError: If arrays are turned by angles of another number of terminals.
        """
        tx, rx = (MountedArray() if array is None else array for array in (tx, rx))
        sent = tx.response(paths.aod_az, paths.aod_el, paths.tx, len(paths.tx_position))
        received = rx.response(paths.aoa_az, paths.aoa_el, paths.rx, len(paths.rx_position))
        return cls(
            paths=paths,
            coefficient=np.einsum("nrp,npq,ntq->nrt", received, paths.gain, sent),
            doppler_hz=np.broadcast_to(
                to_array(0.0 if doppler_hz is None else doppler_hz, "doppler_hz"), len(paths)
            ),
        )

    def at(self, time_s: float) -> "Channel":
        """The channel so much later: phases and delays move on by the Doppler shifts."""
        turn = np.exp(2j * np.pi * self.doppler_hz * time_s)
        delay_s = self.paths.delay_s - self.doppler_hz * time_s / self.paths.frequency_hz
        return replace(
            self,
            paths=replace(self.paths, delay_s=delay_s),
            coefficient=self.coefficient * turn[:, None, None],
        )

    def synchronised(self) -> "Channel":
        """The channel as a receiver sees it whose clock starts with the first path of each link."""
        delay_s = self.paths.delay_s - self.first_delay_s()[self.paths.tx, self.paths.rx]
        return replace(self, paths=replace(self.paths, delay_s=delay_s))

    def cir(
        self,
    ) -> tuple[Complex[np.ndarray, "n_tx n_rx rx_ports tx_ports m"], Float[np.ndarray, "n_tx n_rx m"]]:
        """Impulse response: coefficients (0 beyond the last path) and delays [s] (NaN) of the paths of each link."""
        at = self.paths.tx, self.paths.rx, self.paths.rank
        n_paths = int(self.paths.rank.max(initial=-1)) + 1
        coefficient = np.zeros((*self._shape, n_paths, *self.coefficient.shape[1:]), complex)
        delay_s = np.full((*self._shape, n_paths), np.nan)
        coefficient[at], delay_s[at] = self.coefficient, self.paths.delay_s
        return np.ascontiguousarray(np.moveaxis(coefficient, 2, -1)), delay_s

    def cfr(self, offset_hz: ArrayLike) -> Complex[np.ndarray, "n_tx n_rx rx_ports tx_ports f"]:
        """Frequency response, at frequencies counted from the carrier: `subcarriers` gives those of OFDM.

        `cfr(f)[i, j, :, :, k]` is the MIMO matrix of link i, j at the k-th frequency; a single number counts as one.
        """
        offsets_hz = np.atleast_1d(to_array(offset_hz, "offset_hz"))
        return self._filtered(lambda delay_s: np.exp(-2j * np.pi * offsets_hz * delay_s), len(offsets_hz))

    def taps(
        self, bandwidth_hz: float, first: int | None = None, last: int | None = None
    ) -> Complex[np.ndarray, "n_tx n_rx rx_ports tx_ports taps"]:
        """Taps from `first` to `last`, sampled at the rate of the bandwidth.

        Args:
            bandwidth_hz: Bandwidth at the carrier, and rate of complex samples.
            first: Number of the first tap, may be negative; None for 6 before the first delay.
            last: Number of the last tap; None for 6 after the last delay.

        Raises:
            ValueError: If the bandwidth is not positive and finite, or there is no tap.
        """
        if not 0 < bandwidth_hz < np.inf:
            raise ValueError(f"bandwidth_hz is {bandwidth_hz:g}, expected more than 0, and finite.")
        delay = bandwidth_hz * (self.paths.delay_s if len(self.paths) else np.zeros(1))
        first = int(np.floor(delay.min())) - _MARGIN if first is None else first
        last = int(np.ceil(delay.max())) + _MARGIN if last is None else last
        if last < first:
            raise ValueError(f"last is {last} and first is {first}, expected at least one tap.")
        number = np.arange(first, last + 1)
        return self._filtered(lambda delay_s: np.sinc(number - bandwidth_hz * delay_s), len(number))

    def power(self, *, coherent: bool) -> Float[np.ndarray, "n_tx n_rx rx_ports tx_ports"]:
        """Power gain of each pair of ports.

        Args:
            coherent: Whether paths add with their phases, as at the carrier at this place; else their powers add, which
                is the mean over a neighbourhood and over a wide band.
        """
        if coherent:
            return np.abs(self._sum(self.coefficient)) ** 2
        return self._sum(np.abs(self.coefficient) ** 2)

    def first_delay_s(self) -> Float[np.ndarray, "n_tx n_rx"]:
        """Delay of the first path of each link; NaN without paths."""
        first = np.full(self._shape, np.inf)
        np.minimum.at(first, (self.paths.tx, self.paths.rx), self.paths.delay_s)
        return np.where(np.isfinite(first), first, np.nan)

    def delay_spread_s(self) -> Float[np.ndarray, "n_tx n_rx"]:
        """Root mean square delay spread of each link; NaN without paths."""
        mean = self._mean(self.paths.delay_s)
        return np.sqrt(self._mean((self.paths.delay_s - mean[self.paths.tx, self.paths.rx]) ** 2))

    def angular_spread_rad(
        self, angle: Literal["aoa_az", "aoa_el", "aod_az", "aod_el"]
    ) -> Float[np.ndarray, "n_tx n_rx"]:
        """Circular standard deviation of an angle over the paths of each link; NaN without paths."""
        mean = np.abs(self._mean(np.exp(1j * getattr(self.paths, angle))))
        with np.errstate(divide="ignore"):
            return np.sqrt(-2 * np.log(np.minimum(mean, 1)))

    def to_table(self) -> pa.Table:
        """One row per link, as an Arrow table (`to_table().to_pandas()`): power gains of all ports, and spreads."""
        tx, rx = np.indices(self._shape).reshape(2, -1)
        with np.errstate(divide="ignore"):
            gains = {
                f"gain_{name}_db": 10 * np.log10(self.power(coherent=name == "coherent").sum(axis=(2, 3)))
                for name in ("coherent", "incoherent")
            }
        spreads = {
            f"{angle}_spread_rad": self.angular_spread_rad(angle)
            for angle in ("aoa_az", "aoa_el", "aod_az", "aod_el")
        }
        columns = {**gains, "delay_spread_s": self.delay_spread_s(), **spreads}
        return pa.table({"tx": tx, "rx": rx, **{name: value.ravel() for name, value in columns.items()}})

    def _filtered(
        self, factor: Callable[[Float[np.ndarray, "p 1"]], np.ndarray], count: int
    ) -> Complex[np.ndarray, "n_tx n_rx rx_ports tx_ports k"]:
        """Sum over the paths of each link of coefficients times `count` factors of the delay."""
        out = np.zeros((*self._shape, *self.coefficient.shape[1:], count), complex)
        flat = out.reshape(-1, *out.shape[2:])
        order = np.argsort(self.paths.link, kind="stable")
        present, first = np.unique(self.paths.link[order], return_index=True)
        # One link at a time: all together need much memory.
        for number, rows in zip(present, np.split(order, first[1:]), strict=False):
            factors = factor(self.paths.delay_s[rows, None])
            # Not a product of matrices: libraries split its sum over threads, and last bits depend on the cores.
            flat[number] = np.einsum("prt,pk->rtk", self.coefficient[rows], factors)
        return out

    def _sum(self, values: Shaped[np.ndarray, " n ..."]) -> Shaped[np.ndarray, "n_tx n_rx ..."]:
        """Sum over the paths of each link."""
        total = np.zeros((*self._shape, *values.shape[1:]), values.dtype)
        np.add.at(total, (self.paths.tx, self.paths.rx), values)
        return total

    def _mean(self, values: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, "n_tx n_rx"]:
        """Mean over the paths of each link, weighted by power; NaN without paths."""
        weight = (np.abs(self.coefficient) ** 2).sum(axis=(1, 2))
        with np.errstate(invalid="ignore"):
            return self._sum(weight * values) / self._sum(weight)

    @property
    def _shape(self) -> tuple[int, int]:
        return len(self.paths.tx_position), len(self.paths.rx_position)


def noise_power_dbm(bandwidth_mhz: float, loss_db: float) -> float:
    """Noise of a receiver in its bandwidth [MHz], with its noise figure and other losses [dBm]."""
    return NOISE_DBM_PER_HZ + 10 * float(np.log10(bandwidth_mhz * 1e6)) + loss_db


def subcarriers(count: int, spacing_hz: float) -> Float[np.ndarray, " count"]:
    """Frequencies of the subcarriers of OFDM, counted from the carrier, which is the one with number count // 2.

    Raises:
        ValueError: If there is no subcarrier, or the spacing is not positive.
    """
    if count < 1 or not 0 < spacing_hz < np.inf:
        raise ValueError(
            f"count is {count} and spacing_hz is {spacing_hz:g}, expected at least 1 subcarrier and more than 0 Hz."
        )
    return (np.arange(count) - count // 2) * spacing_hz
