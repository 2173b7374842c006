"""How sharp a lone path's azimuths can be: the Cramér-Rao bound of a measurement.

A path adds s D(l - tau) a_i(theta) b_j(phi) exp(j psi_ij) for receive array i and transmit array j, in white
noise of unit variance. Unknown are both azimuths, delay tau, size s and all phases psi_ij, since oscillators of
arrays are not locked. Once phases are projected out, size is all that couples azimuths and delay, and projecting
that out too leaves them uncoupled. With E the energy of the path, a the response of one end and a' its slope,

    var(theta) >= 1 / 2 E [ sum_i(|a_i'|^2 - Im(a_i^H a_i')^2 / |a_i|^2) / |a|^2 - Re(a^H a')^2 / |a|^4 ].

The first term is what phases within arrays and sizes across them give, the second what size takes back.
Left out: elevation (known to be level), other paths.
Reference: S. M. Kay, Fundamentals of Statistical Signal Processing, vol. 1 (1993), chapters 3 and 15.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float, Int

from wireless.sounding.sounder import Sounder

#: Half the step of slopes [rad]: their error is some (30 x step)^2 / 6 of them, 30 rad/rad of phase at an end.
STEP_RAD = 1e-5


def arrival_bound_rad(
    sounder: Sounder, azimuth_rad: Float[np.ndarray, " n"], snr_db: float | Float[np.ndarray, "#n"]
) -> Float[np.ndarray, " n"]:
    """Least standard deviation of an unbiased azimuth of arrival of a lone path.

    Args:
        sounder: What measures.
        azimuth_rad: Azimuths of arrival in the receiver's frame.
        snr_db: Energy of the path in the measurement's window over that of noise in one of its entries.

    Returns:
        Standard deviations; inf where azimuth cannot be estimated at all.
    """
    owner = np.repeat(np.arange(len(sounder.rx.platform.face_rad)), len(sounder.rx_basis))
    return _bound_rad(sounder.rx_response, owner, azimuth_rad, snr_db)


def departure_bound_rad(
    sounder: Sounder, azimuth_rad: Float[np.ndarray, " n"], snr_db: float | Float[np.ndarray, "#n"]
) -> Float[np.ndarray, " n"]:
    """The same for the azimuth of departure, in the transmitter's frame."""
    return _bound_rad(sounder.tx_response, sounder.tx.beam_array, azimuth_rad, snr_db)


def window_share(sounder: Sounder) -> float:
    """Share of a path's energy that falls in the window, on average over where between samples it arrives."""
    half = sounder.config.half_window
    late = (np.arange(100) + 0.5) / 100 - 0.5
    pulse = sounder.pulse(np.arange(-half, half + 1) - late[:, None])
    return float(np.mean(np.sum(np.abs(pulse) ** 2, axis=1)))


def _bound_rad(
    response: Callable[[np.ndarray], np.ndarray],
    owner: Int[np.ndarray, " dims"],
    azimuth_rad: Float[np.ndarray, " n"],
    snr_db: float | Float[np.ndarray, "#n"],
) -> Float[np.ndarray, " n"]:
    """The bound for one end, whose dimensions belong to arrays."""
    a: Complex[np.ndarray, "n dims"] = response(azimuth_rad)
    slope = (response(azimuth_rad + STEP_RAD) - response(azimuth_rad - STEP_RAD)) / (2 * STEP_RAD)
    mine = (owner[:, None] == np.arange(owner.max() + 1)).astype(float)
    size, along = np.abs(a) ** 2 @ mine, (a.conj() * slope) @ mine
    turning = along.imag**2 / np.maximum(size, 1e-30)
    total = np.maximum(size.sum(axis=-1), 1e-30)
    reported = (np.sum(np.abs(slope) ** 2, axis=-1) - turning.sum(axis=-1)) / total
    reported -= (along.real.sum(axis=-1) / total) ** 2
    with np.errstate(divide="ignore"):
        return 1 / np.sqrt(2 * 10 ** (np.asarray(snr_db) / 10) * np.maximum(reported, 0.0))
