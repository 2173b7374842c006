"""Antennas of transmitters and receivers from the command line: an element or an array, and how it is turned."""

import re
from typing import NamedTuple

import numpy as np

from robosim.support.checks import shown
from wireless.antennas.arrays import uniform_array
from wireless.antennas.elements import ELEMENTS, element_named
from wireless.antennas.mounting import MountedArray

#: Antenna of an end for which none is given, and most elements of an array.
ISOTROPIC, _MOST_ELEMENTS = "isotropic", 4096
_LAYOUT = re.compile(r"(\d{1,4})x(\d{1,4})(?:@(\d*\.?\d+))?(?::(.+))?", re.ASCII)


class Antennas(NamedTuple):
    """Antennas of both ends, with the ports of the tracer's polarisation."""

    tx: MountedArray
    rx: MountedArray


def parse_antennas(elements: dict[str, str], arrays: dict[str, str | None], polarisation: str) -> Antennas:
    """Antennas of words such as tx_antenna 3gpp,90,6 and tx_array 8x4, or tx_array 8x4:3gpp,90,6.

    Raises:
        ValueError: If a word is not understood.
        FileError: If a pattern file is missing or damaged.
    """
    return Antennas(
        *(
            _parse(
                elements[f"{end}_antenna"],
                f"{end}_antenna",
                arrays[f"{end}_array"],
                f"{end}_array",
                polarisation,
            )
            for end in ("tx", "rx")
        )
    )


def _parse(text: str, option: str, layout: str | None, array_option: str, polarisation: str) -> MountedArray:
    """The antenna of an end."""
    rows, columns, spacing_wl = 1, 1, 0.5
    if layout is not None:
        match = _LAYOUT.fullmatch(layout)
        rows, columns, spacing_wl = (
            (int(match[1]), int(match[2]), float(match[3] or 0.5)) if match else (0, 0, 0.5)
        )
        if match is None or not (1 <= rows * columns <= _MOST_ELEMENTS and 0 < spacing_wl < 100):
            raise ValueError(
                f"{array_option} is {shown(layout)}, expected rows x columns (1 to {_MOST_ELEMENTS} elements), such as "
                "8x4, 8x4:3gpp or, 0.7 wavelengths apart and facing 90 degrees, 8x4@0.7:3gpp,90."
            )
        if match[4] is not None:
            if text != ISOTROPIC:
                raise ValueError(
                    f"{array_option} is {shown(layout)} and {option} is {shown(text)}, expected elements in one of "
                    f"them. Give --{array_option.replace('_', '-')} {layout.partition(':')[0]}."
                )
            text, option = match[4], array_option
    name, *words = text.split(",")
    try:
        angles = np.radians([float(word) for word in words])
    except ValueError:
        angles = np.array([np.nan])
    if len(angles) > 3 or not np.isfinite(angles).all():
        raise ValueError(
            f"{option} is {shown(text)}, expected an element, or an element and its yaw, pitch (down) and roll "
            "[degrees] with commas and no spaces, such as 3gpp,90,6."
        )
    yaw_rad, pitch_rad, roll_rad = np.append(angles, np.zeros(3 - len(angles))).tolist()
    return MountedArray.polarised(
        polarisation,
        uniform_array(columns, rows, element=element_named(name), spacing_wl=spacing_wl),
        yaw_rad=yaw_rad,
        pitch_rad=pitch_rad,
        roll_rad=roll_rad,
        scaling="directivity" if name in ELEMENTS else "given",
    )
