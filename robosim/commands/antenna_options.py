"""Antennas of transmitters and receivers from the command line: an element or an array, and how it is turned."""

import re

import numpy as np

from robosim.support.checks import shown
from wireless.antennas.arrays import uniform_array
from wireless.antennas.elements import ELEMENTS, element_named
from wireless.antennas.mounting import MountedArray

#: Rows x columns, distance in wavelengths, element and its angles.
_LAYOUT = re.compile(r"([1-9]\d{0,2})x([1-9]\d{0,2})(?:@(0?\.\d+|[1-9]\d?(?:\.\d+)?))?(?::(.+))?", re.ASCII)


def parse_antenna(end: str, text: str, layout: str | None, polarisation: str) -> MountedArray:
    """The antenna of an end (tx or rx) of words such as 3gpp,90,6 and 8x4, or isotropic and 8x4@0.7:3gpp,90,6.

    Raises:
        ValueError: If a word is not understood.
        FileError: If a pattern file is missing or damaged.
    """
    match = _LAYOUT.fullmatch(layout or "1x1")
    if match is None:
        raise ValueError(
            f"{end}_array is {shown(layout)}, expected rows x columns (each 1 to 999), such as 8x4, 8x4:3gpp or, 0.7 "
            "wavelengths apart and facing 90 degrees, 8x4@0.7:3gpp,90."
        )
    rows, columns, spacing_wl, element = match.groups()
    if element and text != "isotropic":
        raise ValueError(
            f"{end}_array is {shown(layout)} and {end}_antenna is {shown(text)}, expected elements in one of them. "
            f"Give --{end}-array {rows}x{columns}."
        )
    name, *words = (element or text).split(",")
    try:
        angles = np.radians([float(word) for word in words])
    except ValueError:
        angles = np.array([np.nan])
    if len(angles) > 3 or not (np.abs(angles) <= 2 * np.pi).all():
        raise ValueError(
            f"{end}_{'array' if element else 'antenna'} is {shown(element or text)}, expected an element, or an "
            "element and its yaw, pitch (down) and roll [degrees] with commas and no spaces, such as 3gpp,90,6."
        )
    turns = dict(zip(("yaw_rad", "pitch_rad", "roll_rad"), angles.tolist(), strict=False))
    spacing = float(spacing_wl or 0.5)
    array = uniform_array(int(columns), int(rows), element=element_named(name), spacing_wl=spacing)
    scaling = "directivity" if name in ELEMENTS else "given"
    return MountedArray.polarised(polarisation, array, scaling=scaling, **turns)
