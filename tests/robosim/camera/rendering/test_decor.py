"""Rooms, windows and door frames as colours: found where they are, and nothing but colours."""

import numpy as np
import pytest
import trimesh

from robosim.building.building import make_building
from robosim.building.extrusion import WALL
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.decor import _FRAME, GLASS, Decor, _rooms
from robosim.camera.rendering.shading import shaded_mesh, window_light
from robosim.camera.rendering.tessellation import Patches, tessellate
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan


def flat(yaw: float = 0.0) -> FloorPlan:
    """Rooms of 4.0 m and 3.9 m by 5 m, a wall of 0.1 m between them with a door of 0.9 m, next to a closet of 1 m."""
    occupancy = np.zeros((100, 160), np.uint8)
    occupancy[:, 80:82] = 1
    occupancy[40:58, 80:82] = 0
    occupancy[:, 138:140] = 1
    occupancy[10:16, 138:140] = 0
    return FloorPlan(occupancy=occupancy, resolution_m=0.05, origin=(2.0, -3.0, yaw), name="flat")


def decor(plan: FloorPlan, seed: int = 0) -> tuple[Decor, Patches]:
    patches = tessellate(make_building(plan), step_m=0.5, heights_m=(0.1,))
    return Decor(plan, patches, seed), patches


def test_doors_part_rooms():
    """Three rooms; each cell of free floor belongs to the one on its side of the doors, to half the wall."""
    plan = flat()
    rooms = _rooms(plan)
    left, right, closet = rooms[50, 20], rooms[50, 110], rooms[50, 150]
    assert len({left, right, closet}) == 3
    assert set(np.unique(rooms)) == {left, right, closet}
    assert (rooms[:, :78] == left).mean() > 0.999 and (rooms[:, 84:136] == right).mean() > 0.999
    assert (rooms[:, 142:] == closet).mean() > 0.999


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_windows_are_in_outer_walls_alone(yaw):
    """Behind each window nothing is free for 3 m; the wall between the rooms has none; there are some."""
    plan = flat(yaw)
    found, patches = decor(plan)
    middle = patches.vertices[found.windows].mean(axis=1)
    x, y = (plan.to_cells(middle[:, :2]) * plan.resolution_m).T
    assert len(found.windows) >= 4
    outer = (np.abs(y) < 1e-6) | (np.abs(y - 5) < 1e-6) | (np.abs(x) < 1e-6) | (np.abs(x - 8) < 1e-6)
    assert outer.all()
    assert (patches.row[found.windows] == 1).all(), "above the skirting"


def test_frames_stand_in_doors():
    """The ends of the wall at the door of 0.9 m: two of 0.1 m, at y = 2.0 and 2.9, and none at the closet's slit."""
    plan = flat()
    found, patches = decor(plan)
    middle = patches.vertices[found._jambs].mean(axis=1)
    assert sorted({round(y, 6) for y in middle[:, 1] + 3.0}) == [2.0, 2.9]
    assert ((middle[:, 0] > 6.0) & (middle[:, 0] < 6.1)).all()
    colours = found.albedo()
    assert (colours[found._jambs.ravel()] == _FRAME).all()
    assert (colours[found.windows.ravel()] == GLASS).all()


def test_a_room_has_one_paint():
    """Walls of a room differ by no more than the grain of their paint; rooms differ."""
    found, patches = decor(flat(), seed=3)
    colours = found.albedo()
    plain = (patches.kind == WALL) & (patches.row == 1)
    for part in (found.windows, found._jambs):
        plain[part.ravel()] = False
    paints = [np.median(colours[plain & (found._room == room)], axis=0) for room in np.unique(found._room)]
    for room, paint in zip(np.unique(found._room), paints, strict=True):
        assert np.abs(colours[plain & (found._room == room)] / paint - 1).max() < 0.03
    assert len({tuple(paint.round()) for paint in paints}) > 1


def test_another_seed_paints_otherwise_and_leaves_depth_as_it_is():
    """Depth of the cottage bit for bit: of two seeds, and of the same triangles without a colour."""
    building, config = make_building(read_plan("cottage")), CameraConfig()
    x, y = np.array(building.free.representative_point().coords[0])
    meshes = [shaded_mesh(building, seed=seed) for seed in (0, 1)]
    meshes.append(trimesh.Trimesh(meshes[0].vertices, meshes[0].faces, process=False))
    pictures = []
    for mesh in meshes:
        with make_camera([mesh], config) as camera:
            pictures.append(
                [camera.render(camera_pose(np.array([x, y, a]), config)) for a in (0.2, 1.7, 4.0)]
            )
    for one, other in ((0, 1), (0, 2)):
        assert all(
            np.array_equal(a.depth, b.depth) for a, b in zip(pictures[one], pictures[other], strict=True)
        )
    assert np.abs(pictures[0][0].rgb.astype(int) - pictures[1][0].rgb).max() > 20


@pytest.mark.parametrize(
    ("at", "normal", "expected"),
    [
        ((2.0, 0.0, 1.0), (-1.0, 0.0, 0.0), 1.0 / (np.pi * 4.0)),
        ((2.0, 2.0, 1.0), (-1.0, 0.0, 0.0), 0.5 / (np.pi * 8.0)),
        ((2.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1 / np.sqrt(5) * 2 / np.sqrt(5) / (np.pi * 5.0)),
        ((2.0, 0.0, 1.0), (1.0, 0.0, 0.0), 0.0),
        ((-2.0, 0.0, 1.0), (1.0, 0.0, 0.0), 0.0),
        ((9.0, 0.0, 1.0), (-1.0, 0.0, 0.0), 0.0),
    ],
)
def test_daylight_is_that_of_a_shining_point(at, normal, expected):
    """A window of 1 m2 at the origin that looks along +x: A cos cos / (pi t2), and none from behind or afar."""
    patch = Patches(
        vertices=np.array([at]),
        normals=np.array([normal]),
        inward=np.array([[0.0, 1.0, 0.0]]),
        kind=np.zeros(1, np.uint8),
        cell=np.zeros((1, 2), int),
        row=np.zeros(1, int),
        source=np.zeros(1, int),
        faces=np.zeros((0, 3), int),
    )
    window = np.array([[[0, -0.5, 0.5], [0, 0.5, 0.5], [0, 0.5, 1.5], [0, -0.5, 1.5]]], float)
    far = trimesh.creation.box(
        (0.1, 0.1, 0.1), transform=trimesh.transformations.translation_matrix([0, 30, 0])
    )
    assert window_light(patch, far, window)[0] == pytest.approx(expected, rel=0.05, abs=1e-12)
    between = trimesh.creation.box(
        (0.1, 9, 9), transform=trimesh.transformations.translation_matrix([1, 0, 0])
    )
    assert window_light(patch, between, window)[0] == 0.0
