"""Straight walls under the steps of a raster: against the shapes that were drawn into it."""

import math

import numpy as np
import pytest
import shapely

from robosim.building.building import make_building
from robosim.plans.files import read_plan
from tests.benchmarks.trial_floors import turned
from tests.outlines import free_polygons
from tests.plans import plan_from, plan_of, ragged


def raster(shape, size=(300, 300)):
    """A plan of unit cells that are free where their centre is in a shape."""
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    return plan_from(shapely.contains_xy(shape, x, y))


def rotated(shape, degrees, shift=(0.0, 0.0)):
    return shapely.transform(
        shape,
        lambda xy: (
            (xy - 150)
            @ np.array(
                [
                    [math.cos(math.radians(degrees)), math.sin(math.radians(degrees))],
                    [-math.sin(math.radians(degrees)), math.cos(math.radians(degrees))],
                ]
            )
            + 150
            + shift
        ),
    )


def corners(polygons):
    return np.concatenate([shapely.get_coordinates(r)[:-1] for r in shapely.get_rings(polygons.geoms)])


@pytest.mark.parametrize("degrees", [2, 5, 12.5, 20, 30, 33.7, 45, 60, 71, 88])
@pytest.mark.parametrize("seed", range(4))
def test_turned_rectangles_come_back(degrees, seed):
    """A room of 120 x 80 cells at any angle: 4 to 8 corners, walls within half a cell, directions within 0.5 degrees.

    At 2 degrees walls of 80 cells have two or three steps, which give their direction to 0.5 degrees and no better.
    """
    shift = np.random.default_rng(seed).uniform(-1, 1, 2)
    room = rotated(shapely.box(90, 110, 210, 190), degrees, shift)
    plan = raster(room)
    exact, straight = free_polygons(plan, 0), free_polygons(plan)
    assert 4 <= len(corners(straight)) <= 8 < len(corners(exact))
    ring = straight.geoms[0].exterior
    assert shapely.hausdorff_distance(ring, room.exterior) < 1.5
    middles = shapely.line_interpolate_point(ring, np.linspace(0, 1, 400), normalized=True)
    assert np.quantile(shapely.distance(middles, room.exterior), 0.9) < 0.5
    ends = shapely.get_coordinates(ring)
    vector = np.diff(ends, axis=0)
    long = np.hypot(*vector.T) > 40
    assert long.sum() == 4
    heading = np.degrees(np.arctan2(vector[long, 1], vector[long, 0])) - degrees
    assert np.abs((heading + 45) % 90 - 45).max() < (0.5 if degrees > 2 else 1.0)


def test_round_rooms_become_polygons_within_half_a_cell():
    """A circle of radius 100: within half a cell of the circle but at corners, with far fewer corners than steps."""
    circle = shapely.Point(150.3, 149.6).buffer(100, quad_segs=256)
    plan = raster(circle)
    exact, straight = free_polygons(plan, 0), free_polygons(plan)
    assert len(corners(straight)) < len(corners(exact)) / 4
    gap = np.abs(np.hypot(*(corners(straight) - (150.3, 149.6)).T) - 100)
    assert np.median(gap) < 0.5 and gap.max() < 1.5
    assert straight.area == pytest.approx(circle.area, rel=2e-3)


@pytest.mark.parametrize(
    "rows",
    [
        ["............", "............", "............"],
        ["............", "............", "......######"],
        ["............", "......######", "......######"],
        ["....####....", "....####....", "............"],
        ["............", ".#..........", "............"],
        ["......##....", "............", "............", "..##........"],
    ],
    ids=["room", "single step", "corner", "niche", "post", "two niches"],
)
def test_walls_along_the_grid_and_corners_stay(rows):
    """Rooms, single steps, niches and posts are not staircases: nothing changes, the arrays are bit-identical."""
    plan = plan_of([row for row in rows for _ in range(3)])
    assert shapely.equals_exact(free_polygons(plan).normalize(), free_polygons(plan, 0).normalize())


@pytest.mark.parametrize("seed", range(40))
def test_noise_keeps_its_topology(seed):
    """Blobs with every awkward touching there is: valid, as many polygons and holes, no wall far off."""
    cells, origin = ragged(seed)
    plan = plan_from(cells, "cell_edge", 1.0, origin)
    exact, straight = free_polygons(plan, 0), free_polygons(plan)
    assert straight.is_valid, shapely.is_valid_reason(straight)
    assert len(straight.geoms) == len(exact.geoms)
    for old, new in zip(exact.geoms, straight.geoms, strict=True):
        assert len(old.interiors) == len(new.interiors)
        for before, after in zip(shapely.get_rings(old), shapely.get_rings(new), strict=True):
            assert shapely.hausdorff_distance(before, after) < 1.5
            assert before.is_ccw == after.is_ccw


@pytest.mark.parametrize("degrees", [0, 1, 7, 20, 45])
@pytest.mark.parametrize("name", ["flat", "office", "townhouse"])
def test_shipped_plans_have_fewer_walls_at_any_angle(name, degrees):
    """Valid, the same rooms, no wall more than a cell and a half off; the exact outline is not what comes back."""
    plan = turned(read_plan(name), degrees)
    exact, straight = free_polygons(plan, 0), free_polygons(plan)
    assert straight.is_valid and len(straight.geoms) == len(exact.geoms)
    assert len(corners(straight)) < 0.9 * len(corners(exact))
    assert shapely.hausdorff_distance(straight.boundary, exact.boundary) < 1.5 * plan.resolution_m
    y, x = np.nonzero(np.ones(plan.shape, bool))
    inside = shapely.contains_xy(straight, plan.centres(np.ones(plan.shape, bool)))
    assert (inside != plan.free[y, x]).mean() < 0.01


def test_buildings_are_made_of_straight_walls_and_published_grids_are_not():
    """The office has a sixth of its walls; walls through centres of cells stay as they are."""
    plan = read_plan("office")
    assert len(make_building(plan).walls_2d) < 1100
    cells, _ = ragged(3)
    grid = plan_from(cells, "cell_centre")
    assert shapely.equals(free_polygons(grid), free_polygons(grid, 0))
