"""Walls of drawings in three styles, against exact areas; layers, sizes and gaps."""

from pathlib import Path

import numpy as np
import pytest

from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, MapError, ReadingOptions
from robosim.plans.formats.line_drawing import MOST_THICK_M, Shape, plan_from_shapes

PATH = Path("house.dxf")
#: A house of 6 m x 4 m with walls of 0.2 m, a partition of 0.1 m and a door of 0.9 m in it.
OUTER = [(0, 0), (6, 0), (6, 4), (0, 4)]
INNER = [(0.2, 0.2), (3, 0.2), (3, 2), (3.1, 2), (3.1, 0.2), (5.8, 0.2), (5.8, 3.8), (3.1, 3.8), (3.1, 2.9)]
INNER += [(3, 2.9), (3, 3.8), (0.2, 3.8)]
FREE_M2 = 2.8 * 3.6 + 2.7 * 3.6 + 0.1 * 0.9


def shape(*outlines, layer="WALL", closed=True, **more):
    rings = [np.array([*points, points[0]] if closed else points, float) for points in outlines]
    return Shape((layer,), tuple(rings), **more)


def read(*shapes, **options):
    return plan_from_shapes(shapes, PATH, ReadingOptions(**options))


def free_m2(plan):
    return np.count_nonzero(plan.free) * plan.resolution_m**2


def is_free(plan, x, y):
    column, row = np.floor(plan.to_cells(np.array([x, y]))).astype(int)
    return plan.occupancy[row, column] == FREE


@pytest.mark.parametrize(
    "walls",
    [
        [shape(OUTER), shape(INNER)],
        [shape(OUTER, INNER, is_area=True)],
        [
            shape([a, b], closed=False)
            for ring in (OUTER, INNER)
            for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)
        ],
    ],
)
def test_double_lines_and_areas_are_walls(walls):
    """Two closed outlines, an area with a hole, and single lines that meet: the same exact plan."""
    plan = read(*walls)
    assert free_m2(plan) == pytest.approx(FREE_M2)
    low, high = plan.centres(plan.free).min(axis=0), plan.centres(plan.free).max(axis=0)
    assert low == pytest.approx([0.225, 0.225]) and high == pytest.approx([5.775, 3.775])
    assert is_free(plan, 3.05, 2.5) and not is_free(plan, 3.05, 1.0)
    assert (plan.occupancy[0] == UNKNOWN).all()


@pytest.mark.parametrize("thickness_m", [None, 0.1, 0.2])
def test_single_lines_have_a_thickness(thickness_m):
    """A room of 6 m x 4 m between the middles of its walls; a cell of 0.05 m if nothing is given."""
    t = thickness_m or 0.05
    plan = read(shape(OUTER), line_thickness_m=thickness_m)
    assert free_m2(plan) == pytest.approx((6 - t) * (4 - t))


@pytest.mark.parametrize("angle_deg", [0.0, 10.0, 45.0, 77.0])
def test_a_single_line_lets_nothing_through(angle_deg):
    """A wall at any angle from wall to wall, anywhere on the grid, parts the room into two."""
    from scipy import ndimage

    for shift in (0.0, 0.01, 0.025):
        tilt = 1.5 * np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
        middle = np.array([3.0 + shift, 2.0])
        room = [(1.5 + shift, 0.5), (4.5 + shift, 0.5), (4.5 + shift, 3.5), (1.5 + shift, 3.5)]
        plan = read(shape(room), shape([middle - 2 * tilt, middle + 2 * tilt], closed=False))
        inside = plan.free.copy()
        columns = plan.to_map(np.column_stack([np.arange(plan.shape[1]) + 0.5, np.zeros(plan.shape[1])]))[
            :, 0
        ]
        inside[:, (columns < 1.5 + shift) | (columns > 4.5 + shift)] = False
        sizes = np.bincount(ndimage.label(inside)[0].ravel())[1:]
        assert np.count_nonzero(sizes > 100) == 2


def test_lines_are_as_wide_as_they_are_drawn():
    plan = read(shape(OUTER, width_m=0.3))
    assert free_m2(plan) == pytest.approx(5.7 * 3.7)


