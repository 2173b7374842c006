"""Slanted walls one cell thick: straight on both sides, at any angle, and where reflections off them go."""

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from robosim.building.building import make_building
from robosim.building.outline import _rings_and_thin_walls
from robosim.building.straight import _reach, _rings, _segments
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from tests.outlines import free_polygons
from tests.plans import plan_from, ragged
from wireless import Tracer, TracerConfig

CELL_M = 0.05


def drawn(*lines, size=(200, 160), thickness=1):
    """A room with walls of one cell, and lines (x0, y0, x1, y1) of cells drawn into it as picture editors do."""
    width, height = size
    cells = np.full((height, width), FREE, np.uint8)
    cv2.rectangle(cells, (0, 0), (width - 1, height - 1), OCCUPIED, 1)
    for line in lines:
        cv2.line(cells, line[:2], line[2:], OCCUPIED, thickness)
    return FloorPlan(occupancy=cells, resolution_m=CELL_M, name="drawn")


def pieces(polygons):
    return shapely.get_num_coordinates(polygons) - len(shapely.get_rings(polygons.geoms))


@settings(max_examples=60, deadline=None)
@given(bottom=st.integers(4, 195), top=st.integers(4, 195))
def test_a_wall_across_a_room_has_two_straight_sides(bottom, top):
    """Two rooms of four or five walls each at any angle: within a cell of the cells' edges, and 1.5 cells of the line.

    A wall that has no step, or a single one, is along the grid and keeps it.
    """
    plan = drawn((bottom, 0, top, 159))
    exact, straight = free_polygons(plan, 0), free_polygons(plan)
    assert straight.is_valid and len(straight.geoms) == 2
    assert pieces(straight) <= (10 if abs(top - bottom) > 2 else 14)
    assert shapely.hausdorff_distance(straight.boundary, exact.boundary) < CELL_M
    if abs(top - bottom) <= 2:
        return
    line = shapely.LineString([(CELL_M * (bottom + 0.5), CELL_M / 2), (CELL_M * (top + 0.5), CELL_M * 159.5)])
    inner = shapely.intersection(straight.boundary, shapely.box(0.2, 0.2, 9.8, 7.8))
    sides = [piece for piece in shapely.get_parts(inner) if piece.length > 1 and piece.distance(line) < 0.1]
    assert len(sides) == 2
    for side in sides:
        assert shapely.distance(shapely.points(side.coords), line).max() < 1.5 * CELL_M


@settings(max_examples=40, deadline=None)
@given(
    x=st.tuples(st.integers(30, 70), st.integers(120, 170)),
    y=st.tuples(st.integers(20, 60), st.integers(90, 140)),
)
def test_a_wall_in_a_room_is_one_island(x, y):
    """Not a row of posts: one hole of at most six corners, as long as the line and a cell thick."""
    plan = drawn((x[0], y[0], x[1], y[1]))
    straight = free_polygons(plan)
    (island,) = straight.geoms[0].interiors
    length_m = CELL_M * float(np.hypot(x[1] - x[0], y[1] - y[0]))
    assert straight.is_valid and len(island.coords) <= 7
    assert shapely.Polygon(island).area == pytest.approx(length_m * CELL_M, rel=0.35)
    assert len(free_polygons(plan, 0).geoms[0].interiors) > 20


def test_a_round_wall_of_one_cell_is_far_from_a_staircase():
    """A circle: three valid parts, and at most half of the corners that its cells have."""
    for radius in (20, 40, 60):
        plan = drawn()
        cv2.circle(plan.occupancy, (100, 80), radius, OCCUPIED, 1)
        exact, straight = free_polygons(plan, 0), free_polygons(plan)
        assert straight.is_valid and len(straight.geoms) == 2
        assert pieces(straight) < 0.6 * pieces(exact)
        assert shapely.hausdorff_distance(straight.boundary, exact.boundary) < 1.5 * CELL_M


