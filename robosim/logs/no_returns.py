"""Ranges that mean that a beam hit nothing.

Drivers say so in many forms: infinite, beyond the sensor's longest range, exactly at it, a little below, or at a limit
of their own. Where many beams have a range a little below, or the longest of all ranges, in several directions, and
few have one near it, that range means nothing. Of a wall, twice as many beams end within a hundredth around its
distance as within a thousandth.
"""

import logging
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

logger = logging.getLogger(__name__)

#: Ranges that are the same, those around them that are compared, and where they are; relative to the longest range.
_SAME, _AROUND, _NEAR_LIMIT = 1e-3, 1e-2, 0.95
#: A limit is shared by this part of the beams, in so many directions, and by so many times those around.
_LEAST_SHARE, _LEAST_DIRECTIONS, _MORE = 0.005, 3, 2.0
#: The longest range of all, far from the sensor's, is one in this part of the directions; a wall is flat in 5 degrees.
_DIRECTIONS_OF_LONGEST = 0.1


def find_no_returns(
    scans: Sequence[Float[np.ndarray, " _"]], limits_m: Sequence[float]
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"], float]:
    """Beams that hit nothing, of one scan after the other.

    Args:
        scans: Ranges of each scan [m], in the order of their directions; infinite where a beam hit nothing.
        limits_m: Longest range that the sensor of each measures [m]; infinite if unknown.

    Returns:
        Whether each of the n beams is at the limit of its sensor or beyond, whether it is at the range below that means
        nothing, and that range [m]; NaN if there is none.
    """
    ranges = np.concatenate(scans)
    limits = np.repeat(limits_m, [len(scan) for scan in scans])
    column = np.concatenate([np.arange(len(scan)) for scan in scans])
    with np.errstate(invalid="ignore"):
        at_limit = ranges >= limits * (1 - 1e-6)
        rest = np.where(at_limit, np.nan, ranges)
        limit_m = float(np.median(limits)) if len(limits) else math.inf
        near = rest[rest >= _NEAR_LIMIT * limit_m] if math.isfinite(limit_m) else rest[:0]
    longest_m = float(rest[np.isfinite(rest)].max(initial=0.0))
    width = max((len(scan) for scan in scans), default=0)
    candidates = []
    if (rest < (1 - _AROUND) * longest_m).any():
        candidates = [(longest_m, max(_LEAST_DIRECTIONS, _DIRECTIONS_OF_LONGEST * width))]
    if len(near):
        level, counts = np.unique(np.floor(near / (_SAME * limit_m)), return_counts=True)
        usual = near[np.floor(near / (_SAME * limit_m)) == level[counts.argmax()]]
        candidates.insert(0, (float(np.median(usual)), _LEAST_DIRECTIONS))
    for value_m, least_directions in candidates:
        off_m = np.abs(rest - value_m)
        same = off_m <= _SAME * value_m
        around = np.count_nonzero(off_m <= _AROUND * value_m) - same.sum()
        is_shared = same.sum() >= max(_LEAST_SHARE * len(ranges), _MORE * around)
        if is_shared and len(set(column[same])) >= least_directions:
            return at_limit, same, value_m
    return at_limit, np.zeros_like(at_limit), math.nan


def without_longest(path: Path, ranges: Float[np.ndarray, "n w"]) -> Float[np.ndarray, "n w"]:
    """Ranges [m] of a sensor of unknown limit; the longest is infinite, with a warning, if it means nothing."""
    _, at_longest, longest_m = find_no_returns(list(ranges), [math.inf] * len(ranges))
    if at_longest.any():
        share = 100 * at_longest.mean()
        logger.warning(f"{path}: {share:.0f} % of the beams end at {longest_m:.4g} m: they hit nothing.")
    return np.where(at_longest.reshape(ranges.shape), np.inf, ranges)
