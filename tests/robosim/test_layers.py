"""Maps and beliefs in small integers: what is known stays, what is anticipated falls into levels."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robosim.layers import (
    GUESS,
    GUESS_LEVELS,
    OBSTACLE,
    TOP_LEVEL,
    UNKNOWN,
    Layer,
    LevelledBelief,
    layer_of_belief,
    layer_of_map,
    map_of_layer,
)
from slam.grid import GridFrame, MapEstimate

FRAME = GridFrame(origin_xy=(0.0, 0.0), shape=(60, 60))


def test_guesses_are_recorded_where_nothing_is_known():
    """Probabilities 0.02 and 0.98 fall into the first and last level; an observed wall stays what it is."""
    for odds, level in ((0.02, 0), (0.98, GUESS_LEVELS - 1)):
        guess, known = np.full((2, *FRAME.shape), 0.5, np.float32)
        guess[20:40, 20:40], known[20:40, 20] = odds, 0.9
        nothing = np.zeros(FRAME.shape, bool)
        estimate = MapEstimate(
            frame=FRAME, obstacle_probability=known, explored=nothing, blocked=nothing, pose=np.zeros(3),
            anticipated_probability=guess,
        )  # fmt: skip
        values = layer_of_map(estimate).values
        assert set(np.unique(values)) == {UNKNOWN, OBSTACLE, GUESS + level}
        assert (values == OBSTACLE).sum() == 20
        assert (values == GUESS + level).sum() == 20 * 19


@given(arrays(np.uint8, FRAME.shape, elements=st.integers(0, GUESS + GUESS_LEVELS - 1)))
def test_a_map_of_a_layer_has_that_layer(values):
    layer = Layer(FRAME, values)
    np.testing.assert_array_equal(layer_of_map(map_of_layer(layer, np.zeros(3))).values, values)


@given(arrays(np.uint8, (7, 9), elements=st.integers(0, TOP_LEVEL)))
def test_a_belief_of_levels_has_these_levels(values):
    layer = Layer(GridFrame(origin_xy=(0.0, 0.0), shape=(7, 9)), values)
    np.testing.assert_array_equal(layer_of_belief(LevelledBelief(layer)).values, values)
