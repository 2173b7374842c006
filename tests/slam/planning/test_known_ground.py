"""Travel time of the robot over known ground."""

from dataclasses import replace

import numpy as np
import pytest

from slam.grid import GridFrame
from slam.planning.cost_map import Box, CostConfig, travel_time_from_robot
from slam.robot import Robot

CELL_M = 0.05

HULL = Robot().hull


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
    """Without obstacles the cost is the length: here 3 m along x, and 5 m along a slope of 3 to 4."""
    travel_time = travel_time_from_robot(_box(np.zeros((120, 120))), CostConfig(), HULL)
    assert travel_time.frame.resolution_m == 2 * CELL_M
    got = travel_time.at(np.array([[4.0, 1.0], [4.0, 5.0]]))
    np.testing.assert_allclose(got, [3.0, 5.0], atol=0.05)


def test_unknown_ground_is_passable_or_not():
    """A strip of unknown cells across the floor: through it the cost exceeds the length, or is infinite."""
    probability = np.zeros((120, 120))
    probability[:, 50:70] = 0.5
    box, beyond = _box(probability), np.array([4.5, 1.0])
    through = float(travel_time_from_robot(box, CostConfig(unknown_cost=1.5), HULL).at(beyond))
    assert abs(through - (3.5 + 0.5 * 20 * CELL_M)) < 0.1
    assert np.isinf(travel_time_from_robot(box, CostConfig(), HULL, through_unknown=False).at(beyond))
    assert np.isfinite(
        travel_time_from_robot(box, CostConfig(), HULL, through_unknown=False).at(np.array([2.0, 1.0]))
    )


def test_paths_avoid_anticipated_obstacles():
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
        travel_time = travel_time_from_robot(box, CostConfig(), HULL)
        assert travel_time.at(np.array([3.0, 1.0])) == pytest.approx(
            2.0 * expected, abs=0.05 * expected + 0.05
        )
