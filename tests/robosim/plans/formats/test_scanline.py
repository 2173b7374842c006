"""Winding numbers, judged by shapely and by areas."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from robosim.plans.formats.scanline import Windings, Work, winding_numbers


def centres(shape):
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    return x, y


def test_simple_polygons_wind_once_around_what_shapely_holds_inside():
    """Star-shaped polygons about random points, in both directions and partly outside of the grid."""
    rng = np.random.default_rng(0)
    shape = (20, 30)
    for _ in range(30):
        angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
        if np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() > 3:
            continue
        radius = rng.uniform(2, 14, 9)
        corners = rng.uniform(0, 25, 2) + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        inside = shapely.contains_xy(shapely.Polygon(corners), *centres(shape))
        following = np.roll(corners, -1, axis=0)
        np.testing.assert_array_equal(winding_numbers(corners, following, shape), inside)
        np.testing.assert_array_equal(winding_numbers(following, corners, shape), -1 * inside)


def test_polygons_that_tile_a_square_cover_each_centre_once():
    """Corners and edges on the centres of cells belong to one tile only; a double count would show as 2."""
    rng = np.random.default_rng(1)
    cuts = np.sort(rng.integers(0, 21, (2, 6)) / 2.0, axis=1)
    x, y = (np.unique(np.concatenate([[0.0], c, [10.0]])) for c in cuts)
    triangles = []
    for x0, x1 in pairwise(x):
        for y0, y1 in pairwise(y):
            triangles += [[(x0, y0), (x1, y0), (x1, y1)], [(x0, y0), (x1, y1), (x0, y1)]]
    start = np.array(triangles)
    end = np.roll(start, -1, axis=1)
    got = winding_numbers(start.reshape(-1, 2), end.reshape(-1, 2), (10, 10))
    np.testing.assert_array_equal(got, 1)


def test_a_figure_of_eight_winds_in_both_directions():
    corners = np.array([[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]])
    got = winding_numbers(corners, np.roll(corners, -1, axis=0), (4, 4))
    assert got[0, 2] == got[3, 1] == 0  # below and above the crossing
    assert got[1, 0] == got[2, 0] == -got[1, 3] == -got[2, 3]
    assert abs(got[1, 0]) == 1


def test_parts_take_all_items_once_and_stay_small():
    counts = np.random.default_rng(2).integers(0, 150_000, 200)
    slices = list(Work().parts(counts))
    assert [i for part in slices for i in range(part.start, part.stop)] == list(range(200))
    assert all(counts[part].sum() <= 500_000 for part in slices)
    assert list(Work().parts(np.array([2_000_000, 1]))) == [slice(0, 1), slice(1, 2)]


def test_polygons_can_come_one_after_the_other():
    """The same as all at once; lost or double ones would show, since the two overlap."""
    corners = np.random.default_rng(3).uniform(0, 20, (2, 7, 2))
    following = np.roll(corners, -1, axis=1)
    windings = Windings((20, 20))
    for start, end in zip(corners, following, strict=True):
        windings.add(start, end)
    together = winding_numbers(corners.reshape(-1, 2), following.reshape(-1, 2), (20, 20))
    np.testing.assert_array_equal(windings.numbers(), together)


def test_more_rows_than_any_building_has_are_rejected_before_the_work():
    """A zigzag of 100,000 edges from top to bottom would take minutes; many short edges may be as many."""
    zigzag = np.column_stack([np.linspace(0, 5000, 100_000), np.arange(100_000) % 2 * 5000.0])
    with pytest.raises(ValueError, match="coarser resolution"):
        winding_numbers(zigzag, np.roll(zigzag, -1, axis=0), (5000, 5000))
    list(Work().parts(np.full(1_000_000, 25)))
