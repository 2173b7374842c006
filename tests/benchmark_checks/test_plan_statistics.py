"""Statistics of plans, judged by closed forms, by GEOS, and by what must not change them."""

from dataclasses import asdict

import numpy as np
import pytest
import shapely

from robosim.generator.canvas import Canvas, Rect
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from tests.benchmarks.plan_statistics import ks_distance, perimeter_m, plan_statistics
from tests.benchmarks.rooms import clearance, find_rooms

CELL_M = 0.05


def plan_of(free: np.ndarray, wall_line: str = "cell_edge", resolution_m: float = CELL_M) -> FloorPlan:
    occupancy = np.where(free, FREE, OCCUPIED).astype(np.uint8)
    return FloorPlan(occupancy=occupancy, resolution_m=resolution_m, wall_line=wall_line)


def painted(*rects: Rect, yaw: float = 0.0, solid: tuple[Rect, ...] = ()) -> FloorPlan:
    """A plan whose floor is the union of rectangles [m], less some others, turned by an angle."""
    corners = np.vstack([rect.polygon() for rect in rects])
    canvas = Canvas(Rect(*corners.min(axis=0), *corners.max(axis=0)), yaw, CELL_M)
    for rect in rects:
        canvas.paint(rect.polygon(), free=True)
    for rect in solid:
        canvas.paint(rect.polygon(), free=False)
    return plan_of(canvas.free)


def two_rooms(door_m: float, yaw: float = 0.0) -> FloorPlan:
    """Two rooms of 4 m by 3 m with a wall of 0.2 m between them and one door in it."""
    door = Rect(3.9, 1.0, 4.3, 1.0 + door_m)
    return painted(Rect(0, 0, 4, 3), Rect(4.2, 0, 8.2, 3), door, yaw=yaw)


@pytest.mark.parametrize("yaw_deg", [0, 10, 22.5, 33, 45, 71])
def test_perimeter_does_not_depend_on_the_angle(yaw_deg: float):
    """A 6 m by 4 m floor with a 2 m by 1 m hole has 26 m of wall at every angle."""
    plan = painted(Rect(0, 0, 6, 4), yaw=np.radians(yaw_deg), solid=(Rect(2, 1, 4, 2),))
    assert perimeter_m(plan.free, CELL_M) == pytest.approx(26, rel=0.03)


@pytest.mark.parametrize("radius_m", [0.5, 3.0])
def test_perimeter_of_a_disk(radius_m: float):
    """2 pi r, within 2 %."""
    y, x = np.mgrid[-80:80, -80:80] * CELL_M + CELL_M / 2
    assert perimeter_m(np.hypot(x, y) < radius_m, CELL_M) == pytest.approx(2 * np.pi * radius_m, rel=0.02)


@pytest.mark.parametrize("cells", [1, 2, 7, 8])
def test_clearance_of_a_corridor_is_half_its_width(cells: int):
    """Exact for odd and even numbers of cells; between cell centres a corridor is one cell narrower.

    A distance transform between cell centres is half a cell or a whole one off, by parity.
    """
    free = np.zeros((cells + 4, 60), bool)
    free[2:-2, 2:-2] = True
    across = clearance(plan_of(free))[2:-2, 30] / CELL_M
    assert across == pytest.approx(
        np.minimum(np.minimum(np.arange(1, cells + 1), np.arange(cells, 0, -1)), cells / 2)
    )
    between_centres = 2 * clearance(plan_of(free, "cell_centre")).max()
    assert between_centres == pytest.approx((cells - 1) * CELL_M, abs=1e-9)


@pytest.mark.parametrize("door_cells", [9, 14, 15, 20])
def test_a_door_divides_two_rooms_and_has_its_width(door_cells: int):
    """Two rooms, one passage, its width exact; the hull needs the door, so the bottleneck is the door."""
    found = find_rooms(two_rooms(door_cells * CELL_M), 0.18)
    assert found.count == 2
    assert found.width_m == pytest.approx([door_cells * CELL_M])
    assert found.bottleneck_m == pytest.approx(door_cells * CELL_M)


@pytest.mark.parametrize("yaw_deg", [7, 30, 45])
def test_a_turned_door_has_its_width(yaw_deg: float):
    """A door of 0.8 m in a building at an angle, within one cell and a half."""
    found = find_rooms(two_rooms(0.8, np.radians(yaw_deg)), 0.18)
    assert found.count == 2
    assert found.width_m == pytest.approx([0.8], abs=1.5 * CELL_M)


def test_the_bottleneck_can_be_avoided_by_going_round():
    """Three rooms in a ring with doors of 0.5, 0.75 and 1.0 m: one need not go through the narrowest."""
    rooms = (Rect(0, 0, 8.2, 3), Rect(0, 3.2, 4, 6), Rect(4.2, 3.2, 8.2, 6))
    doors = (Rect(1, 2.9, 1.75, 3.3), Rect(5, 2.9, 6, 3.3), Rect(3.9, 4.5, 4.3, 5.0))
    found = find_rooms(painted(*rooms, *doors), 0.18)
    assert found.count == 3
    assert np.sort(found.width_m) == pytest.approx([0.5, 0.75, 1.0])
    assert found.bottleneck_m == pytest.approx(0.75)


