"""Trees of boxes hold each thing once, within its bounds, however things lie."""

import numpy as np
import pytest

from wireless.geometry.boxes import LEAF, make_boxes


def things(kind, rng):
    """Lowest and highest corners of 500 things."""
    low = rng.uniform(0, 10, (500, 3))
    if kind == "doubled":
        low[:] = low[0]
    if kind == "in a row":  # each ten times as far as the one before: cuts are far from the middle
        low = np.cumsum(10.0 ** np.linspace(-9, 9, 500))[:, None] * [1.0, 0, 0]
    return low, low + rng.uniform(0, 1, (500, 3))


@pytest.mark.parametrize("kind", ["scattered", "doubled", "in a row"])
def test_each_thing_is_in_one_box_and_within_it(kind):
    """500 things scattered, all in one place, and in a row of rising distances; stacks have room for 64 boxes."""
    low, high = things(kind, np.random.default_rng(1))
    boxes = make_boxes(low, high)
    assert sorted(boxes.number) == list(range(500))
    waiting, met, most = [0], [], 0
    while waiting:
        most = max(most, len(waiting))
        box = waiting.pop()
        one, other = boxes.child[box]
        if one >= 0:
            for inner in (one, other):
                assert (boxes.low[inner] >= boxes.low[box]).all()
                assert (boxes.high[inner] <= boxes.high[box]).all()
            waiting += [one, other]
            continue
        assert 1 <= other <= LEAF
        held = boxes.number[-1 - one : -1 - one + other]
        assert (low[held] >= boxes.low[box]).all() and (high[held] <= boxes.high[box]).all()
        met += held.tolist()
    assert sorted(met) == list(range(500))
    assert most <= 64


def test_nothing_is_in_an_empty_box():
    """No thing at all makes one box of none."""
    boxes = make_boxes(np.empty((0, 3)), np.empty((0, 3)))
    assert len(boxes.number) == 0 and boxes.child.tolist() == [[-1, 0]]
