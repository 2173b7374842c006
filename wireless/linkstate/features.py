"""Features of paths and of pairs of paths for link states: geometry that a mirrored building keeps.

With azimuths of arrival a and departure d, both in the frame of the building:

    line of sight          a = d + 180°: the `back` angle b = a - d - 180° is 0.
    one reflection         a + d = 180° + 2 w for a wall at azimuth w: near 0° modulo 180° where walls are at right
                           angles (the `mirror` angle), and the same for all paths off parallel walls.
    two parallel walls     b = 0 again, but with several paths.
    side lobes             two estimates from one beam, or with one angle in common.

All features are even: mirroring a building with its transmitter and receiver changes nothing. How a direction lies
to the three arrays, 120° apart, says how much gain its SNR has had. Without departures there is nothing else that
depends on how a building is turned, so that a third of a turn changes nothing. Array headings are taken as those of
the public data, 0° and ±120° in the frame of the building.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

from wireless.estimates import wrapped
from wireless.linkstate.tokens import AOA, AOD, COLUMNS, DELAY, N_PATHS, PEAK, SNR

#: SNR is in units of this [dB] and within these limits; peaks in units of 10, delays in 100 ns up to 5.
SNR_UNIT_DB, SNR_LIMITS_DB = 20.0, (-40.0, 80.0)
PEAK_UNIT, DELAY_UNIT_S, DELAY_LIMIT = 10.0, 100e-9, 5.0


def path_and_pair_features(
    tokens: Float32[np.ndarray, "n 5 5"], inputs: Sequence[str]
) -> tuple[Float32[np.ndarray, "n 5 f"], Float32[np.ndarray, "n 5 5 g"], Bool[np.ndarray, "n 5"]]:
    """Features of each path and of each ordered pair of paths, zero where one is missing; and which paths are there.

    Raises:
        ValueError: If a path has no value of an input.
    """
    there = np.isfinite(tokens[..., SNR])
    for name in inputs:
        if lacks := int(np.count_nonzero(np.isnan(tokens[..., COLUMNS.index(name)]) & there)):
            raise ValueError(
                f"{name} is missing in {lacks} of {np.count_nonzero(there)} paths, but this classifier uses "
                f"{', '.join(inputs)}. Use links that have it, or train one without it."
            )
    x = np.nan_to_num(tokens, nan=0.0)
    snr = x[..., SNR].clip(*SNR_LIMITS_DB) / SNR_UNIT_DB
    path = [snr, snr - snr[:, :1], np.exp(snr) / 10, logistic((snr - 0.5) * 7), logistic((snr - 0.2) * 10)]
    path += _facing(x[..., AOA])
    arrival = _differences(x[..., AOA])
    pair = [np.cos(arrival), abs(arrival) / math.pi, _bump(arrival, 4), _bump(arrival, 15), _plain(snr)]
    if "aod" in inputs:
        for features, into in zip(
            _departure_features(x[..., AOA], x[..., AOD], arrival), (path, pair), strict=True
        ):
            into += features
    if "peak" in inputs:
        peak = x[..., PEAK] / PEAK_UNIT
        path += [peak, peak - peak[:, :1]]
    if "delay" in inputs:
        delay = ((x[..., DELAY] - x[:, :1, DELAY]) / DELAY_UNIT_S).clip(-DELAY_LIMIT, DELAY_LIMIT)
        path += [delay, np.exp(-((delay / 0.1) ** 2))]
        pair += [_plain(delay), np.exp(-((_plain(delay) / 0.1) ** 2))]
    both = there[:, :, None] & there[:, None]
    return np.stack(path, -1) * there[..., None], np.stack(pair, -1) * both[..., None], there


def feature_counts(inputs: Sequence[str]) -> tuple[int, int]:
    """Number of features of a path and of a pair."""
    path, pair, _ = path_and_pair_features(np.zeros((1, N_PATHS, len(COLUMNS)), np.float32), inputs)
    return path.shape[-1], pair.shape[-1]


def _departure_features(
    a: Float32[np.ndarray, "n 5"], d: Float32[np.ndarray, "n 5"], arrival: Float32[np.ndarray, "n 5 5"]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the additional features of paths and of pairs by angles of departure."""
    back, mirror = wrapped(a - d - math.pi), wrapped(2 * (a + d)) / 2
    path = [np.cos(back), abs(back) / math.pi, *(_bump(back, width) for width in (4, 10, 30))]
    path += [np.cos(mirror), _bump(mirror, 5), _bump(mirror, 12), _bump(wrapped(2 * mirror) / 2, 6)]
    path += _facing(d)
    departure = _differences(d)
    cross = wrapped(a[:, :, None] - d[:, None] - math.pi)
    backs, mirrors = wrapped(arrival - departure), wrapped(2 * (arrival + departure)) / 2
    same_arrival, same_departure = _bump(arrival, 5), _bump(departure, 6)
    pair = [np.cos(departure), abs(departure) / math.pi, _bump(departure, 5), _bump(departure, 15)]
    pair += [_bump(cross, 6), np.cos(cross), np.cos(backs), _bump(backs, 8), _bump(mirrors, 8)]
    pair += [
        np.tanh(arrival * departure),
        same_arrival * same_departure,
        same_departure * (1 - same_arrival),
    ]
    return path, pair


def logistic(x: Float32[np.ndarray, "*n"]) -> Float32[np.ndarray, "*n"]:
    """From 0 far below zero to 1 far above."""
    return 1 / (1 + np.exp(-x))


def _facing(angle: Float32[np.ndarray, "*n"]) -> list[np.ndarray]:
    """Where a direction lies between the middle of the nearest of three arrays and the seam to the next."""
    return [np.cos(3 * angle), np.cos(6 * angle)]


def _plain(values: Float32[np.ndarray, "n 5"]) -> Float32[np.ndarray, "n 5 5"]:
    """Differences of all ordered pairs."""
    return values[:, :, None] - values[:, None]


def _differences(angle: Float32[np.ndarray, "n 5"]) -> Float32[np.ndarray, "n 5 5"]:
    """Differences of all ordered pairs of angles, in [-pi, pi)."""
    return wrapped(_plain(angle))


def _bump(angle: Float32[np.ndarray, "*n"], width_deg: float) -> Float32[np.ndarray, "*n"]:
    """1 at angle 0, 1/e at the width."""
    return np.exp(-((angle / math.radians(width_deg)) ** 2))
