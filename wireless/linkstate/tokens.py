"""Estimated paths of links as one array for networks: missing paths marked, in an order of their own.

A link has up to `N_PATHS` estimates; a row of the array is one of them, its columns are `COLUMNS`. Missing paths
hold NaN throughout and come last; columns that were not measured hold NaN. Paths are sorted by SNR, and equal
ones by their other columns, so that the order they were given in changes nothing. In the public data a missing
path holds zeros; a path with all of angles and SNR zero is taken as missing.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32

#: Most paths of a link.
N_PATHS = 5
#: Angles [rad], SNR [dB], height of the peak over its surroundings (`peakFracResult`), delay [s].
COLUMNS = ("aoa", "aod", "snr", "peak", "delay")
AOA, AOD, SNR, PEAK, DELAY = range(5)
#: Largest magnitude of each: angles may be sums of several, but more are degrees, and longer delays nanoseconds.
_LARGEST = (4 * np.pi, 4 * np.pi, 1e6, 1e6, 1.0)


def make_tokens(
    aoa_rad: Float[np.ndarray, "n paths"],
    snr_db: Float[np.ndarray, "*snr"],
    *,
    aod_rad: Float[np.ndarray, "*aod"] | None = None,
    peak: Float[np.ndarray, "*peak"] | None = None,
    delay_s: Float[np.ndarray, "*delay"] | None = None,
) -> Float32[np.ndarray, "n 5 5"]:
    """Array of estimated paths; of more than five, the strongest count.

    Args:
        aoa_rad: Azimuths of arrival.
        snr_db: Signal-to-noise ratios; a path with NaN or -inf is missing.
        aod_rad: Azimuths of departure, if the transmitter's beams are known.
        peak: Heights of the peaks, if measured.
        delay_s: Delays, if measured; only differences count.

    Raises:
        ValueError: If the arrays differ in shape, or a path that is not missing has a value that is NaN, or too large
            for its unit.
    """
    measurements = {
        "aoa_rad": aoa_rad,
        "aod_rad": aod_rad,
        "snr_db": snr_db,
        "peak": peak,
        "delay_s": delay_s,
    }
    tokens = np.full((*aoa_rad.shape, len(COLUMNS)), np.nan)
    for column, (name, values) in enumerate(measurements.items()):
        if values is None:
            continue
        if values.shape != aoa_rad.shape:
            raise ValueError(
                f"{name} has shape {values.shape}, expected {aoa_rad.shape} as aoa_rad: a row a link, a column a path."
            )
        tokens[..., column] = values
    measured = [AOA, SNR] if aod_rad is None else [AOA, AOD, SNR]
    missing = ~np.isfinite(tokens[..., SNR]) | (tokens[..., measured] == 0).all(-1)
    tokens[missing] = np.nan
    columns = [column for column, values in enumerate(measurements.values()) if values is not None]
    bad = ~(np.abs(tokens) <= _LARGEST)[..., columns] & ~missing[..., None]
    if bad.any():
        link, path, column = np.argwhere(bad)[0]
        number = columns[column]
        raise ValueError(
            f"{list(measurements)[number]} of path {path} of link {link} is {tokens[link, path, number]:g}, expected a "
            f"magnitude up to {_LARGEST[number]:.3g}; set the SNR to -inf if the path is missing."
        )
    return _sorted(tokens)[:, :N_PATHS].astype(np.float32)


def is_path(tokens: Float32[np.ndarray, "n paths 5"]) -> Bool[np.ndarray, "n paths"]:
    """Which paths are there."""
    return np.isfinite(tokens[..., SNR])


def reached(tokens: Float32[np.ndarray, "n paths 5"]) -> Bool[np.ndarray, " n"]:
    """Which links have a path."""
    return np.asarray(is_path(tokens).any(axis=1))


def _sorted(tokens: Float[np.ndarray, "n paths 5"]) -> Float[np.ndarray, "n places 5"]:
    """Paths from the strongest, missing ones last, and at least `N_PATHS` places."""
    keys = np.where(np.isnan(tokens), np.inf, tokens)
    order = np.lexsort(
        (
            keys[..., DELAY],
            keys[..., PEAK],
            keys[..., AOD],
            keys[..., AOA],
            -np.nan_to_num(tokens[..., SNR], nan=-np.inf),
        )
    )
    n, paths, columns = tokens.shape
    places = np.full((n, max(N_PATHS, paths), columns), np.nan)
    places[:, :paths] = tokens[np.arange(n)[:, None], order]
    return places
