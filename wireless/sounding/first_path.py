"""First path of an impulse response as ranging receivers detect it: the first peak above a threshold.

The response is that of a receiver of a bandwidth between its points of -6 dB, whose spectrum is a raised cosine (Hann):
its pulse sinc(2 W t) / (1 - (2 W t)^2), of W half of that bandwidth, has side lobes of -31 dB, so that a threshold
relative to the strongest peak keeps them from being detected. A second threshold is the least amplitude that exceeds
noise. A weak direct path is missed, and two paths within a pulse are one peak: both make ranges long. Peaks are
interpolated between samples by a parabola of their level in decibels.

Left out: noise itself, errors of clocks, antennas that delay directions differently.
"""

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light

from wireless.channel import Channel

#: Samples per pulse, and pulses before the first and after the last path.
_SAMPLES, _MARGIN = 16, 2
#: Peaks so far below the strongest may be side lobes [dB].
SIDE_LOBES_DB = 28.0
#: Peaks of noise are rarely so far above its mean [dB].
NOISE_MARGIN_DB = 10.0
#: Error of ranges by paths within a pulse, over its width c / W, and the most in rooms [m]: of lines of sight at 2.4 to
#: 60 GHz, traced in eight scanned homes and two generated offices.
_MERGED, _MOST_MERGED_M = 0.13, 1.0


def detect_first_path(
    channel: Channel, bandwidth_hz: float, least_gain_db: float
) -> tuple[Float[np.ndarray, "n_tx n_rx"], Float[np.ndarray, "n_tx n_rx"]]:
    """Delay and gain of the first detected peak of each link, between the first ports.

    Args:
        channel: Paths between antennas.
        bandwidth_hz: Bandwidth between the points of -6 dB.
        least_gain_db: Least gain of a peak that exceeds noise [dB].

    Returns:
        Delays [s] and gains [dB]; NaN where no peak is detected.

    Raises:
        ValueError: If the bandwidth is not positive.
    """
    if not bandwidth_hz > 0:
        raise ValueError(f"bandwidth_hz is {bandwidth_hz:g}, expected more than 0.")
    coefficients, delays_s = channel.cir()
    shape = delays_s.shape[:2]
    delay, gain = np.full((2, *shape), np.nan)
    for link in np.ndindex(shape):
        is_path = np.isfinite(delays_s[link])
        if not is_path.any():
            continue
        arrival, strength = delays_s[link][is_path], coefficients[link][0, 0][is_path]
        margin_s = _MARGIN / bandwidth_hz
        times = np.arange(arrival.min() - margin_s, arrival.max() + margin_s, 1 / (_SAMPLES * bandwidth_hz))
        level = 20 * np.log10(
            np.maximum(np.abs(hann_pulse(bandwidth_hz * (times[:, None] - arrival)) @ strength), 1e-30)
        )
        is_peak = np.r_[False, (level[1:-1] >= level[:-2]) & (level[1:-1] > level[2:]), False]
        is_peak &= level >= max(least_gain_db, level.max() - SIDE_LOBES_DB)
        if is_peak.any():
            k = int(is_peak.argmax())
            before, after = level[k - 1] - level[k], level[k + 1] - level[k]
            beyond = 0.5 * (before - after) / (before + after)
            delay[link] = times[k] + beyond * (times[1] - times[0])
            gain[link] = level[k] - 0.25 * (before - after) * beyond
    return delay, gain


def range_merged_m(bandwidth_hz: float) -> float:
    """Standard deviation of ranges [m] that other paths within the pulse of the first one cause indoors."""
    return min(_MERGED * speed_of_light / bandwidth_hz, _MOST_MERGED_M)


def hann_pulse(u: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
    """Pulse of a Hann spectrum at times over the inverse of the bandwidth; 1/2 where both factors vanish."""
    below = 1 - u * u
    return np.where(np.abs(below) < 1e-9, 0.5, np.sinc(u) / np.where(np.abs(below) < 1e-9, 1.0, below))
