"""Cells in polygons and cells that surfaces reach into, judged by shapely, by areas, and by a sphere's radius."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
import trimesh

from robosim.plans.formats.raster import MARGIN, Windings, Work, cells_touched, section, winding_numbers


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


SHAPE = (12, 15)


def boxes(grown):
    iy, ix = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return shapely.box(ix - grown, iy - grown, ix + 1 + grown, iy + 1 + grown)


def cut_by_shapely(triangle, low, high):
    """What two planes leave of a triangle, seen from above: a band of a right triangle, mapped."""
    origin, sides = triangle[0], triangle[1:] - triangle[0]
    slope = sides[:, 2]
    along, across = slope / (slope @ slope), 1e3 * np.array([-slope[1], slope[0]]) / np.linalg.norm(slope)
    ends = [along * (height - origin[2]) for height in (low, high)]
    band = shapely.Polygon([ends[0] - across, ends[1] - across, ends[1] + across, ends[0] + across])
    part = shapely.get_coordinates(shapely.intersection(shapely.Polygon([(0, 0), (1, 0), (0, 1)]), band))
    return shapely.convex_hull(shapely.MultiPoint(origin[:2] + part @ sides[:, :2]))


def random_triangles(kind, rng):
    triangles = rng.uniform(-3, 17, (100, 3, 3)) * (1, 1, 0.2)
    if kind == "small":
        triangles = triangles[:, :1] + rng.uniform(-0.4, 0.4, (100, 3, 3))
    if kind == "sliver":
        triangles[:, 2] = (triangles[:, 0] + triangles[:, 1]) / 2 + 1e-9
    if kind == "wall":
        triangles[:, 2] = triangles[:, 1] + rng.uniform(0.5, 2, (100, 1)) * (0, 0, 1)
    return triangles


@pytest.mark.parametrize("kind", ["large", "small", "sliver", "wall"])
def test_cells_are_those_that_the_cut_triangle_overlaps(kind):
    """No cell is missed that a triangle enters by 4 margins, none is marked that lies 3 margins off it."""
    rng = np.random.default_rng(5)
    low, high = 0.5, 1.7
    n_seen = 0
    for triangle in random_triangles(kind, rng):
        got = cells_touched(triangle[None], low, high, SHAPE)
        if triangle[:, 2].max() < low or triangle[:, 2].min() > high:
            assert not got.any()
            continue
        polygon = cut_by_shapely(triangle, low, high)
        surely, at_most = (shapely.intersects(boxes(grown * MARGIN), polygon) for grown in (-4, 3))
        assert got[surely].all()
        assert at_most[got].all()
        n_seen += surely.any()
    assert n_seen >= 20


def test_many_triangles_at_once_are_the_union_of_each():
    triangles = random_triangles("large", np.random.default_rng(6))
    each = [cells_touched(triangle[None], 0.5, 1.7, SHAPE) for triangle in triangles]
    np.testing.assert_array_equal(cells_touched(triangles, 0.5, 1.7, SHAPE), np.any(each, axis=0))


def wall(start, end):
    """Upright rectangle from the floor to height 3; its front is on the right, going from start to end."""
    a, b = (*start, 0.0), (*end, 0.0)
    c, d = (*end, 3.0), (*start, 3.0)
    return np.array([[a, b, c], [a, c, d]])


def cells(mask):
    return {(int(ix), int(iy)) for iy, ix in np.argwhere(mask)}


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_walls_on_grid_lines_mark_the_cells_behind_them(noise):
    """Each wall, parallel to an axis, marks its length and one cell of thickness; corners do not stick out.

    With a noise of a thousandth of a cell, as 32-bit coordinates have, the same.
    """
    ends = {
        ((3, 5), (8, 5)): {(x, 5) for x in range(3, 8)},  # the front faces down
        ((8, 5), (3, 5)): {(x, 4) for x in range(3, 8)},
        ((3, 5), (3, 9)): {(2, y) for y in range(5, 9)},  # the front faces right
        ((3, 9), (3, 5)): {(3, y) for y in range(5, 9)},
    }
    rng = np.random.default_rng(0)
    for (start, end), expected in ends.items():
        triangles = wall(start, end)
        triangles = triangles + noise * rng.uniform(-1, 1, triangles.shape) * (1, 1, 0)
        assert cells(cells_touched(triangles, 0.5, 1.7, SHAPE)) == expected


def test_walls_between_grid_lines_mark_the_cells_they_stand_in():
    assert cells(cells_touched(wall((3, 5.5), (8, 5.5)), 0.5, 1.7, SHAPE)) == {(x, 5) for x in range(3, 8)}
    diagonal = cells(cells_touched(wall((2.0, 2.0), (6.0, 6.0)), 0.5, 1.7, SHAPE))
    assert {(i, i) for i in range(2, 6)} <= diagonal <= {(i + j, i) for i in range(2, 6) for j in (-1, 0, 1)}


@pytest.mark.parametrize(
    ("triangle", "expected"),
    [
        ([[4.5, 4.5, 1.0]] * 3, {(4, 4)}),
        ([[4.5, 4.5, 0.0], [4.5, 4.5, 3.0], [4.5, 4.5, 1.0]], {(4, 4)}),
        ([[1.0, 1.0, 1.0], [4.0, 1.0, 1.0], [1.0, 3.0, 1.0]], {(1, 1), (2, 1), (3, 1), (1, 2), (2, 2)}),
        ([[4.5, 4.5, 1.7], [4.6, 4.5, 2.0], [4.5, 4.6, 2.0]], {(4, 4)}),
        ([[4.5, 4.5, 1.71], [4.6, 4.5, 2.0], [4.5, 4.6, 2.0]], set()),
        ([[4.5, 4.5, 0.0], [4.6, 4.5, 0.2], [4.5, 4.6, 0.4]], set()),
        ([[-4.5, 4.5, 1.0], [-4.6, 4.5, 1.0], [-4.5, 4.6, 1.0]], set()),
        ([[1e30, 4.5, 1.0], [-1e30, 4.5, 1.0], [0.0, 4.5, 1.0]], {(x, 4) for x in range(15)}),
    ],
)
def test_points_lines_table_tops_and_giants(triangle, expected):
    """Triangles without area count like others; one that only touches a height counts; outside does not."""
    assert cells(cells_touched(np.array([triangle]), 0.5, 1.7, SHAPE)) == expected


def test_sections_go_around_the_inside_of_solids():
    """A sphere of radius 5 cut at height 3 gives a disc of radius 4; the centres it holds, by its radius."""
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=5.0)
    triangles = sphere.triangles + np.array([7.0, 6.0, 0.0])
    start, end = section(triangles, 3.0)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    distance = np.hypot(x - 7, y - 6)
    sure = abs(distance - 4) > 0.02
    got = winding_numbers(start, end, SHAPE)
    np.testing.assert_array_equal(got[sure], (distance < 4)[sure])
    np.testing.assert_array_equal(winding_numbers(*section(triangles[:, ::-1], 3.0), SHAPE), -got)
