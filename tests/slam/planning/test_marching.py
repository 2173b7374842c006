"""Fast marching gives what another solver gives, and stops where it should."""

import eikonalfm
import numpy as np
import pytest

from slam.planning.marching import march


@pytest.mark.parametrize("walls", [0.0, 0.1])
def test_times_are_those_of_another_solver(walls):
    """eikonalfm, of second order too, on speeds at random from 0.2 to 1, with and without slow cells: to 1e-6."""
    rng = np.random.default_rng(3)
    speed = rng.uniform(0.2, 1.0, (90, 120))
    speed[rng.random(speed.shape) < walls] = 1e-4
    source = (31, 77)
    theirs = eikonalfm.fast_marching(speed, source, (0.05, 0.05), 2)
    np.testing.assert_allclose(march(speed, source, 0.05), theirs, rtol=1e-6, atol=1e-9)


def test_cells_of_no_speed_stop_the_front():
    """A slow wall in their solver is none at all in ours; times on this side are the same, and inf beyond."""
    speed = np.random.default_rng(4).uniform(0.5, 1.0, (40, 60))
    speed[:, 30] = 0.0
    ours = march(speed, (20, 5), 0.05)
    theirs = eikonalfm.fast_marching(np.where(speed > 0, speed, 1e-6), (20, 5), (0.05, 0.05), 2)
    np.testing.assert_allclose(ours[:, :30], theirs[:, :30], rtol=1e-6, atol=1e-9)
    assert np.isinf(ours[:, 30:]).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1)])
def test_grids_of_one_row_or_column(shape):
    """The time is the distance along it, exactly."""
    time = march(np.ones(shape), (0, 0), 0.5)
    np.testing.assert_allclose(time.ravel(), 0.5 * np.arange(time.size), atol=1e-12)


def test_march_lists_reached_cells_by_time_and_then_by_index():
    """An open field has eight cells of most times; among walls and slow cells, fronts of second order step back."""
    rng = np.random.default_rng(5)
    walls = rng.random((60, 80)) > 0.2
    for speed in (np.ones((41, 41), bool), walls, walls * rng.choice([1.0, 0.3, 0.05], walls.shape)):
        speed[20, 20] = 1
        order = np.empty(speed.size, np.uint32)
        time = march(speed, (20, 20), 0.1, order)
        assert np.array_equal(time, march(speed, (20, 20), 0.1))
        reached = np.flatnonzero(np.isfinite(time))
        assert np.array_equal(order[: len(reached)], reached[np.argsort(time.flat[reached], kind="stable")])


@pytest.mark.parametrize("source", [(-1, 0), (0, 4), (3, 0)])
def test_a_source_outside_is_rejected(source):
    with pytest.raises(ValueError, match="expected a cell of the 3 x 4 grid"):
        march(np.ones((3, 4)), source, 1.0)


def test_a_source_in_a_wall_is_rejected():
    with pytest.raises(ValueError, match="expected more than 0"):
        march(np.zeros((3, 4)), (1, 1), 1.0)