@pytest.mark.parametrize("mirrored", [False, True])
def test_reflections_off_it_are_those_of_a_straight_wall(mirrored):
    """Length and arrival direction of the path over the image in the line's lower edge: 2 cm and 0.5 degrees."""
    plan = drawn((100, 0, 199, 159))
    if mirrored:
        plan = drawn((0, 159, 99, 0))
    tx, rx = np.array([2.0, 2.5, 1.5]), np.array([3.5, 5.5, 1.5])
    if mirrored:
        tx, rx = np.array([3.0, 6.5, 1.5]), np.array([6.5, 4.5, 1.5])
    a, b = (
        (np.array([100.5, 0.5]), np.array([199.5, 159.5]))
        if not mirrored
        else (
            np.array([0.5, 159.5]),
            np.array([99.5, 0.5]),
        )
    )
    along = (b - a) / np.linalg.norm(b - a)
    normal = np.array([-along[1], along[0]])
    normal *= np.sign((tx[:2] / CELL_M - a) @ normal)
    # The side of the wall: half a cell along the grid from its middle.
    face = a + normal * 0.5 * np.abs(along).max()
    image = tx[:2] - 2 * normal * (normal @ (tx[:2] - CELL_M * face))
    want_m, vector = np.linalg.norm(rx[:2] - image), image - rx[:2]
    paths = Tracer(make_building(plan), config=TracerConfig(max_reflections=1, diffraction=False)).trace(
        tx[None], rx[None]
    )
    length_m, azimuth = paths.delay_s * 299792458.0, paths.aoa_az
    near = np.abs(length_m - want_m) < 0.02
    assert near.sum() == 1, (length_m, want_m)
    off = azimuth[near][0] - np.arctan2(vector[1], vector[0])
    assert abs((off + np.pi) % (2 * np.pi) - np.pi) < np.radians(0.5)


@pytest.mark.parametrize("slope", [1 / 2, 1 / 3, 0.01, 0.1415926])
def test_long_walls_of_any_slope_are_one_piece(slope):
    """Slopes of small fractions have many equal constraints, which filled more corners of a preimage than it had."""
    x, y = np.arange(3000), np.arange(1600)[:, None]
    straight = free_polygons(plan_from((y >= slope * x) & (y < slope * x + 9)))
    assert pieces(straight) <= 6 and straight.is_valid


def test_outlines_of_a_hundred_thousand_edges_take_seconds():
    """A corridor and a saw of equal teeth: the worst cases of a search that goes through all edges for each wall."""
    assert pieces(free_polygons(plan_from(np.ones((4, 1_000_000), bool)))) == 4
    x, y = np.arange(40_000), np.arange(40)[:, None]
    saw = y < 10 + np.abs((x % 60) - 30) * 0.7
    assert pieces(free_polygons(plan_from(saw))) < 3 * 40_000 / 60


def plain_segments(step, fixed):
    """Spans (first, end, axis), the longest of each open stretch in turn, by the definition: all edges, each time."""
    n = len(step) // 2

    def reached(first, axis):
        if step[first, axis] == 0 or fixed[first]:
            return first
        same = (step == step[first]).all(axis=1)
        run = first + int(np.argmin(same[first : first + n]))
        after = (
            run + 1 + int(np.argmin(same[run + 1 : first + n]))
            if same[run + 1 : first + n].any()
            else run + 1
        )
        after = after if same[run + 1] else run + 1
        return first if run - first > after - run else _reach(step, fixed, first, first + n, axis, 1)[0]

    ends = [[reached(i, axis) for i in range(n)] for axis in range(2)]
    found, stretches = [], [(0, 2 * n)]
    while stretches:
        low, high = stretches.pop()
        best = (0, 0, 0)
        for axis in range(2):
            for i in range(low, min(high, low + n)):
                end = min(ends[axis][i % n] + i // n * n, high)
                if end > i and step[end - 1, axis] == 0:
                    end -= 1
                steps = (step[i:end, axis] == 0).sum()
                if (steps > 2 or (steps == 2 and end - i - steps >= 6)) and end - i > best[0]:
                    best = end - i, i, axis
        length, i, axis = best
        if length:
            found.append((i, i + length, axis))
            whole = high - low == 2 * n
            stretches += [(i + length, i + n)] if whole else [(low, i), (i + length, high)]
    return sorted(found)


@pytest.mark.parametrize("seed", range(25))
def test_segments_are_those_of_a_plain_search(seed):
    """Of blobs, and of the same three times as large, whose staircases have several cells a step: the very same."""
    cells, _ = ragged(seed)
    for free in (cells, np.kron(cells, np.ones((2, 3), bool))):
        for ring in _rings(*_rings_and_thin_walls(free)[::2]):
            step, fixed = np.tile(ring.step, (2, 1)), np.tile(ring.fixed, 2)
            spans, _ = _segments(step, fixed)
            assert sorted(map(tuple, spans.tolist())) == plain_segments(step, fixed)


def test_shipped_plans_keep_their_touching_corners():
    """Furniture that touches by a corner is no wall: where nothing is thin, both rules give the same outlines."""
    for name in ("flat", "cottage", "loft", "townhouse", "villa", "office"):
        assert not len(_rings_and_thin_walls(read_plan(name).free)[2])
