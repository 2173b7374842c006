"""The channel of a link over time, as a receiver moves along a trajectory among moving bodies.

Paths are traced at each pose of the trajectory, and in between in steps of at most `step_m`. A sample takes those of
the nearest pose in time, each turned in phase and shifted in delay by its Doppler shift; amplitudes and directions
are those that were traced. Bodies block paths from where they are at the time of the sample. The phase errs by
pi s^2 / (4 lambda d) at most, s the step and d the distance to the nearest end or edge: 0.07 rad for 0.05 m, 28 GHz and
2.5 m, and more where the trajectory has a corner.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from wireless.motion.blockage import find_blockage
from wireless.motion.bodies import Bodies
from wireless.tracing.tracer import Tracer


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpulseResponses:
    """Paths of one link at many times; of each pose the strongest first, as without bodies."""

    time_s: Float[np.ndarray, " t"]
    """Time of each sample."""
    gain: Complex[np.ndarray, "t n 2 2"]
    """See `wireless.paths.Paths.gain`; 0 beyond the last path."""
    delay_s: Float[np.ndarray, "t n"]
    """Time of flight; NaN beyond the last path."""
    doppler_hz: Float[np.ndarray, "t n"]
    """Doppler shift; NaN beyond the last path."""


def sample_channel(
    tracer: Tracer,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "p 3"],
    time_s: Float[np.ndarray, " p"],
    *,
    rate_hz: float,
    step_m: float = 0.05,
    bodies: Callable[[float], Bodies] | None = None,
    model: str = "knife-edges",
) -> ImpulseResponses:
    """Impulse responses of a link along a trajectory.

    Args:
        tracer: Of the building.
        tx: Position of the transmitter [m].
        rx: Positions of the receiver [m], two or more.
        time_s: Their times, increasing.
        rate_hz: Samples per second.
        step_m: Paths are traced again after this distance at most [m].
        bodies: Bodies at a time [s]; None for none.
        model: How bodies block paths, see `wireless.motion.blockage.find_blockage`.

    Raises:
        ValueError: If times do not increase, or rate or step is not positive.
    """
    if len(time_s) < 2 or not (np.diff(time_s) > 0).all():
        raise ValueError(f"time_s has {len(time_s)} times, expected two or more that increase.")
    if not (rate_hz > 0 and step_m > 0):
        raise ValueError(f"rate_hz is {rate_hz:g} and step_m is {step_m:g}, expected more than 0.")
    rx, time_s = _in_steps(rx, time_s, step_m)
    paths = tracer.trace(tx[None], rx)
    shift = paths.doppler_hz(rx_velocity=np.gradient(rx, time_s, axis=0, edge_order=2 if len(rx) > 2 else 1))
    n = int(paths.count().max())
    gain = np.zeros((len(rx), n, 2, 2), complex)
    delay, doppler = np.full((2, len(rx), n), np.nan)
    gain[paths.rx, paths.rank] = paths.gain
    delay[paths.rx, paths.rank], doppler[paths.rx, paths.rank] = paths.delay_s, shift
    sample = time_s[0] + np.arange(int((time_s[-1] - time_s[0]) * rate_hz + 1e-9) + 1) / rate_hz
    pose = np.searchsorted((time_s[1:] + time_s[:-1]) / 2, sample)
    after = (sample - time_s[pose])[:, None]
    factor = np.exp(2j * np.pi * np.nan_to_num(doppler[pose]) * after)
    if bodies is not None:
        links = [paths.between(0, k) for k in range(len(rx))]
        for i, k in enumerate(pose):
            factor[i, : len(links[k])] *= find_blockage(links[k], bodies(sample[i]), model).factor
    return ImpulseResponses(
        time_s=sample,
        gain=gain[pose] * factor[:, :, None, None],
        delay_s=delay[pose] - doppler[pose] * after / paths.frequency_hz,
        doppler_hz=doppler[pose],
    )


def _in_steps(
    rx: Float[np.ndarray, "p 3"], time_s: Float[np.ndarray, " p"], step_m: float
) -> tuple[Float[np.ndarray, "q 3"], Float[np.ndarray, " q"]]:
    """Positions and times with straight lines in between cut into steps of equal time."""
    parts = np.maximum(np.ceil(np.linalg.norm(np.diff(rx, axis=0), axis=1) / step_m), 1).astype(int)
    at = np.concatenate([[0], np.cumsum(parts)])
    index = np.arange(at[-1] + 1)
    times = np.interp(index, at, time_s)
    return np.column_stack([np.interp(index, at, axis) for axis in rx.T]), times
