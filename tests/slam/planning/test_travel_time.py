"""Travel times are lengths of taut strings, and walls are walls."""

import math

import numpy as np
import pytest

from slam.grid import GridFrame
from slam.planning.travel_time import travel_time

CELL = 0.05


def _frame(ny: int, nx: int) -> GridFrame:
    return GridFrame(origin_xy=(-1.0, 2.0), resolution_m=CELL, shape=(ny, nx))


def _open(ny: int, nx: int):
    return np.ones((ny, nx)), np.ones((ny, nx), bool)


def test_on_an_open_floor_the_travel_time_is_the_straight_distance():
    """Within half a cell everywhere of 4 m x 3 m; the 8-neighbour shortest path would be up to 8 % (0.3 m) off."""
    frame = _frame(60, 80)
    field = travel_time(frame, *_open(60, 80), (30, 20))
    iy, ix = np.mgrid[:60, :80]
    straight = CELL * np.hypot(iy - 30, ix - 20)
    assert np.abs(field.cost_m - straight).max() < 0.5 * CELL
    assert field.cost_m[30, 20] == 0.0


def test_between_cell_centres_the_time_goes_on_linearly():
    """At random points, within half a cell of the straight distance as well."""
    frame = _frame(60, 80)
    field = travel_time(frame, *_open(60, 80), (30, 20))
    rng = np.random.default_rng(1)
    points = np.array([-1.0, 2.0]) + rng.uniform(0.1, 0.95, (200, 2)) * [4.0, 3.0]
    source = frame.to_points(np.array([20.5, 30.5]))
    straight = np.hypot(*(points - source).T)
    assert np.abs(field.at(points) - straight).max() < 0.5 * CELL


def test_the_cost_of_a_metre_scales_the_time():
    """Three times the cost everywhere is three times the time, to rounding."""
    frame = _frame(30, 30)
    cost, passable = _open(30, 30)
    once = travel_time(frame, cost, passable, (3, 4)).cost_m
    thrice = travel_time(frame, 3 * cost, passable, (3, 4)).cost_m
    np.testing.assert_allclose(thrice, 3 * once, rtol=1e-9)


def test_round_the_end_of_a_wall_the_time_is_the_taut_string():
    """A wall of one column ends at row 40: within two cells of the string over both corners of its end."""
    frame = _frame(60, 80)
    cost, passable = _open(60, 80)
    passable[:40, 40] = False
    source, goal = (10, 20), (10, 60)
    field = travel_time(frame, cost, passable, source)
    # Corners of the free cells that touch the end of the wall: row 40, columns 39.5 and 40.5, in centre coordinates.
    string = CELL * (2 * math.hypot(39.5 - 10, 39.5 - 20) + 1)
    assert field.cost_m[goal] == pytest.approx(string, abs=2 * CELL)
    assert field.cost_m[goal] > CELL * 40 + 0.5, "the path must not lead through the wall"


def test_a_closed_wall_is_impassable():
    """Infinite behind it and in it, finite before it."""
    frame = _frame(20, 30)
    cost, passable = _open(20, 30)
    passable[:, 15] = False
    field = travel_time(frame, cost, passable, (5, 5))
    assert np.isfinite(field.cost_m[:, :15]).all()
    assert np.isinf(field.cost_m[:, 15:]).all()
    assert np.isinf(field.at(frame.to_points(np.array([[20.5, 5.5], [-3.0, 5.0], [40.0, 5.0]])))).all()


def test_the_time_falls_towards_the_source():
    """On an open floor, differences of 0.2 m fall towards the source, within 8 degrees a metre away."""
    frame = _frame(60, 60)
    field = travel_time(frame, *_open(60, 60), (30, 30))
    azimuth = np.arange(-3.0, 3.1, 0.5)
    points = frame.to_points(np.array([30.5, 30.5])) + np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    rise_x, rise_y = (field.at(points + step) - field.at(points - step) for step in 0.1 * np.eye(2))
    off = np.arctan2(rise_y, rise_x) - azimuth
    assert np.abs((off + math.pi) % (2 * math.pi) - math.pi).max() < math.radians(8)


def test_straight_legs_cost_their_length_and_walls_stop_them():
    """On cost 2: 1 m costs 2; through a wall or off the grid: inf."""
    frame = _frame(40, 40)
    cost, passable = _open(40, 40)
    passable[:, 30] = False
    field = travel_time(frame, 2 * cost, passable, (20, 5))
    start = frame.to_points(np.array([5.5, 20.5]))
    ends = start + np.array([[1.0, 0.0], [0.6, 0.8], [1.5, 0.0], [-1.0, 0.0]])
    np.testing.assert_allclose(field.of_legs(start, ends), [2.0, 2.0, np.inf, np.inf], atol=1e-9)


def test_a_source_off_the_grid_is_rejected():
    """And says which."""
    with pytest.raises(ValueError, match="source"):
        travel_time(_frame(5, 5), *_open(5, 5), (5, 0))