def test_a_table_does_not_divide_a_room():
    """A table across a room with 0.5 m on either side is looked through; a wall with such gaps is not.

    Watershed of the plain clearance makes two rooms of both.
    """
    room = Rect(0, 0, 6, 2.4)
    assert find_rooms(painted(room, solid=(Rect(2, 0.5, 4, 1.9),)), 0.18).count == 1
    hall = Rect(0, 0, 8.2, 5)
    wall = find_rooms(painted(hall, solid=(Rect(4, 0.5, 4.2, 4.5),)), 0.18)
    assert wall.count == 2
    assert wall.width_m == pytest.approx([0.5, 0.5])


def test_rooms_behind_too_narrow_doors_do_not_count():
    """A hull of 0.5 m in front of a door of 0.45 m sees one room; one that fits nowhere is an error."""
    assert find_rooms(two_rooms(0.45), 0.25).count == 1
    assert find_rooms(two_rooms(0.45), 0.2).count == 2
    with pytest.raises(ValueError, match=r"hull_radius_m = 2, expected a hull that fits"):
        find_rooms(two_rooms(0.45), 2.0)


def test_one_sees_all_of_a_convex_room():
    """From everywhere in a rectangle all of it is seen (within 3 %) and all routes are straight (within 2 %)."""
    stats = plan_statistics(painted(Rect(0, 0, 6, 4), yaw=0.4), 0.18)
    assert stats.visible_share == pytest.approx(1, abs=0.03)
    assert stats.detour == pytest.approx(1, abs=0.02)
    assert (stats.rooms, stats.things_per_10_m2) == (1, 0)
    assert stats.free_area_m2 == pytest.approx(24, rel=0.01)


def test_the_visible_share_is_how_often_two_points_see_each_other():
    """By symmetry the mean isovist is the chance that a random pair is joined by a free segment.

    GEOS judges 4000 pairs on two rooms with a door (about 0.6; standard error 0.008). Bound 0.035.
    """
    floor = shapely.union_all(
        [shapely.box(0, 0, 4, 3), shapely.box(4.2, 0, 8.2, 3), shapely.box(3.9, 1, 4.3, 1.8)]
    )
    rng = np.random.default_rng(1)
    points = rng.uniform((0, 0), (8.2, 3), (12000, 2))
    points = points[shapely.contains_xy(floor, points)][:8000]
    seen = shapely.covers(floor, shapely.linestrings(points.reshape(-1, 2, 2))).mean()
    assert plan_statistics(two_rooms(0.8), 0.18).visible_share == pytest.approx(seen, abs=0.035)


def test_mean_clearance_of_a_strip():
    """A corridor of width w: the mean distance from its long walls is w / 4, the ends aside.

    The best point of each cell, not its centre, counts: up to half a cell more.
    """
    stats = plan_statistics(painted(Rect(0, 0, 20, 2)), 0.18)
    assert 0.48 < stats.clearance_m < 0.5 + CELL_M / 2


@pytest.mark.parametrize("wall_line", ["cell_edge", "cell_centre"])
def test_statistics_do_not_depend_on_turning_or_mirroring(wall_line: str):
    """By a quarter turn and a mirror image all stay as they are, but for the places chosen for sight."""
    rooms = (Rect(0, 0, 5, 3), Rect(5.2, 0, 8.2, 6), Rect(4.9, 1, 5.3, 1.8))
    plan = painted(*rooms, yaw=0.3, solid=(Rect(6, 3, 7, 4),))
    free = plan.free
    first = asdict(plan_statistics(plan_of(free, wall_line), 0.18))
    turned = asdict(plan_statistics(plan_of(np.rot90(free).copy(), wall_line), 0.18))
    mirrored = asdict(plan_statistics(plan_of(free[:, ::-1].copy(), wall_line), 0.18))
    assert first["things_per_10_m2"] > 0
    for other in (turned, mirrored):
        for name in ("free_area_m2", "rooms", "wall_per_area_m", "clearance_m", "things_per_10_m2"):
            assert other[name] == pytest.approx(first[name], rel=1e-6), name
        assert other["bottleneck_m"] == pytest.approx(first["bottleneck_m"], abs=CELL_M)
        assert other["visible_share"] == pytest.approx(first["visible_share"], rel=0.1)
        assert other["detour"] == pytest.approx(first["detour"], rel=0.05)


def test_scale_keeps_shapes():
    """Cells of twice the size: four times the area, half the wall per area, doors of twice the width."""
    free = two_rooms(0.8).free
    small = plan_statistics(plan_of(free), 0.18)
    large = plan_statistics(plan_of(free, resolution_m=2 * CELL_M), 0.36)
    assert large.free_area_m2 == pytest.approx(4 * small.free_area_m2)
    assert large.wall_per_area_m == pytest.approx(small.wall_per_area_m / 2)
    assert large.visible_share == pytest.approx(small.visible_share)
    assert large.passage_widths_m == pytest.approx([1.6])


def test_distance_of_distributions():
    """Uniform samples shifted by 0.3 of their range are 0.3 apart; one room (infinity) is a value too."""
    sample = np.linspace(0, 1, 1001)
    assert ks_distance(sample, sample + 0.3) == pytest.approx(0.3, abs=0.002)
    assert ks_distance(sample, sample) == 0
    assert ks_distance(np.array([1.0, np.inf]), np.array([1.0, 1.0])) == pytest.approx(0.5)
