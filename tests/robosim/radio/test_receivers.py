"""Grids of receivers: regular ones in free space, and those of the published data exactly."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import shapely

from robosim.building.building import make_building
from robosim.plans.files import read_plan
from robosim.plans.floorplan import OCCUPIED
from robosim.radio.receivers import receiver_grid
from tests.plans import room, two_rooms


def test_a_room_is_filled_from_half_a_step():
    """A room of 4 by 3 m at 0.5 m: 8 by 6 receivers, the first at (0.25, 0.25), rows from the bottom."""
    grid = receiver_grid(make_building(room()), 0.5, 1.5)
    assert grid.shape == (6, 8)
    assert len(grid.position) == 48
    assert grid.position[[0, 1, 8]].tolist() == [[0.25, 0.25, 1.5], [0.75, 0.25, 1.5], [0.25, 0.75, 1.5]]
    assert grid.cell[8].tolist() == [1, 0]
    assert grid.edges[6, 8] == pytest.approx([4, 3])


def test_receivers_stand_in_free_space_in_every_room():
    """Two rooms without a door, the wall between them 0.2 m: none in the wall, all in other places."""
    building = make_building(two_rooms(0.0))
    grid = receiver_grid(building, 0.1, 1.5)
    assert len(grid.position) == 30 * 60
    assert shapely.distance(building.free.boundary, shapely.points(grid.position[:, :2])).min() > 1e-3


def test_cells_of_the_grid_lie_around_their_receivers_on_a_turned_plan():
    """Each receiver is the mean of its cell's four corners, and corners are a step apart, at any yaw."""
    plan = replace(room(), origin=(5.0, -7.0, 0.7))
    grid = receiver_grid(make_building(plan), 0.25, 1.0)
    iy, ix = grid.cell.T
    corners = np.stack([grid.edges[iy + a, ix + b] for a in (0, 1) for b in (0, 1)])
    assert corners.mean(axis=0) == pytest.approx(grid.position[:, :2])
    assert np.linalg.norm(corners[1] - corners[0], axis=1) == pytest.approx(0.25)


def test_published_receivers_are_found_again(shared):
    """All of them, no other one, at the same places with the same numbers: three buildings, 5,966 receivers."""
    for name in ("Colebrook", "Kerrtown", "Goffs"):
        plan = read_plan(shared / f"maps/gibson/train/{name}.glb_topdownmap.out")
        grid = receiver_grid(make_building(plan), 0.15, 1.5)
        with open(shared / f"data/mmwrobotnav/{name}/{name}_Tx_1_beam_search.csv") as file:
            rows = list(csv.DictReader(file))
        theirs = {
            (int(row["rxPosInd_1"]), int(row["rxPosInd_2"]), int(row["lineIndex"])): (
                row["rxPos_1"],
                row["rxPos_2"],
            )
            for row in rows
        }
        iy, ix = grid.cell.T
        numbers = zip(grid.shape[0] - iy, ix + 1, iy * grid.shape[1] + ix, strict=True)
        ours = dict(zip(numbers, grid.position[:, :2], strict=True))
        assert ours.keys() == theirs.keys()
        for key, place in theirs.items():
            assert ours[key] == pytest.approx([float(x) for x in place], abs=1e-9)


def test_blocks_of_a_plan_that_they_do_not_fill_count_from_the_top_left():
    """Seven rows: two blocks, and one row left over at the bottom."""
    plan = room(width_m=0.5, depth_m=0.35, wall_line="cell_centre")
    occupancy = plan.occupancy.copy()
    occupancy[5, 1] = OCCUPIED  # the middle of the block at the top left: rows 6, 5, 4 from the bottom
    grid = receiver_grid(make_building(replace(plan, occupancy=occupancy)), 0.15, 1.5)
    assert grid.shape == (2, 3)
    assert grid.cell.tolist() == [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2]]
    # The middle cell of the lower left block is row 2, column 1; the receiver is a cell lower.
    assert grid.position[0] == pytest.approx([0.075, 0.075, 1.5])


@pytest.mark.parametrize(
    ("step_m", "height_m", "message"),
    [
        (0.0, 1.5, "grid is 0.0, expected 0.01 to 100 m"),
        (-0.15, 1.5, "grid is -0.15"),
        (np.nan, 1.5, "grid is nan"),
        (0.001, 1.5, "grid is 0.001"),
        (0.01, 1.5, "more than 1000000 places"),
        (50.0, 1.5, "no receiver fits"),
        (0.15, 2.6, "height is 2.6 m, expected 0 to 2.5 m"),
        (0.15, -0.1, "height is -0.1 m"),
    ],
)
def test_mistakes_name_value_and_fix(step_m, height_m, message):
    with pytest.raises(ValueError, match=message):
        receiver_grid(make_building(room(12.0, 9.0)), step_m, height_m)
