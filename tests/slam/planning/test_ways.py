"""What ways over known ground cost the robot."""

from dataclasses import replace

import numpy as np
import pytest

from slam.grid import GridFrame
from slam.planning.cost_map import Box, CostConfig
from slam.planning.known_ground import ways_from_robot

CELL_M = 0.05


def _box(probability: np.ndarray) -> Box:
    frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=CELL_M, shape=probability.shape)
    return Box(
        frame=frame,
        probability=probability.astype(np.float32),
        explored=probability < 0.5,
        anticipated=np.full(probability.shape, 0.5, np.float32),
        blocked=np.zeros(frame.shape, bool),
        obstacle=probability > 0.5,
        offset_m=None,
        pose=np.array([1.0, 1.0, 0.0]),
    )


def test_open_floor_costs_its_length():
    """With nothing in the way a way costs its length: here 3 m along x, and 5 m along a slope of 3 to 4.

    Bound 5 cm, half a cell of the halved grid (measured 3.1 cm, from the corner of the source).
    """
    way = ways_from_robot(_box(np.zeros((120, 120))), CostConfig())
    assert way.frame.resolution_m == 2 * CELL_M
    got = way.at(np.array([[4.0, 1.0], [4.0, 5.0]]))
    np.testing.assert_allclose(got, [3.0, 5.0], atol=0.05)


def test_unknown_ground_is_a_way_or_none_as_asked():
    """A strip of unknown cells across the floor: through it a way costs more than its length, or there is none."""
    probability = np.zeros((120, 120))
    probability[:, 50:70] = 0.5
    box, beyond = _box(probability), np.array([4.5, 1.0])
    through = float(ways_from_robot(box, CostConfig(unknown_cost=1.5)).at(beyond))
    assert abs(through - (3.5 + 0.5 * 20 * CELL_M)) < 0.1
    assert np.isinf(ways_from_robot(box, CostConfig(), through_unknown=False).at(beyond))
    assert np.isfinite(ways_from_robot(box, CostConfig(), through_unknown=False).at(np.array([2.0, 1.0])))


def test_ways_avoid_what_is_anticipated():
    """A metre of unknown ground costs 1.5; sure of an obstacle 21.5; half sure 11.5, and nothing where all is known."""
    unknown, known = np.full((80, 80), 0.5), np.zeros((80, 80))
    for probability, anticipated, expected in (
        (unknown, 0.5, 1.5),
        (unknown, 0.2, 1.5),
        (unknown, 1.0, 21.5),
        (unknown, 0.75, 11.5),
        (known, 1.0, 1.0),
    ):
        box = replace(_box(probability), anticipated=np.full((80, 80), anticipated, np.float32))
        way = ways_from_robot(box, CostConfig())
        assert way.at(np.array([3.0, 1.0])) == pytest.approx(2.0 * expected, abs=0.05 * expected + 0.05)
