"""What a floor plan rejects, and its coordinates."""

import numpy as np
import pytest

from robosim.plans.floorplan import FloorPlan, MapError, grid_size

GOOD = {"occupancy": np.array([[0, 1, 2]], np.uint8), "resolution_m": 0.05}


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"occupancy": np.zeros((0, 3), np.uint8)}, "(0, 3)"),
        ({"occupancy": np.array([[0, 3]], np.uint8)}, "up to 3"),
        ({"occupancy": np.array([[1, 2]], np.uint8)}, "no free space"),
        ({"occupancy": np.broadcast_to(np.uint8(0), (20_000, 20_000))}, "20000 x 20000"),
        ({"resolution_m": 0.0}, "resolution is 0 m"),
        ({"resolution_m": -1.0}, "resolution is -1 m"),
        ({"resolution_m": float("nan")}, "resolution is nan m"),
        ({"origin": (0.0, float("inf"), 0.0)}, "origin"),
        ({"eroded_m": -0.1}, "eroded_m is -0.1"),
        ({"name": ""}, "name is ''"),
        ({"name": "../plan"}, "slashes"),
        ({"name": "a\nb"}, "printable"),
    ],
)
def test_senseless_plans_are_rejected(keys, word):
    with pytest.raises(MapError) as error:
        FloorPlan(**{**GOOD, **keys})
    assert word in str(error.value)


def test_cells_and_map_are_inverse_and_turn_counter_clockwise():
    """Origin (1, 2) turned by 90 degrees: the corner (1, 0) of cells of 0.5 m lies at (1, 2.5)."""
    plan = FloorPlan(occupancy=GOOD["occupancy"], resolution_m=0.5, origin=(1.0, 2.0, np.pi / 2))
    np.testing.assert_allclose(plan.to_map(np.array([1.0, 0.0])), [1.0, 2.5], atol=1e-12)
    cells = np.random.default_rng(0).uniform(-5, 5, (20, 2))
    np.testing.assert_allclose(plan.to_cells(plan.to_map(cells)), cells, atol=1e-12)


@pytest.mark.parametrize(("width", "columns"), [(1.0, 22), (1.0000001, 22), (1.01, 23), (0.0, 3)])
def test_grids_hold_a_rectangle_with_a_margin(width, columns):
    """A rounding error more than 20 cells makes no column; a fifth of a cell does."""
    size = grid_size(np.zeros(2), np.array([width, 0.5]), 0.05, "it")
    assert size == (columns, 12)


@pytest.mark.parametrize("upper", [1e9, 1e308, float("inf")])
def test_absurd_grids_are_rejected(upper):
    with pytest.raises(MapError, match=r"it goes.*metres"):
        grid_size(np.array([-upper, 0.0]), np.array([upper, 1.0]), 0.05, "it")
