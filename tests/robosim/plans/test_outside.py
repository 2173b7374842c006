"""White paper round a drawn plan: found, said, and left out of what is drawn at random."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.plans.outside import outside_of
from robosim.radio.transmitters import random_transmitters
from robosim.task.tasks import make_task
from tests.plans import room, two_rooms


def on_paper(door_m: float = 0.0, paper_m: float = 1.5) -> tuple[FloorPlan, np.ndarray]:
    """Two rooms with walls of 0.2 m around them on white paper, and which cells are paper; with a front door or not."""
    inner = two_rooms(0.8)
    ny, nx = inner.shape
    wall, paper = 4, round(paper_m / inner.resolution_m)
    rim = wall + paper
    cells = np.full((ny + 2 * rim, nx + 2 * rim), FREE, np.uint8)
    cells[paper:-paper, paper:-paper] = OCCUPIED
    cells[rim:-rim, rim:-rim] = inner.occupancy
    if door_m:
        middle, half = rim + ny // 4, round(door_m / inner.resolution_m / 2)
        cells[middle - half : middle + half, paper:rim] = FREE
    truth = np.ones(cells.shape, bool)
    truth[paper:-paper, paper:-paper] = False
    return replace(inner, occupancy=cells, name="paper"), truth


@pytest.mark.parametrize("door_m", [0.0, 0.9, 1.2])
def test_paper_is_outside_and_rooms_are_not(door_m):
    """All of it, whether the front door is open or not; of the rooms nothing but the doorway may go with it."""
    plan, paper = on_paper(door_m)
    found = outside_of(plan)
    assert found[paper].all()
    assert found[~paper].sum() * plan.resolution_m**2 < 0.5


def test_plans_without_paper_have_no_outside():
    """A room that fills its picture, and every shipped plan."""
    assert not outside_of(room()).any()
    for name in ("flat", "office", "villa", "cottage"):
        assert not outside_of(read_plan(name)).any()


def test_nothing_is_drawn_there_and_that_is_said(caplog):
    plan, _ = on_paper(0.9)
    outside = outside_of(plan)
    building = make_building(plan)
    with caplog.at_level(logging.WARNING):
        places = reach(building, 0.1)
    assert "m2 of free space around the building reach the edges of the plan" in caplog.text
    tasks = [make_task(places, np.random.default_rng(seed)) for seed in range(20)]
    drawn = [*(task.start[:2] for task in tasks), *(task.target for task in tasks)]
    drawn += list(random_transmitters(building, 30, 1.5, np.random.default_rng(0))[:, :2])
    column, row = np.floor(plan.to_cells(np.array(drawn))).astype(int).T
    assert not outside[row, column].any()
    # The robot may go out if it is told to.
    there = make_task(places, np.random.default_rng(0), start=np.array([0.5, 0.5, 0.0]))
    assert not outside[tuple(np.floor(plan.to_cells(there.target)).astype(int)[::-1])]


def test_the_rooms_are_the_largest_part_whatever_the_paper(caplog):
    """Behind closed walls: what is around the building is neither the first part nor a room that is cut off."""
    plan, paper = on_paper(0.0, 6.0)
    places = reach(make_building(plan), 0.1)
    assert not places.indoors[paper].any()
    assert not (places.parts == 1)[paper].any()
    assert places.cut_off(1) == []
