"""Estimates of a receiver from known paths by rule, without a measurement: its resolution, its reach and its errors.

For learning, where a measurement and its estimation would take most of the time. Paths that the receiver cannot
separate, in angle and delay, are merged; paths outside of the window of delays, or too weak compared with the
strongest, are not found; at most five are. Directions, delays and strengths have Gaussian errors, directions larger
ones if another path is close. The numbers are those of the shipped receiver with `sage`, on 800 links in flat and
office: it finds the same number of paths in 90 % of them; `python -m tests.benchmarks environment` compares the two.

Left out: false paths, and outliers of directions, as one in a hundred measured ones is.
"""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int

from robosim.radio.link_state import Classifier
from robosim.support.compiled import compiled
from wireless.estimates import PathEstimates, measured, wrapped
from wireless.paths import Paths
from wireless.sounding.sounder import Sounder

#: Most paths of a link.
MOST = 5
#: Paths nearer than this in direction [rad] and delay [samples] are one.
MERGED_RAD, MERGED_SAMPLES = np.radians(3.0), 0.3
#: Weaker paths are not found: SNR of the link budget, and relative to the strongest [dB].
LEAST_SNR_DB, LEAST_RELATIVE_DB = -28.0, -50.0
#: Two paths nearer than this are close.
CLOSE_RAD, CLOSE_SAMPLES = np.radians(20.0), 1.3
#: Standard deviations: directions of separate and of close paths, delays, strengths.
SIGMA_RAD, SIGMA_SAMPLES, SIGMA_DB = np.radians([0.05, 1.0]), 0.02, 0.3


def read_paths(
    paths: Paths, heading_rad: float, sounder: Sounder, rng: np.random.Generator | None
) -> PathEstimates:
    """Estimates of one link from its true paths; `heading_rad` is the azimuth of the receiver's +x.

    Without `rng` there are no errors. Arrivals are in the receiver's frame, departures in the scene's.
    """
    power = np.abs(paths.gain[:, 0, 0]) ** 2
    order = np.argsort(-power, kind="stable")
    power, aoa, aod = power[order], paths.aoa_az[order], paths.aod_az[order]
    delay = paths.delay_s[order] / sounder.config.sample_s
    which, sums, close = _separated(power, aoa, delay, sounder.config.half_window)
    snr = 10 * np.log10(np.maximum(sums, 1e-300)) + sounder.budget_db
    is_detected = (snr >= LEAST_SNR_DB) & (snr >= snr.max(initial=-np.inf) + LEAST_RELATIVE_DB)
    # Drawn for all places, so that errors of a path do not depend on others.
    error = np.zeros((4, MOST)) if rng is None else rng.normal(size=(4, MOST))
    which = which[is_detected]
    n = len(which)
    snr = snr[is_detected] + SIGMA_DB * error[0, :n]
    rank = np.argsort(-snr, kind="stable")
    which, snr, sigma, error = (
        which[rank],
        snr[rank],
        SIGMA_RAD[close[is_detected][rank]],
        error[:, :n][:, rank],
    )
    estimates = PathEstimates(
        aoa_rad=_padded(wrapped(aoa[which] - heading_rad + sigma * error[1]), 0.0),
        aod_rad=_padded(wrapped(aod[which] + sigma * error[2]), 0.0),
        snr_db=_padded(snr, -np.inf),
        delay_s=_padded(_after_first(delay[which] + SIGMA_SAMPLES * error[3]) * sounder.config.sample_s, 0.0),
        count=np.array([n]),
    )
    return sounder.resolved(estimates)


@compiled
def _separated(
    power: Float[np.ndarray, " n"],
    aoa: Float[np.ndarray, " n"],
    delay: Float[np.ndarray, " n"],
    window: float,
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Paths that the receiver separates: number, power with all merged ones, whether one is close to others."""
    which, total, close = np.empty(MOST, np.int64), np.zeros(MOST), np.zeros(MOST, np.int64)
    count = 0
    for k in range(len(power)):
        if abs(delay[k] - delay[0]) > window:
            continue
        is_merged = False
        for place in range(count):
            other = which[place]
            turn = abs((aoa[k] - aoa[other] + np.pi) % (2 * np.pi) - np.pi)
            gap = abs(delay[k] - delay[other])
            if turn < MERGED_RAD and gap < MERGED_SAMPLES:
                total[place] += power[k]
                is_merged = True
                break
        if is_merged or count == MOST:
            continue
        for place in range(count):
            other = which[place]
            turn = abs((aoa[k] - aoa[other] + np.pi) % (2 * np.pi) - np.pi)
            if turn < CLOSE_RAD and abs(delay[k] - delay[other]) < CLOSE_SAMPLES:
                close[count] = 1
        which[count], total[count] = k, power[k]
        count += 1
    return which[:count], total[:count], close[:count]


def states_of(
    links: Iterable[Paths], sounder: Sounder, classifier: Classifier
) -> Float[np.ndarray, "links 4"]:
    """Probabilities of link states by a classifier, from the paths of each link, read without errors."""
    nothing = np.zeros((1, MOST))
    outage = PathEstimates(
        aoa_rad=nothing, aod_rad=nothing, snr_db=nothing - np.inf, delay_s=nothing, count=np.zeros(1, int)
    )
    read = [read_paths(paths, 0.0, sounder, None) if len(paths.power) else outage for paths in links]
    aoa, aod, snr, delay = (
        np.concatenate([getattr(estimates, name) for estimates in read])
        for name in ("aoa_rad", "aod_rad", "snr_db", "delay_s")
    )
    return classifier.predict(aoa, snr, **measured(aod_rad=aod, delay_s=delay))


def _after_first(delay: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return delay - delay[0] if len(delay) else delay


def _padded(values: Float[np.ndarray, " n"], fill: float) -> Float[np.ndarray, "1 5"]:
    row = np.full((1, MOST), fill)
    row[0, : len(values)] = values
    return row
