"""Where a hull fits, how far it drives, what it cannot enter."""

import tracemalloc

import numpy as np
import pytest
import shapely
from scipy import ndimage

from robosim.building.building import make_building
from robosim.building.reach import HEADINGS, reach
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from slam.poses import to_map
from tests.plans import room, two_rooms


def test_the_hull_keeps_its_radius_from_the_walls():
    """In a 4 m x 3 m room a disk of radius r can be in (4 - 2r)(3 - 2r) m2, up to the cells on the rim.

    Cell centres lie at odd multiples of 2.5 cm; with r = 0.18 m those from 0.225 m on count: 3.6 m x 2.6 m.
    """
    places = reach(make_building(room()), 0.18)
    assert places.n_parts == 1
    assert (places.parts > 0).sum() * 0.05**2 == pytest.approx(3.6 * 2.6)


@pytest.mark.parametrize(("door_m", "parts"), [(0.2, 2), (0.5, 1)])
def test_a_door_joins_rooms_only_if_the_hull_passes(door_m, parts):
    """A hull 0.36 m wide passes a door of 0.5 m and not one of 0.2 m."""
    places = reach(make_building(two_rooms(door_m)), 0.18)
    assert places.n_parts == parts


def test_a_room_behind_a_narrow_door_is_reported():
    """Seen from the left room, the 9 m2 of the right one are cut off, around its middle (4.7, 1.5)."""
    places = reach(make_building(two_rooms(0.2)), 0.18)
    (lost,) = places.cut_off(places.part_at(np.array([1.0, 1.5])))
    assert lost.area_m2 == pytest.approx(9.0, abs=0.5)
    assert np.hypot(*(lost.centre - (4.7, 1.5))) < 0.1
    joined = reach(make_building(two_rooms(0.5)), 0.18)
    assert joined.cut_off(1) == []


def test_travel_in_the_open_is_the_straight_distance():
    """Fast marching of second order on an empty floor: |p - q| within half a cell."""
    places = reach(make_building(room()), 0.1)
    source = np.array([0.525, 0.525])
    travel = places.travel_m(source)
    inside = places.parts > 0
    straight = np.hypot(*(places.plan.centres(inside) - source).T)
    assert np.abs(travel[inside] - straight).max() < 0.025
    assert np.isinf(travel[~inside]).all()


def test_travel_round_a_corner_is_the_taut_string():
    """Through the door of two rooms: two straight legs and an arc of the hull's radius about the jambs."""
    places = reach(make_building(two_rooms(0.5)), 0.18)
    travel = places.travel_m(np.array([0.525, 0.525]))
    got = places.remaining_m(travel, np.array([5.675, 0.525]))
    corner, r = np.array([3.0 - 0.525, 1.25 - 0.525]), 0.18
    reach_m = np.hypot(*corner)
    leg = np.sqrt(reach_m**2 - r**2)
    slope = np.arctan2(corner[1], corner[0]) + np.arcsin(r / reach_m)
    assert got == pytest.approx(2 * leg + 2 * r * slope + 0.2, abs=0.1)


def test_remaining_path_is_continuous_between_cells():
    """Moving by 1 cm changes the path length by at most 1 cm and a little: no steps of a cell."""
    places = reach(make_building(room()), 0.1)
    travel = places.travel_m(np.array([0.5, 0.5]))
    line = np.column_stack([np.arange(1.0, 3.0, 0.01), np.full(200, 1.33)])
    lengths = np.array([places.remaining_m(travel, p) for p in line])
    assert np.abs(np.diff(lengths)).max() < 0.012


def test_the_remaining_path_is_a_number_where_the_sampling_has_closed_a_passage():
    """A dead end 0.25 m wide between walls through cell centres: no centre has the hull's 0.1 m for it there."""
    occupancy = np.full((80, 120), OCCUPIED, np.uint8)
    occupancy[10:70, 5:70] = FREE
    occupancy[40:46, 70:115] = FREE
    plan = FloorPlan(occupancy=occupancy, resolution_m=0.05, wall_line="cell_centre")
    places = reach(make_building(plan), 0.1)
    travel = places.travel_m(np.array([0.6, 1.0]))
    line = np.column_stack([np.arange(3.0, 5.5, 0.01), np.full(250, 2.15)])
    lengths = np.array([places.remaining_m(travel, point) for point in line])
    assert np.diff(lengths) == pytest.approx(0.01, abs=0.012)
    assert places.remaining_m(np.full(plan.shape, np.inf), line[0]) == np.inf


