"""Floor plans found in meshes."""

import numpy as np
import pytest

from wireless.geometry.extruded import walls_of

HEIGHT, SNAP = 2.5, 1e-4
#: Corners of a rectangle around, and its halves by either diagonal.
HALVES = {"up": ((0, 1, 2), (0, 2, 3)), "down": ((0, 1, 3), (1, 2, 3))}


def halves(low: float, high: float, diagonal: str) -> list[list[tuple[float, float]]]:
    corners = [(low, 0.0), (high, 0.0), (high, HEIGHT), (low, HEIGHT)]
    return [[corners[i] for i in half] for half in HALVES[diagonal]]


@pytest.mark.parametrize(
    ("triangles", "is_whole"),
    [
        (halves(0.0, 3.0, "up"), True),
        (halves(0.0, 3.0, "down"), True),
        (halves(0.0, 3.0, "up") + halves(-2.0, 1.0, "up") + halves(5.0, 6.0, "down"), True),
        (halves(0.0, 3.0, "up")[:1] * 2, False),  # the same half twice
        ([halves(0.0, 3.0, "up")[0], halves(0.0, 3.0, "down")[0]], False),  # they overlap, and leave a gap
        (halves(0.0, 3.0, "up")[:1], False),
        ([halves(0.0, 3.0, "up")[0], halves(0.0, 2.0, "up")[1]], False),
        ([halves(0.0, 3.0, "up")[0], [(0.0, 0.0), (3.0, HEIGHT), (1.0, HEIGHT)]], False),
    ],
)
def test_walls_with_a_gap_are_rejected(triangles, is_whole):
    corners = np.array([[(s, 1.0, z) for s, z in one] for one in triangles])
    found = walls_of(corners, np.zeros(len(corners), np.int64), 0.0, HEIGHT, SNAP)
    assert (found is not None) == is_whole
