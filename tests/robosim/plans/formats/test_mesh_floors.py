"""What a floor is: a level surface below free air, whichever direction it faces."""

import logging

import numpy as np
import pytest
import shapely
import trimesh

from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError, ReadingOptions
from robosim.plans.formats.mesh_slice import plan_from_triangles


def box(low, high):
    """A closed box whose faces point outwards."""
    return trimesh.creation.box(bounds=[low, high]).triangles


def walls(height_m=2.7, thickness_m=0.2, size=(6.0, 4.0), z_m=0.0):
    """Walls around a rectangle as one closed ring."""
    outer = shapely.box(0, 0, *size)
    mesh = trimesh.creation.extrude_polygon(
        outer.difference(outer.buffer(-thickness_m, join_style="mitre")), height_m
    )
    mesh.apply_translation([0, 0, z_m])
    return mesh.triangles


def free_m2(triangles, **options):
    return plan_from_triangles(np.asarray(triangles), ReadingOptions(**options)).free.sum() * 0.05**2


def written(triangles, tmp_path, name="a.stl"):
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(triangles.size // 3).reshape(-1, 3))
    mesh.export(tmp_path / name)
    return tmp_path / name


def test_stacked_boxes_are_storeys(caplog):
    """Two rooms as closed boxes, one on the other, faces outwards: 24 m2 at 0 and at 3 m; the upper was the lowest."""
    both = np.concatenate([box((0, 0, 0), (6, 4, 3)), box((0, 0, 3), (6, 4, 6))])
    with caplog.at_level(logging.WARNING):
        assert free_m2(both) == pytest.approx(24.0)
    assert any("0.00 m (24 m2), 3.00 m (24 m2)" in message for message in caplog.messages)
    for height in (0.0, 3.0):
        assert free_m2(both, floor_height_m=height) == pytest.approx(24.0, rel=0.06)


@pytest.mark.parametrize("slab", [1, -1])
@pytest.mark.parametrize("ring", [1, -1])
def test_each_body_has_its_own_facing(slab, ring):
    """Walls on a slab, either of them inside out: 5.6 x 3.6 m2 within a row of cells; both were turned, or none."""
    parts = [box((0, 0, -0.3), (6, 4, 0))[:, ::slab], walls()[:, ::ring]]
    found = free_m2(np.concatenate(parts))
    assert found == pytest.approx(20.16, abs=1e-6 if ring == 1 else 1.0)


def test_walls_alone_ask_for_the_ground(tmp_path):
    """A ring of walls of 0.1 m has no floor, whichever axis is up; with ground at 0 it has 5.8 x 3.8 m2."""
    path = written(walls(thickness_m=0.1), tmp_path)
    with pytest.raises(MapError, match=r"a\.stl: no floor found.*--ground 0\.00"):
        read_plan(path)
    assert read_plan(path, ground_m=0.0).free.sum() * 0.05**2 == pytest.approx(22.04)


def test_a_little_surface_is_no_floor(tmp_path):
    """A table in walls without a floor does not become one."""
    table = box((2, 1, 0.7), (3.2, 2, 0.75))
    with pytest.raises(MapError, match="no floor found"):
        read_plan(written(np.concatenate([walls(), table]), tmp_path))


def test_furniture_and_ceiling_do_not_hide_the_floor():
    """Beds and tables over two thirds of a room, a ceiling above: the floor is still at 0 m."""
    parts = [box((0, 0, -0.2), (6, 4, 0)), walls(), box((0, 0, 2.7), (6, 4, 2.9))]
    parts += [box((0.3 + i, 0.3, 0), (1.1 + i, 3.4, 0.4)) for i in range(5)]
    found = plan_from_triangles(np.concatenate(parts))
    assert found.free.sum() * 0.05**2 == pytest.approx(20.16 - 5 * 0.8 * 3.1, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_faces_that_point_anywhere_are_put_right(seed, caplog):
    """Each face turned over at random: the same plan, and a warning."""
    right = np.concatenate([box((0, 0, -0.3), (6, 4, 0)), walls(z_m=0.0), box((2, 1, 0), (3, 2, 1))])
    over = np.random.default_rng(seed).random(len(right)) < 0.5
    assert free_m2(np.where(over[:, None, None], right[:, ::-1], right)) == pytest.approx(free_m2(right))
    assert any("turned alike" in message for message in caplog.messages)


@pytest.mark.parametrize(("unit_m", "name"), [(0.001, "mm"), (0.01, "cm"), (0.0254, "inches")])
def test_other_units_are_asked_for(tmp_path, unit_m, name):
    """A flat of 6 x 4 m2 in other units would be a tower; nothing is guessed."""
    house = np.concatenate([box((0, 0, -0.3), (6, 4, 0)), walls()])
    path = written(house / unit_m, tmp_path)
    with pytest.raises(MapError, match=r"a\.stl: a building .* high\? Pass its unit of length"):
        read_plan(path)
    assert read_plan(path, unit_m=unit_m).free.sum() * 0.05**2 == pytest.approx(20.16, abs=0.3)


def test_one_far_vertex_is_rejected_at_once(tmp_path):
    """A triangle of a room's floor that reaches 100 km away: no grid of two million cells is made."""
    house = np.concatenate([box((0, 0, -0.3), (6, 4, 0)), walls()])
    house = np.concatenate([house, [[[0, 0, 0], [6, 0, 0], [3, 99999, 0]]]])
    with pytest.raises(MapError, match=r"a\.stl: a building 6 m long, 1e\+05 m wide"):
        read_plan(written(house, tmp_path))


def test_up_is_guessed_where_only_one_axis_has_a_floor(tmp_path, caplog):
    """A house with y up in an STL file is taken so, and that is said."""
    house = np.concatenate([box((0, 0, -0.3), (12, 9, 0)), walls(size=(12.0, 9.0))])
    turned = house[:, :, [0, 2, 1]] * (1, 1, -1)
    with caplog.at_level(logging.WARNING):
        plan = read_plan(written(turned, tmp_path))
    assert plan.free.sum() * 0.05**2 == pytest.approx(11.6 * 8.6, abs=0.3)
    assert any("y axis is taken to point up" in message for message in caplog.messages)
