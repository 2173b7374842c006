"""Starts and targets: reachable, far enough apart, and explained when they are not."""

import re

import numpy as np
import pytest
import shapely

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.plans.floorplan import MapError
from robosim.task.tasks import ARRIVAL_M, make_task
from tests.plans import room, two_rooms


@pytest.fixture(scope="module")
def joined():
    return reach(make_building(two_rooms(0.5)), 0.1)


@pytest.fixture(scope="module")
def apart():
    return reach(make_building(two_rooms(0.1)), 0.1)


@pytest.mark.parametrize("seed", range(20))
def test_drawn_tasks_can_be_driven(apart, seed):
    """Start and target lie in one part, 3 m of driving apart where a part is that large (diagonal 4 m)."""
    task = make_task(apart, np.random.default_rng(seed))
    assert apart.part_at(task.start[:2]) == apart.part_at(task.target) > 0
    assert task.shortest_m >= 3.0 - ARRIVAL_M
    assert np.hypot(*(task.start[:2] - task.target)) <= task.shortest_m + ARRIVAL_M + 0.05


@pytest.mark.parametrize("seed", range(20))
def test_a_robot_begins_with_room_to_turn(joined, seed):
    """10 cm more than its hull of 0.1 m; in a corridor of 0.28 m x 5 m, where there is no such place, it begins too."""
    start = make_task(joined, np.random.default_rng(seed)).start
    assert joined.free.boundary.distance(shapely.Point(start[:2])) >= 0.2 - 1e-9
    narrow = reach(make_building(room(5.0, 0.3)), 0.1)
    assert make_task(narrow, np.random.default_rng(seed)).shortest_m >= 3.0 - ARRIVAL_M


def test_one_seed_gives_one_task(joined):
    first, second = (make_task(joined, np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(first.start, second.start)
    assert np.array_equal(first.target, second.target)


def test_what_is_given_is_stored(joined):
    """A straight task of 2 m: 1.7 m to the arrival radius; arrays that are written again do not move its ends."""
    start, target = np.array([0.525, 1.525, 0.3]), np.array([2.525, 1.525])
    task = make_task(joined, np.random.default_rng(0), start=start, target=target)
    start[:], target[:] = 0.0, 9.0
    assert task.start.tolist() == [0.525, 1.525, 0.3]
    assert task.target.tolist() == [2.525, 1.525]
    assert task.shortest_m == pytest.approx(1.7, abs=0.03)


def test_a_missing_end_is_drawn_far_from_the_given_one(joined):
    start, target = np.array([0.5, 1.5, 0.3]), np.array([5.5, 1.5])
    drawn = make_task(joined, np.random.default_rng(0), start=start)
    assert drawn.shortest_m >= 3 - ARRIVAL_M
    assert np.array_equal(drawn.start, start)
    assert np.array_equal(make_task(joined, np.random.default_rng(0), target=target).target, target)


def test_a_small_room_gives_its_longest_task(caplog):
    """A room of 1 m x 1 m has no 3 m: the farthest pair is taken and said."""
    small = reach(make_building(room(1.0, 1.0)), 0.1)
    task = make_task(small, np.random.default_rng(0))
    assert 0.3 < task.shortest_m < 1.2
    assert "no two places 3.0 m of path apart" in caplog.text


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"start": np.array([0.02, 1.0, 0.0])}, "does not fit at the start"),
        ({"start": np.array([-9.0, 1.0, 0.0])}, "does not fit at the start"),
        (
            {"target": np.array([50.0, 1.0])},
            r"the target \(50, 1\) m is in a wall, or outside of the building",
        ),
        ({"target": np.array([3.1, 0.5])}, r"the target \(3.1, 0.5\) m is in a wall"),
        ({"start": np.array([1.0, 1.0, 0.0]), "target": np.array([5.0, 1.0])}, "no path for a hull"),
    ],
)
def test_impossible_tasks_say_why(apart, given, message):
    with pytest.raises(MapError, match=message):
        make_task(apart, np.random.default_rng(0), **given)


def test_a_target_in_a_nook_is_too_far_from_any_place_of_the_hull():
    """Both rooms are free, but in a gap of 0.1 m next to a door of 0.1 m no hull of 0.5 m comes near."""
    wide = reach(make_building(two_rooms(0.1, wall_m=1.0)), 0.4)
    with pytest.raises(MapError, match=r"cannot come within 0\.3 m of the target"):
        make_task(wide, np.random.default_rng(0), target=np.array([3.5, 1.5]))


@pytest.mark.parametrize(
    "given",
    [
        {"target": np.array([3.1, 0.5])},
        {"target": np.array([-4.0, 9.0])},
        {"start": np.array([3.1, 0.5, 0.0])},
        {"start": np.array([0.02, 2.99, 0.0])},
    ],
)
def test_the_place_that_is_named_will_do(joined, given):
    """Taken from the message, as a person would, to the centimetre."""
    with pytest.raises(MapError) as rejected:
        make_task(joined, np.random.default_rng(0), **given)
    x, y = (float(v) for v in re.findall(r"can be is \((-?[\d.]+), (-?[\d.]+)\)", str(rejected.value))[0])
    (what,) = given
    better = np.array([x, y, 0.0]) if what == "start" else np.array([x, y])
    make_task(joined, np.random.default_rng(0), **{what: better})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"start": np.array([1.0, 1.0, 1e300])},
            "yaw of the start is 1e.300, expected -6.28319 to 6.28319 rad",
        ),
        ({"start": np.array([1.0, np.nan, 0.0])}, "start is .*nan.*, expected 3 numbers"),
        ({"target": np.array([np.inf, 1.0])}, "target is .*inf.*, expected 2 numbers"),
    ],
)
def test_what_is_no_place_is_rejected(joined, given, message):
    with pytest.raises(ValueError, match=message):
        make_task(joined, np.random.default_rng(0), **given)


def test_a_hull_that_fits_nowhere_is_an_error():
    with pytest.raises(MapError, match="fits nowhere"):
        make_task(reach(make_building(room(0.5, 0.5)), 0.3), np.random.default_rng(0))


def test_targets_between_the_centres_of_coarse_cells_are_reached():
    """Cells of 0.5 m: their corners are 0.35 m from the nearest centres."""
    coarse = reach(make_building(room(6.0, 6.0, 0.5)), 0.1)
    task = make_task(
        coarse, np.random.default_rng(0), start=np.array([1.25, 3.25, 0.0]), target=np.array([4.0, 3.0])
    )
    assert task.shortest_m == pytest.approx(2.5, abs=0.01)
