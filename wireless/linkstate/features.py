"""What a path, and a pair of paths, say about the link state: geometry that a mirrored building keeps.

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

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from wireless.linkstate.tokens import AOA, AOD, COLUMNS, DELAY, PEAK, SNR

#: SNR is in units of this [dB] and within these limits; peaks in units of 10, delays in 100 ns up to 5.
SNR_UNIT_DB, SNR_LIMITS_DB = 20.0, (-40.0, 80.0)
PEAK_UNIT, DELAY_UNIT_S, DELAY_LIMIT = 10.0, 100e-9, 5.0


def path_and_pair_features(
    tokens: Float[Tensor, "n 5 5"], inputs: Sequence[str]
) -> tuple[Float[Tensor, "n 5 f"], Float[Tensor, "n 5 5 g"], Bool[Tensor, "n 5"]]:
    """Features of each path and of each ordered pair of paths; zero where one is missing.

    Args:
        tokens: Paths from `wireless.linkstate.tokens.make_tokens`.
        inputs: Columns to use, of `wireless.linkstate.tokens.COLUMNS`; "aoa" and "snr" always.

    Returns:
        Features of paths, features of pairs, and which paths are there.
    """
    there = torch.isfinite(tokens[..., SNR])
    x = torch.nan_to_num(tokens, nan=0.0)
    snr = x[..., SNR].clamp(*SNR_LIMITS_DB) / SNR_UNIT_DB
    path = [
        snr,
        snr - snr[:, :1],
        snr.exp() / 10,
        torch.sigmoid((snr - 0.5) * 7),
        torch.sigmoid((snr - 0.2) * 10),
    ]
    path += _facing(x[..., AOA])
    arrival = _differences(x[..., AOA])
    pair = [arrival.cos(), arrival.abs() / math.pi, _bump(arrival, 4), _bump(arrival, 15), _plain(snr)]
    if "aod" in inputs:
        for found, into in zip(
            _departure_features(x[..., AOA], x[..., AOD], arrival), (path, pair), strict=True
        ):
            into += found
    if "peak" in inputs:
        peak = x[..., PEAK] / PEAK_UNIT
        path += [peak, peak - peak[:, :1]]
    if "delay" in inputs:
        delay = ((x[..., DELAY] - x[:, :1, DELAY]) / DELAY_UNIT_S).clamp(-DELAY_LIMIT, DELAY_LIMIT)
        path += [delay, torch.exp(-((delay / 0.1) ** 2))]
        pair += [_plain(delay), torch.exp(-((_plain(delay) / 0.1) ** 2))]
    both = there[:, :, None] & there[:, None]
    return torch.stack(path, -1) * there[..., None], torch.stack(pair, -1) * both[..., None], there


def feature_counts(inputs: Sequence[str]) -> tuple[int, int]:
    """Number of features of a path and of a pair."""
    path, pair, _ = path_and_pair_features(torch.zeros(1, 5, len(COLUMNS)), inputs)
    return path.shape[-1], pair.shape[-1]


def wrapped(angle: Tensor) -> Tensor:
    """The same angles in [-pi, pi)."""
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi


def _departure_features(a: Tensor, d: Tensor, arrival: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """What departures add to the features of paths and of pairs."""
    back, mirror = wrapped(a - d - math.pi), wrapped(2 * (a + d)) / 2
    path = [back.cos(), back.abs() / math.pi, *(_bump(back, width) for width in (4, 10, 30))]
    path += [mirror.cos(), _bump(mirror, 5), _bump(mirror, 12), _bump(wrapped(2 * mirror) / 2, 6)]
    path += _facing(d)
    departure = _differences(d)
    cross = wrapped(a[:, :, None] - d[:, None] - math.pi)
    backs, mirrors = wrapped(arrival - departure), wrapped(2 * (arrival + departure)) / 2
    same_arrival, same_departure = _bump(arrival, 5), _bump(departure, 6)
    pair = [departure.cos(), departure.abs() / math.pi, _bump(departure, 5), _bump(departure, 15)]
    pair += [_bump(cross, 6), cross.cos(), backs.cos(), _bump(backs, 8), _bump(mirrors, 8)]
    pair += [
        torch.tanh(arrival * departure),
        same_arrival * same_departure,
        same_departure * (1 - same_arrival),
    ]
    return path, pair


def _facing(angle: Tensor) -> list[Tensor]:
    """Where a direction lies between the middle of the nearest of three arrays and the seam to the next."""
    return [(3 * angle).cos(), (6 * angle).cos()]


def _plain(values: Tensor) -> Tensor:
    """Differences of all ordered pairs."""
    return values[:, :, None] - values[:, None]


def _differences(angle: Tensor) -> Tensor:
    """Differences of all ordered pairs of angles, in [-pi, pi)."""
    return wrapped(_plain(angle))


def _bump(angle: Tensor, width_deg: float) -> Tensor:
    """1 at angle 0, 1/e at the width."""
    return torch.exp(-((angle / math.radians(width_deg)) ** 2))
