"""Measured antenna patterns as elements: MSI Planet files (.msi, .pln) of two cuts, and CSV files of a grid.

MSI: `GAIN` in dBd, or with its unit dBi or dBd; `HORIZONTAL n` and `VERTICAL n`, each followed by n lines of angle
[degrees] and attenuation [dB]. Horizontal angles count clockwise from ahead as seen from above, vertical ones from the
horizon ahead downwards. Other lines, such as the electrical tilt, which the cuts contain, are ignored. Cuts are summed
in decibels, and the pattern equals each cut on it: at azimuth a in [-180, 180] and elevation e, the attenuation is

    H(a) + (1 - |a| / 180) (V(e) - H(0)) + |a| / 180 (V(180 - e) - H(180)).

Where V(0) differs from H(0) by more than half a decibel, each cut lies in the other's maximum, such as those of twin
beams or of tilted ones: the least attenuation of V replaces H(0), and V(180) replaces H(180).

CSV: columns azimuth_deg (counter-clockwise from ahead), elevation_deg (up), gain_dbi, a row for each pair of angles.

Gains are interpolated in decibels, linearly in azimuth around the circle and in elevation. Cuts of which no attenuation
is positive are relative gains. A pattern whose mean gain is more than 1, by more than 0.5 dB, is an error.
Left out: phases and cross-polarisation. Directions off both cuts are an approximation, good in the main lobe.
Reference: F. Gil et al., A 3D interpolation method for base-station-antenna radiation patterns, IEEE Antennas and
Propagation Magazine 43(2), 2001 (sums of cuts, and their errors).
"""

import logging
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
import pyarrow as pa
from jaxtyping import Float

from robosim.support.reading import reading
from wireless.antennas.sphere import mean_over_sphere
from wireless.support.columns import check_within, numbers

if TYPE_CHECKING:
    from scipy.interpolate import RegularGridInterpolator

logger = logging.getLogger(__name__)

