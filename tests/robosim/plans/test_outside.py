"""White paper round a drawn plan: found, said, and left out of what is drawn at random."""

import logging
import math
from dataclasses import replace

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan
from robosim.plans.outside import outside_of
from robosim.radio.receivers import random_transmitters, receiver_grid
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
    # The robot may go out if it is instructed to.
    there = make_task(places, np.random.default_rng(0), start=np.array([0.5, 0.5, 0.0]))
    assert not outside[tuple(np.floor(plan.to_cells(there.target)).astype(int)[::-1])]


def test_the_rooms_are_the_largest_part_whatever_the_paper(caplog):
    """Behind closed walls: what is around the building is neither the first part nor a room that is cut off."""
    plan, paper = on_paper(0.0, 6.0)
    places = reach(make_building(plan), 0.1)
    assert not places.indoors[paper].any()
    assert not (places.parts == 1)[paper].any()
    assert places.cut_off(1) == []


def house_on_ground(
    turn: float = 0.0, shape: str = "square", beyond: int = UNKNOWN
) -> tuple[FloorPlan, np.ndarray]:
    """A house of 5 x 4 m with an open front door on ground of about 12 x 12 m, turned; and which cells are ground."""
    resolution_m, c, s = 0.05, math.cos(math.radians(turn)), math.sin(math.radians(turn))
    y, x = np.mgrid[:380, :380] * resolution_m - 9.5 + 0.025
    x, y = x * c + y * s, y * c - x * s
    ground = {"square": np.maximum(np.abs(x), np.abs(y)) < 6, "round": np.hypot(x, y) < 6}
    ground["L"] = ground["square"] & ~((x > 3.4) & (y > 3.4))
    house = (np.abs(x) < 2.7) & (np.abs(y) < 2.2)
    room = (np.abs(x) < 2.5) & (np.abs(y) < 2.0)
    door = (np.abs(x) < 0.45) & (y > 0) & house
    wall = house & ~room & ~door | (np.abs(x - 0.5) < 0.1) & room & (y < 1)
    cells = np.where(ground[shape], FREE, beyond).astype(np.uint8)
    cells[wall] = OCCUPIED
    return FloorPlan(occupancy=cells, resolution_m=resolution_m, name="house"), ground[shape] & ~house


@pytest.mark.parametrize("turn", [0, 30, 45])
@pytest.mark.parametrize("shape", ["square", "round", "L"])
def test_ground_of_any_shape_is_outside(shape, turn):
    """A ground plate with nothing beyond it, as meshes of houses have: all of it, and nothing but a doorway else."""
    plan, ground = house_on_ground(turn, shape)
    assert outside_of(plan)[ground].mean() > 0.999
    assert (outside_of(plan) & ~ground).sum() * plan.resolution_m**2 < 0.5


@pytest.mark.parametrize("turn", [0, 30])
def test_a_courtyard_within_walls_is_inside(turn):
    """The same with walls all around the ground: it may be a hall, and is said to be neither."""
    assert not outside_of(house_on_ground(turn, beyond=OCCUPIED)[0]).any()


@pytest.mark.parametrize("pixels", [1, 3, 8])
def test_a_frame_of_unknown_hides_nothing(pixels):
    plan, paper = on_paper(0.9)
    cells = plan.occupancy.copy()
    framed = np.pad(cells, pixels, constant_values=UNKNOWN)
    found = outside_of(replace(plan, occupancy=framed))
    np.testing.assert_array_equal(found[pixels:-pixels, pixels:-pixels][paper], True)


def test_maps_without_walls_have_no_outside():
    """Free and unknown only, as a robot without a map of its walls has: a hall with a closet is no house on paper."""
    cells = np.full((200, 240), UNKNOWN, np.uint8)
    cells[10:-10, 10:-10] = FREE
    cells[80:140, 80:140] = UNKNOWN
    cells[85:135, 85:135] = FREE
    assert not outside_of(FloorPlan(occupancy=cells, resolution_m=0.05)).any()


def test_outside_counts_nowhere(caplog):
    """Area, receivers and the floor that is to be seen are those of the house, though its door is open; said once."""
    plan, ground = house_on_ground()
    with caplog.at_level(logging.WARNING):
        building = make_building(plan)
        places = reach(building, 0.1)
        grid = receiver_grid(building, 0.25, 1.5)
        random_transmitters(building, 5, 1.5, np.random.default_rng(0))
    assert caplog.text.count("m2 of free space around the building") == 1
    assert building.indoor_m2 == pytest.approx((plan.free & ~ground).sum() * plan.resolution_m**2, abs=0.3)
    column, row = np.floor(plan.to_cells(grid.position[:, :2])).astype(int).T
    assert not ground[row, column].any() and len(grid.position) == pytest.approx(
        building.indoor_m2 / 0.25**2, rel=0.1
    )
    part = places.part_at(np.array([*places.plan.centres(places.indoors)[0]]))
    assert not (places.swept(part) & ground).any()
    assert (places.swept(part) & ~outside_of(plan)).sum() > 0.9 * (plan.free & ~outside_of(plan)).sum()
