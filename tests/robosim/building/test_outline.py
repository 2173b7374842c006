"""Where free space ends: against cell counts, connected components and OpenCV's contours."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
import shapely

from robosim.plans.floorplan import MapError
from tests.outlines import free_polygons, wall_lines
from tests.plans import plan_from, plan_of, ragged

WALL_LINES = ["cell_edge", "cell_centre"]


def unit_steps(ring_cells):
    """Undirected steps from pixel to pixel along closed lines, how often each is walked."""
    walked = {}
    for ring in ring_cells:
        ring = np.round(ring).astype(int)
        for a, b in pairwise(ring):
            n = int(np.abs(b - a).max())
            pieces = [tuple(a + (b - a) * i // n) for i in range(n + 1)]
            for p, q in pairwise(pieces):
                key = (min(p, q), max(p, q))
                walked[key] = walked.get(key, 0) + 1
    return walked


def test_cell_edges_enclose_exactly_the_free_cells():
    """An L of five cells around an obstacle: corners written down by hand, hole included."""
    free = free_polygons(plan_of(["....", ".#..", "...#"], resolution_m=0.5, origin=(1.0, 2.0, 0.0)), 0)
    cells = shapely.Polygon(
        [(0, 0), (3, 0), (3, 1), (4, 1), (4, 3), (0, 3)], [[(1, 1), (1, 2), (2, 2), (2, 1)]]
    )
    want = shapely.MultiPolygon([shapely.transform(cells, lambda xy: xy * 0.5 + (1.0, 2.0))])
    assert shapely.equals_exact(free.normalize(), want.normalize())


@pytest.mark.parametrize("seed", range(40))
def test_outline_of_noise_is_valid_and_has_the_area_and_components_of_its_cells(seed):
    """Area = cells * cell area, one polygon for each 4-connected component; to 1e-9 m2.

    Catches wrong turns at corners where cells touch, and holes given to the wrong polygon.
    """
    cells, origin = ragged(seed)
    free = free_polygons(plan_from(cells, "cell_edge", 0.05, origin), 0)
    assert free.is_valid, shapely.is_valid_reason(free)
    assert free.area == pytest.approx(cells.sum() * 0.05**2, abs=1e-9)
    assert len(free.geoms) == cv2.connectedComponents(cells.astype(np.uint8), connectivity=4)[0] - 1


@pytest.mark.parametrize("seed", range(5))
def test_outline_covers_free_cells_and_no_others(seed):
    """The centre of a cell lies inside exactly when the cell is free, under any yaw of the plan."""
    cells, origin = ragged(seed)
    plan = plan_from(cells, "cell_edge", 0.05, origin)
    inside = shapely.contains_xy(free_polygons(plan, 0), plan.centres(np.ones_like(cells)))
    assert (inside == cells.ravel()).all()


def test_cells_that_touch_by_a_corner_are_not_connected():
    """No path leads through a corner: two polygons that share one point, which OGC allows."""
    free = free_polygons(plan_of(["#.", ".#"]), 0)
    assert len(free.geoms) == 2 and free.is_valid
    assert shapely.intersection(*free.geoms).equals(shapely.Point(1, 1))


@pytest.mark.parametrize("rows", [["....", ".#..", "..#.", "...."], ["...", ".#.", "..#"]])
def test_obstacles_that_touch_by_a_corner_leave_simple_rings(rows):
    """Rings that pass the shared corner twice would be invalid; one component stays one polygon."""
    free = free_polygons(plan_of(rows), 0)
    assert len(free.geoms) == 1 and free.is_valid
    assert all(ring.is_simple for ring in shapely.get_rings(free.geoms))
    assert free.area == sum(row.count(".") for row in rows)


def test_outline_has_corners_only():
    """A straight wall over 30 cells has two ends: 4 corners around a rectangle, whatever its length."""
    assert shapely.get_num_coordinates(free_polygons(plan_from(np.ones((7, 30), bool)), 0)) == 5


@pytest.mark.parametrize("wall_line", WALL_LINES)
def test_free_space_lies_on_the_left_of_walls(wall_line):
    """Outer rings counter-clockwise, holes clockwise; extruded walls get their normals from it."""
    free = free_polygons(plan_of([".....", ".....", "..#..", ".....", "....."], wall_line), 0)
    assert free.geoms[0].exterior.is_ccw
    assert not free.geoms[0].interiors[0].is_ccw


@pytest.mark.parametrize("seed", range(20))
def test_centre_lines_are_opencvs_contours(seed):
    """The set of lines equals cv2.findContours of the image itself; centres at half cells, no single cells.

    OpenCV is asked about the image with its rows downwards, as the published grids have them: the same lines,
    which shows that flipping the image changes nothing.
    """
    cells, _ = ragged(seed)
    got = unit_steps([line - 0.5 for line in wall_lines(plan_from(cells, "cell_centre"), 0)])
    image = np.pad(cells[::-1], 1).astype(np.uint8)
    lines, _ = cv2.findContours(image, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    lines = [np.vstack([line[:, 0], line[:1, 0]]) for line in lines if len(line) > 1]
    want = unit_steps([np.column_stack([line[:, 0] - 1, len(cells) - line[:, 1]]) for line in lines])
    assert got == want


@pytest.mark.parametrize("seed", range(40))
def test_area_between_centre_lines_is_that_of_the_contours(seed):
    """Shoelace area of all outer contours less all holes, whatever passages are walked twice."""
    cells, origin = ragged(seed)
    lines, tree = cv2.findContours(np.pad(cells, 1).astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    want = sum(
        cv2.contourArea(line) * (1 if up < 0 else -1) for line, up in zip(lines, tree[0, :, 3], strict=True)
    )
    free = free_polygons(plan_from(cells, "cell_centre", 0.05, origin), 0)
    assert free.is_valid, shapely.is_valid_reason(free)
    assert free.area == pytest.approx(want * 0.05**2, abs=1e-9)


def test_passage_one_cell_wide_is_closed_but_keeps_its_walls():
    """Two rooms joined by two cells in line: two polygons, 1 m apart, and a line walked forth and back.

    Each room is 2 x 2 m2 and a triangle of 1 m2 that tapers into the passage.
    """
    plan = plan_of(["...##...", "........", "...##..."], "cell_centre")
    free = free_polygons(plan, 0)
    assert sorted(round(p.area, 12) for p in free.geoms) == [5.0, 5.0]
    (line,) = wall_lines(plan, 0)
    assert shapely.LineString(line).length == pytest.approx(2 * (6 + 2 * 2**0.5 + 1))


def test_plan_of_lines_only_is_rejected():
    """One cell wide everywhere: no area between such walls; the message says what to change."""
    with pytest.raises(MapError, match="cell_edge"):
        free_polygons(plan_of(["#####", "#...#", "#####"], "cell_centre"), 0)


@pytest.mark.parametrize("wall_line", WALL_LINES)
@pytest.mark.parametrize("tolerance_m", [0.02, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("seed", range(12))
def test_simpler_walls_stay_within_the_tolerance_and_keep_the_topology(seed, tolerance_m, wall_line):
    """Each old corner within the tolerance of a new wall, each new one on an old wall; rooms and holes remain."""
    cells, origin = ragged(seed)
    plan = plan_from(cells, wall_line, 0.05, origin)
    exact = free_polygons(plan, 0)
    simple = free_polygons(plan, tolerance_m)
    assert simple.is_valid, shapely.is_valid_reason(simple)
    old, new = (shapely.get_rings(shapely.get_parts(free)) for free in (exact, simple))
    assert len(old) == len(new) and len(exact.geoms) == len(simple.geoms)
    for ring, shorter in zip(old, new, strict=True):
        corners = shapely.points(shapely.get_coordinates(ring))
        assert shapely.distance(corners, shorter).max() <= tolerance_m * (1 + 1e-9)
        assert shapely.distance(shapely.points(shapely.get_coordinates(shorter)), ring).max() < 1e-9
    assert shapely.get_num_coordinates(simple) <= shapely.get_num_coordinates(exact)


def test_staircase_becomes_a_slanted_wall():
    """A 10 x 6 m2 room at 30 degrees, 0.05 m cells: a tolerance of 1.4 cells gives back its 4 walls."""
    room = shapely.transform(
        shapely.box(-5, -3, 5, 3), lambda xy: xy @ [[0.75**0.5, 0.5], [-0.5, 0.75**0.5]] + 6.0
    )
    y, x = np.mgrid[0:240, 0:240] * 0.05 + 0.025
    plan = plan_from(shapely.contains_xy(room, x, y), "cell_edge", 0.05)
    free = free_polygons(plan, tolerance_m=0.07)
    assert shapely.get_num_coordinates(free_polygons(plan, 0)) > 500
    assert shapely.get_num_coordinates(free) <= 8
    assert abs(free.area - room.area) < 0.025 * room.length


@pytest.mark.parametrize("tolerance_m", [-0.1, np.nan, np.inf])
def test_impossible_tolerance_is_rejected(tolerance_m):
    """The message names the value and what to use instead."""
    for outline in (free_polygons, wall_lines):
        with pytest.raises(ValueError, match=r"tolerance_m is .* 0 is the exact"):
            outline(plan_of(["..", ".."]), tolerance_m)


def test_real_outlines_are_valid(shared):
    """Every tenth published grid, both customs, exact and straightened."""
    for path in sorted((shared / "maps" / "gibson").rglob("*.out"))[::10]:
        cells = np.loadtxt(path, delimiter=",", dtype=int)[::-1] > 0
        for wall_line in WALL_LINES:
            plan = plan_from(cells, wall_line, 0.05)
            exact, simple = free_polygons(plan, 0), free_polygons(plan, 0.05)
            assert exact.is_valid and simple.is_valid
            assert len(exact.geoms) == len(simple.geoms)
            assert shapely.get_num_coordinates(simple) < 0.6 * shapely.get_num_coordinates(exact)