def test_gaps_within_walls_are_closed():
    """Double lines that end 0.02 m before the others and enclose nothing exactly: the walls are solid all the same."""
    inner = [(0.2, 0.2), (5.8, 0.2), (5.8, 3.8), (0.2, 3.8)]
    lines = [(a, b) for ring in (OUTER, inner) for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)]
    short = [(np.array(a) + 0.02 * np.sign(np.subtract(b, a)), b) for a, b in lines]
    plan = read(*(shape(line, closed=False) for line in short))
    assert free_m2(plan) == pytest.approx(5.55 * 3.55, rel=0.01)
    assert not is_free(plan, 0.1, 2.0)


def test_a_closet_is_no_wall():
    """Between lines farther apart than the thickest wall is floor."""
    wide = MOST_THICK_M + 0.05
    plan = read(shape(OUTER, [(1, 1), (1 + wide, 1), (1 + wide, 3), (1, 3)]))
    assert is_free(plan, 1 + wide / 2, 2)


def test_layers_called_walls_are_read_and_others_are_not(caplog):
    """Furniture and doors are left out; several layers of walls are named in a warning, one is not."""
    table = shape([(1, 1), (2, 1), (2, 2), (1, 2)], layer="Furniture", is_area=True)
    assert free_m2(read(shape(OUTER), shape(INNER), table)) == pytest.approx(FREE_M2)
    assert not caplog.text
    plan = read(shape(OUTER, layer="A-WALL"), shape(INNER, layer="Wände innen"), table)
    assert free_m2(plan) == pytest.approx(FREE_M2)
    assert "the layers 'A-WALL', 'Wände innen'. Choose by --wall-layer" in caplog.text


@pytest.mark.parametrize(
    ("layer", "is_wall"),
    [
        ("A-WALL-FULL", 1),
        ("a_glaz", 1),
        ("Fenster", 1),
        ("A-COLS", 1),
        ("MUR", 1),
        ("colour", 0),
        ("Murphy", 0),
        ("Türen", 0),
    ],
)
def test_names_of_walls(layer, is_wall):
    """Walls, windows and columns: a post of 0.5 m x 0.5 m on such a layer is read."""
    post = shape([(1, 1), (1.5, 1), (1.5, 1.5), (1, 1.5)], layer=layer)
    assert free_m2(read(shape(OUTER), shape(INNER), post)) == pytest.approx(FREE_M2 - 0.25 * is_wall)


def test_chosen_layers():
    table = shape([(1, 1), (2, 1), (2, 2), (1, 2)], layer="Tables", is_area=True)
    plan = read(shape(OUTER, INNER, is_area=True, layer="ARCH_1"), table, wall_layers=("arch*", "TABLES"))
    assert free_m2(plan) == pytest.approx(FREE_M2 - 1)
    with pytest.raises(
        MapError, match=r"its layers are 'ARCH' \(1\), 'Tables' \(1\), and none is called wall"
    ):
        read(shape(OUTER, layer="ARCH"), table)
    with pytest.raises(
        MapError, match=r"and none is called 'X'\. Name the layer of walls: --wall-layer NAME"
    ):
        read(shape(OUTER, layer="ARCH"), table, wall_layers=("ARCH", "X"))


def test_a_single_layer_needs_no_name():
    assert free_m2(read(shape(OUTER, INNER, is_area=True, layer="0"))) == pytest.approx(FREE_M2)


@pytest.mark.parametrize(
    ("scale", "message"),
    [(1e-3, "0.006 x 0.004 m, too small"), (1e3, "6e.03 x 4e.03 m, too large"), (np.inf, "NaN or infinite")],
)
def test_sizes_that_no_building_has_are_rejected(scale, message):
    with np.errstate(invalid="ignore"), pytest.raises(MapError, match=message):
        read(shape(np.array(OUTER[1:]) * scale))


def test_large_buildings_are_confirmed():
    plan = read(shape(np.array(OUTER) * 100), allow_large=True, resolution_m=1.0)
    assert free_m2(plan) == pytest.approx(599 * 399)
    assert OCCUPIED in plan.occupancy


def test_nothing_drawn_is_rejected():
    with pytest.raises(MapError, match="no lines or areas"):
        read()


def test_solid_ground_is_rejected():
    with pytest.raises(MapError, match="its walls leave no floor free"):
        read(shape(OUTER, is_area=True))
