"""What ways over known ground cost the robot."""

import numpy as np

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