SUFFIXES = (".csv", ".msi", ".pln")
#: Gain of a half-wave dipole, which dBd refer to [dBi].
_DIPOLE_DBI = 2.15
#: Gains [dBi] and attenuations [dB] are within these.
_GAIN_DB, _ATTENUATION_DB = (-300.0, 100.0), (-100.0, 300.0)
#: Angles of a cut or a grid are at most this far apart [degrees], and at most so many.
_GAP_DEG, _MOST = 45.0, 3600
#: Gaps of more than 5 degrees are at most so many times the usual one; an angle that is there twice has values
#: that are equal up to this [dB].
_GAP_STEPS, _SAME_DB = 5.0, 0.01
#: Cuts agree ahead up to this [dB]; a pattern radiates at most so much more than it is given [dB].
_AGREE_DB, _EXCESS_DB = 0.5, 0.5
#: Larger losses are reported [dB], and smaller ones of a pattern whose gain is 0 dBi at most.
_LOSS_DB, _LOSS_OF_RELATIVE_DB = 12.0, 3.0
#: A vertical cut is strongest at most so far from the horizon, or a warning is given [degrees].
_STEEP_DEG = 60.0
#: Fineness of the mean over the sphere.
_ORDER = 200
_MOST_BYTES = 100_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class PatternElement:
    """A radiator of measured gain, vertically polarised."""

    azimuth_deg: Float[np.ndarray, " a"]
    """Azimuths, rising, within one turn."""
    elevation_deg: Float[np.ndarray, " e"]
    """Elevations, rising; the first and last count up to the poles."""
    gain_dbi: Float[np.ndarray, "e a"]
    """Gain in each direction."""

    def amplitude(self, direction: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Square root of the gain."""
        azimuth = np.degrees(np.arctan2(direction[..., 1], direction[..., 0]))
        azimuth = self.azimuth_deg[0] + (azimuth - self.azimuth_deg[0]) % 360
        elevation = np.degrees(np.arcsin(np.clip(direction[..., 2], -1, 1)))
        elevation = np.clip(elevation, self.elevation_deg[0], self.elevation_deg[-1])
        return 10 ** (self._interpolator(np.stack([elevation, azimuth], axis=-1)) / 20)

    @cached_property
    def _interpolator(self) -> "RegularGridInterpolator":
        from scipy.interpolate import RegularGridInterpolator  # takes 0.2 s

        azimuth = np.append(self.azimuth_deg, self.azimuth_deg[0] + 360)
        around = np.column_stack([self.gain_dbi, self.gain_dbi[:, 0]])
        return RegularGridInterpolator((self.elevation_deg, azimuth), around)


def read_pattern(path: str | Path) -> PatternElement:
    """The element of a pattern file, with the gain that the file gives.

    Raises:
        FileError: If the file is missing or damaged, leaves out more than 45 degrees, or radiates more power than it
            is given.
    """
    path = Path(path)
    is_grid = path.suffix.lower() == ".csv"
    remedy = (
        "Give columns azimuth_deg, elevation_deg, gain_dbi, with a row for each pair of angles."
        if is_grid
        else "Give GAIN, HORIZONTAL and VERTICAL with their numbers of lines, each of an angle and an attenuation."
    )
    with reading(path, "an antenna pattern", remedy, most_bytes=_MOST_BYTES) as file:
        pattern = _grid(file) if is_grid else _sum_of_cuts(file.read().decode("latin-1"), path)
        _check_power(pattern, path)
        return pattern


def _check_power(pattern: PatternElement, path: Path) -> None:
    """Raise ValueError for a pattern that radiates more power than it is given; warn of one with a very low gain."""
    excess_db = 10 * np.log10(mean_over_sphere(lambda node: pattern.amplitude(node) ** 2, _ORDER))
    if excess_db < -(_LOSS_DB if pattern.gain_dbi.max() else _LOSS_OF_RELATIVE_DB):
        logger.warning(
            f"{path}: it radiates {-excess_db:.1f} dB less than it is given. Are its gains relative?"
        )
    if excess_db > _EXCESS_DB:
        most_dbi = pattern.gain_dbi.max()
        raise ValueError(
            f"with its gain of {most_dbi:.1f} dBi it radiates {10 ** (excess_db / 10):.2f} times the power that it is "
            f"given, but the directivity of its shape is {most_dbi - excess_db:.1f} dBi. Check the gain and its unit, "
            "and that attenuations count from the maximum"
        )


def _grid(file: BinaryIO) -> PatternElement:
    from pyarrow import csv

    table = csv.read_csv(pa.PythonFile(file, mode="r"))
    azimuth = numbers(table, "azimuth_deg", pa.float64(), -360, 360)
    elevation = numbers(table, "elevation_deg", pa.float64(), -90, 90)
    gain = numbers(table, "gain_dbi", pa.float64(), *_GAIN_DB)
    azimuths, column = np.unique(_within_a_turn(azimuth), return_inverse=True)
    elevations, row = np.unique(elevation, return_inverse=True)
    _check_gaps(azimuths, "azimuth_deg")
    if len(elevations) < 2 or np.diff(elevations, prepend=-90, append=90).max() > _GAP_DEG:
        raise ValueError(f"elevation_deg leaves out more than {_GAP_DEG:g} degrees between -90 and 90")
    if (size := len(elevations) * len(azimuths)) > 2 * len(gain):
        raise ValueError(f"it has {len(gain)} rows for {size} pairs of angles")
    grid = np.full((len(elevations), len(azimuths)), np.nan)
    grid[row, column] = gain
    if np.isnan(grid).any():
        e, a = np.argwhere(np.isnan(grid))[0]
        raise ValueError(f"there is no gain at azimuth {azimuths[a]:g} and elevation {elevations[e]:g}")
    if (different := grid[row, column] != gain).any():
        raise ValueError(f"row {np.argmax(different) + 1} gives a direction another gain than a later row")
    return PatternElement(azimuth_deg=azimuths, elevation_deg=elevations, gain_dbi=grid)


def _sum_of_cuts(text: str, path: Path) -> PatternElement:
    """Both cuts of an MSI file, summed on a grid of their angles, on which the sum is bilinear in between."""
    gain_dbi, ((clockwise, along_h), (down, along_v)) = _msi(text, path)
    if abs((peak := down[along_v.argmin()]) % 180 - 90) < 90 - _STEEP_DEG:
        logger.warning(
            f"{path}: VERTICAL is strongest at {peak:g} degrees. Do its angles count from the horizon?"
        )
    azimuth = np.unique(np.append(-clockwise % 360, [0.0, 180.0]))
    # Angles of the vertical cut in front and behind, both as elevations.
    folded = np.where(down <= 90, -down, np.where(down < 270, down - 180, 360 - down))
    elevation = np.unique(np.append(folded, [-90.0, 90.0]))
    across = np.interp(-azimuth, clockwise, along_h, period=360)
    at_front, at_back = np.interp([0.0, 180.0], clockwise, along_h, period=360)
    ahead, back = np.interp([0.0, 180.0], down, along_v, period=360)
    if abs(ahead - at_front) > _AGREE_DB:
        at_front, at_back = along_v.min(), back
    front, behind = (
        np.interp(angle, down, along_v, period=360)[:, None] for angle in (-elevation, 180 + elevation)
    )
    share = 1 - np.abs((azimuth + 180) % 360 - 180) / 180
    attenuation = across + share * (front - at_front) + (1 - share) * (behind - at_back)
    return PatternElement(azimuth_deg=azimuth, elevation_deg=elevation, gain_dbi=gain_dbi - attenuation)


def _msi(
    text: str, path: Path
) -> tuple[float, list[tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]]]:
    """Gain [dBi], and angles in [0, 360) and attenuations of the horizontal and the vertical cut."""
    lines = text.splitlines()
    gain_dbi, cuts = None, dict[str, tuple[np.ndarray, np.ndarray]]()
    number = 0
    while number < len(lines):
        words = lines[number].split()
        number += 1
        key = words[0].upper() if words else ""
        if key in cuts or (key == "GAIN" and gain_dbi is not None):
            raise ValueError(f"line {number} begins with {key} again, expected it once")
        if cuts and re.fullmatch(r"[-+.\d]+", key):
            raise ValueError(f"line {number} is more than its cut announces: correct the number of lines")
        if key == "GAIN":
            unit = words[2].lower() if len(words) > 2 else "dbd"
            if unit not in ("dbd", "dbi"):
                raise ValueError(f"line {number} has the unit {words[2]!r}, expected dBd or dBi")
            gain_dbi = _numbers(words[1:2], 1, number)[0] + (_DIPOLE_DBI if unit == "dbd" else 0.0)
            check_within(np.array([gain_dbi]), "GAIN", *_GAIN_DB)
        elif key in ("HORIZONTAL", "VERTICAL"):
            count = _numbers(words[1:2], 1, number)[0]
            if not (1 <= count <= min(_MOST, len(lines) - number) and count == int(count)):
                raise ValueError(
                    f"line {number} announces {count:g} angles, expected 1 to {_MOST}, as many as lines follow"
                )
            rows = [
                _numbers(line.split()[:2], 2, number + k)
                for k, line in enumerate(lines[number : number + int(count)], 1)
            ]
            number += int(count)
            angle, attenuation = np.array(rows).T
            check_within(angle, f"the angle of {key}", -360, 360)
            check_within(attenuation, f"the attenuation of {key}", *_ATTENUATION_DB)
            if attenuation.max() <= 0 > attenuation.min():
                logger.warning(f"{path}: no attenuation of {key} is positive: they count as relative gains.")
                attenuation = -attenuation
            angle, first, which = np.unique(_within_a_turn(angle), return_index=True, return_inverse=True)
            twice = np.abs(attenuation - attenuation[first][which]) > _SAME_DB
            if twice.any():
                raise ValueError(
                    f"{key} has the angle {angle[which[twice.argmax()]]:g} twice, with different attenuations"
                )
            _check_gaps(angle, key)
            cuts[key] = angle, attenuation[first]
    missing = [] if gain_dbi is not None else ["GAIN"]
    missing += [key for key in ("HORIZONTAL", "VERTICAL") if key not in cuts]
    if gain_dbi is None or missing:
        raise ValueError(f"it has no line {missing[0]}")
    return gain_dbi, [cuts["HORIZONTAL"], cuts["VERTICAL"]]


def _numbers(words: list[str], count: int, line: int) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        what = "a number" if count == 1 else "an angle and an attenuation"
        raise ValueError(f"line {line} has {' '.join(words)!r}, expected {what}")
    return numbers


def _within_a_turn(angle_deg: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Angles in [0, 360); those that differ by rounding are one."""
    return np.round(angle_deg, 6) % 360


def _check_gaps(angle_deg: Float[np.ndarray, " n"], what: str) -> None:
    """Reject angles of a circle, rising, that are far apart; a single one is that of rotational symmetry."""
    gaps = np.diff(angle_deg, append=angle_deg[:1] + 360)
    widest = min(_GAP_DEG, _GAP_STEPS * max(1.0, float(np.median(gaps))))
    if len(angle_deg) > 1 and gaps.max() > widest:
        after = angle_deg[gaps.argmax()]
        raise ValueError(
            f"{what} leaves out {gaps.max():g} degrees after {after:g}, at most {widest:g} may be"
        )