@pytest.mark.parametrize("point", [(1.0, 1.5), (3.05, 0.2), (-7.0, 40.0), (900.0, -3.0)])
def test_places_outside_count_from_the_nearest_cell(point):
    """Of all cells of the parts, by brute force; from within, from a wall, and from far outside of the plan."""
    places = reach(make_building(two_rooms(0.2)), 0.18)
    inside = places.parts > 0
    gap = np.hypot(*(places.plan.centres(inside) - point).T)
    nearest = int(gap.argmin())
    assert places.part_near(np.array(point), gap[nearest] + 1e-6) == places.parts[inside][nearest]
    assert places.part_near(np.array(point), gap[nearest] - 1e-6) == 0
    assert places.travel_m(np.array(point))[inside][nearest] == 0.0


def test_a_radius_must_be_positive():
    with pytest.raises(ValueError, match="radius_m is 0"):
        reach(make_building(room()), 0.0)


def pillars(seed: int = 3) -> FloorPlan:
    """A room of 6 m x 5 m with walls around it and 45 pillars."""
    occupancy = np.full((102, 122), OCCUPIED, np.uint8)
    occupancy[1:-1, 1:-1] = FREE
    for row, column in np.random.default_rng(seed).integers(2, 95, (45, 2)):
        occupancy[row : row + 5, column : column + 7] = OCCUPIED
    return FloorPlan(occupancy=occupancy, resolution_m=0.05, origin=(1.0, -2.0, 0.3), name="pillars")


@pytest.mark.parametrize("radius_m", [0.05, 0.18, 0.4])
def test_reach_agrees_with_point_in_polygon_at_every_cell(radius_m):
    """Judge: shapely for the centre of each cell; most cells are never compared with the floor's edge."""
    building = make_building(pillars())
    places, cells = reach(building, radius_m), building.plan.free
    expected = np.zeros(cells.shape, bool)
    expected[cells] = shapely.contains_xy(building.free.buffer(-radius_m), building.plan.centres(cells))
    assert ((places.parts > 0) == expected).all()


def test_reach_of_an_outline_agrees_with_labels_over_all_headings():
    """Judge: one array of all places and headings, its last heading next to the first."""
    building, plan = make_building(pillars()), pillars()
    outline = ((0.25, 0.1), (-0.25, 0.1), (-0.25, -0.1), (0.25, -0.1))
    places = reach(building, 0.1, outline_m=outline)
    cells = np.argwhere(plan.free)
    centres = plan.centres(plan.free)
    fits = np.zeros((HEADINGS, *plan.shape), bool)
    shapely.prepare(building.free)
    for k, yaw in enumerate(np.arange(HEADINGS) * 2 * np.pi / HEADINGS):
        hulls = to_map(np.array([0.0, 0.0, yaw]), np.array(outline)) + centres[:, None]
        fits[k, cells[:, 0], cells[:, 1]] = shapely.covers(building.free, shapely.polygons(hulls))
    assert ((places.parts > 0) == fits.any(axis=0)).all()
    labels, _ = ndimage.label(np.concatenate([fits, fits[:1]]))
    sizes = np.bincount(labels[:-1].ravel())
    largest = labels == 1 + int(np.argmax(sizes[1:]))
    assert ((places.parts == 1) >= largest.any(axis=0)).all()
    assert places.n_parts > 1


def test_reach_takes_some_bytes_for_each_cell():
    """Places and travel over 3.2 million cells: below 38 bytes each at the peak (41 with a copy of the costs)."""
    occupancy = np.full((1600, 2000), FREE, np.uint8)
    occupancy[[0, -1]] = occupancy[:, [0, -1]] = OCCUPIED
    building = make_building(FloorPlan(occupancy=occupancy, resolution_m=0.05, name="hall"))
    tracemalloc.start()
    places = reach(building, 0.18)
    travel = places.travel_m(np.array([50.0, 40.0]))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 38 * occupancy.size
    assert travel[800, 1] == np.inf
    assert travel[800, 100] == pytest.approx(50 - 5.025, abs=0.1)
