"""Walls that need no union: triangles that are halves of rectangles, two and two."""

import numpy as np
import pytest

from wireless.geometry.extruded import _rectangles, walls_of

HEIGHT, SNAP = 2.5, 1e-4
#: Corners of a rectangle around, and its halves by either diagonal.
HALVES = {"up": ((0, 1, 2), (0, 2, 3)), "down": ((0, 1, 3), (1, 2, 3))}


def halves(low: float, high: float, diagonal: str) -> list[list[tuple[float, float]]]:
    corners = [(low, 0.0), (high, 0.0), (high, HEIGHT), (low, HEIGHT)]
    return [[corners[i] for i in half] for half in HALVES[diagonal]]


def whole(triangles: list[list[tuple[float, float]]]) -> bool:
    both = np.array(triangles)
    return _rectangles(both[:, :, 0], both[:, :, 1], HEIGHT, SNAP)


@pytest.mark.parametrize("diagonal", HALVES)
def test_two_halves_are_whole(diagonal):
    assert whole(halves(0.0, 3.0, diagonal))
    several = halves(0.0, 3.0, diagonal) + halves(-2.0, 1.0, "up") + halves(5.0, 6.0, "down")
    assert whole([several[i] for i in (3, 0, 5, 1, 4, 2)])


def test_what_may_have_gaps_is_not_taken_for_whole():
    first, _ = halves(0.0, 3.0, "up")
    other, _ = halves(0.0, 3.0, "down")
    assert not whole([first, first])  # the same half twice
    assert not whole([first, other])  # halves of two diagonals overlap, and leave a gap
    assert not whole([first])
    assert not whole([first, halves(0.0, 2.0, "up")[1]])
    assert not whole([first, [(0.0, 0.0), (3.0, HEIGHT), (0.0, HEIGHT - 0.1)]])
    assert not whole([first, [(0.0, 0.0), (3.0, HEIGHT), (1.0, HEIGHT)]])
    assert not whole([first, [(0.0, 0.0), (0.0, HEIGHT), (0.0, HEIGHT)]])


@pytest.mark.parametrize("second", [1, 0])
def test_a_wall_with_a_gap_is_refused(second):
    flat = [halves(0.0, 3.0, "up")[i] for i in (0, second)]
    triangles = np.array([[(s, 1.0, z) for s, z in half] for half in flat])
    found = walls_of(triangles, np.zeros(2, np.int64), 0.0, HEIGHT, SNAP)
    assert (found is None) == (second == 0)
