"""Colours of the page, which colour-blind readers can distinguish.

As in the pictures of `robosim trace`: power over the floor in cividis, power of rays in plasma, the brighter the
stronger; angles in twilight; states from `robosim.support.colours`.
"""

from functools import cache
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8

from robosim.recording.rerun_recording import RAY_COLOURS
from robosim.support.colours import STATE_COLOURS, Colour, css
from wireless.paths import LinkCategory
from wireless.support.ray_colours import RAY_MAP, RAY_SHARE

TX_COLOUR: Colour = (213, 94, 0)
ROBOT_COLOUR: Colour = (0, 158, 115)
TRUE_ARRIVAL: Colour = (60, 60, 60)
ESTIMATED_ARRIVAL: Colour = (230, 159, 0)
WALL: Colour = (205, 212, 220)
WALL_EDGE: Colour = (70, 80, 95)
FLOOR: Colour = (246, 246, 244)

#: Ends of the colour scale of received power [dBm].
POWER_DBM = (-110.0, -40.0)
#: Colour maps, and the part of each that is used.
_PARTS = {"cividis": (0.0, 1.0), "twilight": (0.0, 1.0), RAY_MAP: RAY_SHARE}
TableName = Literal["cividis", "twilight", "plasma"]


@cache
def _table(name: TableName) -> UInt8[np.ndarray, "256 3"]:
    import matplotlib

    return np.round(255 * matplotlib.colormaps[name](np.linspace(*_PARTS[name], 256))[:, :3]).astype(np.uint8)


def power_colours(
    power_dbm: Float[np.ndarray, " n"], table: TableName = "cividis"
) -> UInt8[np.ndarray, "n 3"]:
    """Colours of received powers [dBm], clipped to `POWER_DBM`."""
    low, high = POWER_DBM
    level = np.clip((np.asarray(power_dbm) - low) / (high - low), 0, 1)
    return _table(table)[np.round(255 * level).astype(np.int64)]


def angle_colours(angle_rad: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of azimuths [rad], the same at both ends of the circle."""
    level = (np.asarray(angle_rad) + np.pi) / (2 * np.pi) % 1
    return _table("twilight")[np.floor(255.999 * level).astype(np.int64)]


def state_colours(state: UInt8[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of link states or categories."""
    return np.array([STATE_COLOURS[one] for one in LinkCategory], np.uint8)[state]


def kind_colours(kinds: list[str]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of kinds of rays, by the names of `RAY_COLOURS`."""
    return np.array([RAY_COLOURS[kind] for kind in kinds], np.uint8).reshape(-1, 3)


def linear(colours: UInt8[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Linear colours for the ends of lines, which viser does not draw as sRGB (IEC 61966-2-1)."""
    value = np.asarray(colours) / 255
    light = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.round(255 * light).astype(np.uint8)


def gradient(name: TableName) -> str:
    """A colour map as a CSS background."""
    stops = ", ".join(css(tuple(_table(name)[i].tolist())) for i in range(0, 256, 51))
    return f"linear-gradient(to right, {stops})"
