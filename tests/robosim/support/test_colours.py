"""One table of colours for link states, distinct for people with each kind of colour blindness."""

import itertools

import numpy as np
import pytest

from robosim.drawing.picture import Picture
from robosim.live.scene_nodes import RAY_COLOURS, state_colours
from robosim.support.colours import STATE_COLOURS
from wireless.paths import LinkCategory, LinkState

#: Linear RGB as dichromats see it, severity 1 (Machado et al. 2009, table 1).
SIGHT = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
#: Linear sRGB to CIE XYZ (IEC 61966-2-1), and the white point D65.
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = np.array([0.9505, 1.0, 1.089])
#: Shades of the pictures that states are drawn on: free floor, and walls.
AROUND = {"floor": (255, 255, 255), "wall": (64, 64, 64)}


def lab(colour: tuple[int, int, int], sight) -> np.ndarray:
    """A colour in CIELAB, as somebody sees it."""
    value = np.array(colour) / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    xyz = XYZ @ np.clip(np.asarray(sight) @ linear, 0, 1) / WHITE
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHT)
def test_states_are_distinct(sight):
    """At least 23 units of CIELAB between any two (measured 23.3); before, 10.8 between outage and line of sight."""
    colours = {**STATE_COLOURS, **AROUND}
    seen = {name: lab(colour, SIGHT[sight]) for name, colour in colours.items()}
    for a, b in itertools.combinations(seen, 2):
        if not {a, b} <= AROUND.keys():
            assert np.linalg.norm(seen[a] - seen[b]) > 23, (a, b)


def test_all_pictures_have_the_same_colours():
    """Traced plans, the page, the legend of episodes' pictures, and rays in line of sight."""
    assert [tuple(one) for one in state_colours(np.arange(5, dtype=np.uint8)).tolist()] == [
        STATE_COLOURS[state] for state in LinkCategory
    ]
    line = Picture([np.array([[0.0, 0], [3, 0], [3, 2]])], np.zeros(2))._timeline
    assert [tuple(line._colours[state].tolist()) for state in LinkState] == [
        STATE_COLOURS[state] for state in LinkState
    ]
    assert RAY_COLOURS["line of sight"] == STATE_COLOURS[LinkState.LOS]
