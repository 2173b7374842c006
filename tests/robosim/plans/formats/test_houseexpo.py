"""HouseExpo outlines: areas and points by shapely."""

import json

import numpy as np
import pytest
import shapely

from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError

# Two rooms of 3 m x 4 m; the wall between them is a slit of 0.2 m, with a door of 1 m.
TWO_ROOMS = [
    [0, 0],
    [3, 0],
    [3, 1],
    [3.2, 1],
    [3.2, 0],
    [6.2, 0],
    [6.2, 4],
    [3.2, 4],
    [3.2, 2],
    [3, 2],
    [3, 4],
    [0, 4],
]


def write(folder, verts, **keys):
    house = {"id": "0a1b", "room_num": 2, "bbox": {"min": [0, 0], "max": [6.2, 4]}, "verts": verts, **keys}
    path = folder / "house.json"
    path.write_text(json.dumps(house))
    return path


def test_axis_aligned_houses_are_exact(tmp_path):
    """24.2 m2 of floor in cells of 0.05 m: two rooms of 12 m2, a door of 0.2 m2, not one cell more."""
    plan = read_plan(write(tmp_path, TWO_ROOMS))
    assert plan.free.sum() == round(24.2 / 0.05**2)
    assert plan.name == "0a1b"
    np.testing.assert_allclose(plan.origin, [-0.05, -0.05, 0])
    assert not (plan.free[0].any() or plan.free[-1].any() or plan.free[:, 0].any() or plan.free[:, -1].any())


def test_the_outline_may_go_in_either_direction(tmp_path):
    there = read_plan(write(tmp_path, TWO_ROOMS)).occupancy
    back = read_plan(write(tmp_path, TWO_ROOMS[::-1])).occupancy
    np.testing.assert_array_equal(there, back)


@pytest.mark.parametrize("turn", [0.3, 1.2])
def test_cells_are_free_where_their_centre_is_inside(tmp_path, turn):
    """A turned and moved house, at a coarser resolution; shapely decides for every centre."""
    c, s = np.cos(turn), np.sin(turn)
    verts = np.array(TWO_ROOMS) @ [[c, s], [-s, c]] + (-7, 3)
    plan = read_plan(write(tmp_path, verts.tolist()), resolution_m=0.1)
    centres = plan.centres(np.ones(plan.shape, bool))
    inside = shapely.contains_xy(shapely.Polygon(verts), centres)
    np.testing.assert_array_equal(plan.free.ravel(), inside)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('{"verts": [[0, 0], [1, NaN], [1, 1]]}', ["JSON", "NaN"]),
        ('{"verts": [[0, 0], [1, 0]]}', ["three corners"]),
        ('{"verts": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}', ["(3, 3)"]),
        ('{"verts": [[0, 0], [1], [1, 1]]}', ["pairs of numbers"]),
        ('{"verts": [["a", 0], [1, 0], [1, 1]]}', ["pairs of numbers"]),
        ('{"verts": null}', ["verts"]),
        ('{"verts": [[0, 0], [1e9, 0], [1e9, 1e9]]}', ["metres", "coarser"]),
        ('{"verts": [[-1e308, 0], [1e308, 0], [1e308, 1e308]]}', ["metres"]),
        ('{"verts": [[0, 0], [0.01, 0], [0.01, 0.01]]}', ["no whole cell", "metres"]),
        ('{"verts": [[0, 0], [1, 0], [2, 0]]}', ["no whole cell"]),
        ('{"rooms": []}', ["`verts`"]),
        ("[1, 2]", ["`verts`"]),
        ("{", ["JSON"]),
        ("[" * 100_000, ["JSON"]),
        ("", ["empty"]),
    ],
)
def test_bad_houses_are_said(tmp_path, content, words):
    path = tmp_path / "house.json"
    path.write_text(content)
    with pytest.raises(MapError) as error:
        read_plan(path)
    for word in ["house.json", *words]:
        assert word in str(error.value)
