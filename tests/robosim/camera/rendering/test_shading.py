"""Light and texture baked into a building: same surfaces, no cracks, light as in closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh

from robosim.building.building import KINDS, Building, BuildingConfig, make_building
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.shading import ambient_light, cosine_directions, shaded_mesh
from robosim.camera.rendering.tessellation import Patches, tessellate
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan
from wireless.support import cached_array

FLOOR, WALL = KINDS.index("floor"), KINDS.index("wall")


def plan(yaw: float = 0.0, resolution_m: float = 0.05) -> FloorPlan:
    """Two rooms with a door, two columns and a slanted wall of steps."""
    occupancy = np.zeros((90, 120), np.uint8)
    occupancy[:, 60:62] = 1
    occupancy[40:58, 60:62] = 0
    occupancy[20:28, 25:33] = 1
    occupancy[60:70, 90:96] = 1
    for i in range(40):
        occupancy[i, 120 - 40 + i :] = 1
    return FloorPlan(
        occupancy=occupancy, resolution_m=resolution_m, origin=(3.0, -7.0, yaw), name="two rooms"
    )


BUILDINGS = {
    "walls": lambda: make_building(plan()),
    "turned": lambda: make_building(plan(yaw=0.4)),
    "slanted walls": lambda: make_building(plan(), config=BuildingConfig(tolerance_m=0.08)),
    "low furniture": lambda: make_building(plan(), config=BuildingConfig(furniture_height_m=0.8)),
    "coarse cells": lambda: make_building(plan(resolution_m=0.3)),
}


def cut(building: Building, step_m: float = 0.5, heights_m: tuple[float, ...] = (0.1, 1.0)) -> Patches:
    """Patches of a building, as shading cuts them."""
    return tessellate(building, step_m=step_m, heights_m=heights_m)


def areas(triangles: np.ndarray) -> np.ndarray:
    """Area of each triangle [m2]."""
    return trimesh.triangles.area(triangles)


@pytest.mark.parametrize("name", BUILDINGS)
def test_patches_cover_the_same_surfaces(name):
    """Area by kind is that of the building to 1e-9, and each patch lies in the plane of a face of its kind."""
    building = BUILDINGS[name]()
    patches = cut(building)
    corners = patches.vertices[patches.faces]
    kind = patches.kind[patches.faces[:, 0]]
    got = np.bincount(kind, areas(corners), minlength=4)
    expected = np.bincount(building.face_kind, areas(building.mesh.triangles), minlength=4)
    assert np.abs(got - expected).max() < 1e-9

    normal = building.mesh.face_normals[patches.source]
    on_face = building.mesh.triangles[patches.source, 0]
    assert np.abs(((patches.vertices - on_face) * normal).sum(axis=1)).max() < 1e-9
    assert np.array_equal(building.face_kind[patches.source], patches.kind)


@pytest.mark.parametrize("name", BUILDINGS)
def test_patches_leave_no_cracks(name):
    """Joined by position, patches form a closed surface with normals inwards, as the building is."""
    patches = cut(BUILDINGS[name]())
    mesh = trimesh.Trimesh(patches.vertices, patches.faces, process=True)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(BUILDINGS[name]().mesh.volume, rel=1e-9)
    turned = trimesh.triangles.normals(patches.vertices[patches.faces])[0]
    assert ((turned * patches.normals[patches.faces[:, 0]]).sum(axis=1) > 1 - 1e-6).all()


def test_patches_are_small():
    """No edge is longer than the diagonal of a square of the grid, or of a strip of a wall askew above one."""
    patches = cut(make_building(plan()), heights_m=(0.1, 0.6, 1.1, 1.6, 2.1))
    corners = patches.vertices[patches.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert edges.max() < 0.5 * np.sqrt(3) + 1e-9


def test_a_real_plan_is_covered_too(shared: Path):
    """Walls through cell centres, diagonals and passages of no width: same area to 1e-9."""
    building = make_building(read_plan(shared / "maps/gibson/train/Colebrook.glb_topdownmap.out"))
    patches = cut(building)
    assert areas(patches.vertices[patches.faces]).sum() == pytest.approx(building.mesh.area, rel=1e-12)


def test_directions_are_weighted_with_the_cosine():
    """Moments of the distribution cos(theta) / pi over the hemisphere: E z = 2/3, E z2 = 1/2, E x2 = E y2 = 1/4."""
    directions = cosine_directions(64)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    x, y, z = directions.T
    assert [x.mean(), y.mean()] == pytest.approx([0, 0], abs=0.01)
    assert z.mean() == pytest.approx(2 / 3, abs=0.01)
    assert [(x * x).mean(), (y * y).mean(), (z * z).mean()] == pytest.approx([0.25, 0.25, 0.5], abs=0.01)


def hall() -> Building:
    """An empty hall of 8 m by 8 m, 6 m high."""
    return make_building(
        FloorPlan(occupancy=np.zeros((80, 80), np.uint8), resolution_m=0.1, name="hall"),
        config=BuildingConfig(height_m=6.0),
    )


def test_ambient_light_is_the_open_share_of_the_hemisphere():
    """On the floor of a wide hall: 1 in the middle, 1/2 at the foot of a wall, 1/4 in a corner, by symmetry."""
    building = hall()
    patches = cut(building)
    light = ambient_light(patches, building.mesh, range_m=1.5, n_rays=256)
    x, y, _ = patches.vertices.T
    to_wall = np.sort(np.stack([np.minimum(x, 8 - x), np.minimum(y, 8 - y)]), axis=0)
    on_floor = patches.kind == FLOOR
    assert light[on_floor & (to_wall[0] > 1.6)] == pytest.approx(1.0, abs=1e-6)
    assert light[on_floor & (to_wall[0] == 0) & (to_wall[1] > 2)] == pytest.approx(0.5, abs=0.03)
    assert light[on_floor & (to_wall[1] == 0)] == pytest.approx(0.25, abs=0.03)
    assert light.min() >= 0
    assert light.max() <= 1


def test_corners_are_visible():
    """Where two walls meet, one is brighter than the other by 5 % or more (measured 6 to 22 %), in all four corners.

    Paint and ambient light are the same for both there, by position and by symmetry.
    """
    mesh = shaded_mesh(hall())
    brightness = mesh.visual.vertex_colors[:, :3].mean(axis=1)
    on_wall = np.abs(mesh.vertex_normals[:, 2]) < 0.1
    for x, y in ((0, 0), (0, 8), (8, 0), (8, 8)):
        here = on_wall & (np.abs(mesh.vertices - (x, y, 6)).max(axis=1) < 1e-9)
        tones = [brightness[here & (np.abs(mesh.vertex_normals[:, axis]) > 0.9)].mean() for axis in (0, 1)]
        assert max(tones) / min(tones) > 1.05


def test_each_piece_of_furniture_has_its_own_hue():
    """Two columns: one hue each, and different ones, whatever the light on them."""
    building = make_building(plan())
    mesh = shaded_mesh(building)
    patches = cut(building, heights_m=(0.1,))
    rgb = mesh.visual.vertex_colors[:, :3].astype(float)
    assert len(patches.vertices) == len(rgb)
    hue = rgb / np.linalg.norm(rgb, axis=1, keepdims=True)
    furniture = patches.kind == KINDS.index("furniture")
    first = furniture & (patches.vertices[:, 0] < 6.0)
    second = furniture & (patches.vertices[:, 0] > 6.0)
    assert first.any()
    assert second.any()
    centres = hue[first].mean(axis=0), hue[second].mean(axis=0)
    apart = np.linalg.norm(centres[0] - centres[1])
    assert apart > 0.1
    for part, centre in ((first, centres[0]), (second, centres[1])):
        assert np.linalg.norm(hue[part] - centre, axis=1).max() < apart / 2


def test_shading_does_not_depend_on_where_the_plan_lies():
    """Moved by 4 km, the same building has the same colours: texture follows the plan, not the map."""
    here = shaded_mesh(make_building(plan()))
    there_plan = FloorPlan(occupancy=plan().occupancy, resolution_m=0.05, origin=(4096.0, 2048.0, 0.0))
    there = shaded_mesh(make_building(there_plan))
    assert np.array_equal(here.faces, there.faces)
    difference = np.abs(here.visual.vertex_colors.astype(int) - there.visual.vertex_colors)
    assert np.quantile(difference, 0.99) <= 1


def test_shading_is_the_same_every_time():
    """Bit for bit: no chance is involved."""
    one, two = shaded_mesh(make_building(plan())), shaded_mesh(make_building(plan()))
    assert np.array_equal(one.vertices, two.vertices)
    assert np.array_equal(one.visual.vertex_colors, two.visual.vertex_colors)


def test_a_building_without_a_ceiling_is_shaded():
    """Everything but the ceiling is there."""
    building = make_building(plan(), config=BuildingConfig(ceiling=False))
    mesh = shaded_mesh(building)
    assert mesh.area == pytest.approx(building.mesh.area)
    assert shapely.area(building.free) < mesh.area


def test_light_from_disk_is_the_light(tmp_path, monkeypatch):
    """Computed, cached, read: the same bit-identical colours, and others where a wall is in another place."""
    monkeypatch.setattr(cached_array, "writable_folder", lambda folders: tmp_path)
    building, other = make_building(plan()), replace(plan(), occupancy=plan().occupancy[::-1].copy())
    found = []
    for one in (building, building, make_building(other)):
        shaded_mesh.cache_clear()
        found.append(shaded_mesh(one).visual.vertex_colors)
    assert len(list(tmp_path.glob("light-*.cached"))) == 2
    np.testing.assert_array_equal(found[0], found[1])
    assert found[2].shape != found[0].shape or (found[2] != found[0]).any()


def test_shading_leaves_depth_as_it_is():
    """Depth of the cottage is bit-identical with and without colours."""
    building, config = make_building(read_plan("cottage")), CameraConfig()
    x, y = np.array(building.free.representative_point().coords[0])
    shaded = shaded_mesh(building)
    depths = []
    for mesh in (shaded, trimesh.Trimesh(shaded.vertices, shaded.faces, process=False)):
        with make_camera([mesh], config) as camera:
            depths.append(camera.render(camera_pose(np.array([x, y, 1.7]), config)).depth.copy())
    assert np.array_equal(*depths)
