"""Walls of the page from outlines, and the view from above."""

import math

import numpy as np
import pytest
import shapely
import trimesh

from robosim.building.building import make_building
from robosim.drawing.plan_view import building_rings
from robosim.live.building_scene import (
    EDGE_M,
    FIELD_DEG,
    facing_free,
    floor_mesh,
    upper_edges,
    view_from_above,
    wall_mesh,
    wall_sides,
)
from robosim.live.server import COVERED
from robosim.plans.files import read_plan
from tests.plans import two_rooms

SQUARE = np.array([[0.0, 0], [4, 0], [4, 3], [0, 3], [0, 0]])
ISLAND = np.array([[1.0, 1], [2, 1], [2, 2], [1, 2], [1, 1]])


@pytest.mark.parametrize("outer", [SQUARE, SQUARE[::-1]])
@pytest.mark.parametrize("inner", [ISLAND, ISLAND[::-1]])
def test_walls_face_free_space_however_outlines_are_wound(outer, inner):
    """In front of the middle of each wall the floor is free: inside the room, outside the island."""
    rings = facing_free([outer, inner])
    vertices, faces = wall_mesh(rings, 2.5)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    ahead = mesh.triangles_center + 0.1 * mesh.face_normals
    x, y = ahead[:, 0], ahead[:, 1]
    in_room = (x > 0) & (x < 4) & (y > 0) & (y < 3)
    in_island = (x > 1) & (x < 2) & (y > 1) & (y < 2)
    assert (in_room & ~in_island).all()
    assert mesh.area == pytest.approx(2.5 * (14 + 4))


@pytest.mark.parametrize("plan", [two_rooms(0.8), read_plan("flat")], ids=["two rooms", "flat"])
def test_floor_and_walls_are_those_of_the_building(plan):
    """The floor's area is that of the building's free space, and the walls are as long as its walls."""
    building = make_building(plan)
    rings = facing_free(building_rings(building))
    vertices, faces = floor_mesh(rings)
    floor = trimesh.Trimesh(vertices, faces, process=False)
    assert floor.area == pytest.approx(building.free.area, rel=1e-9)
    assert (floor.face_normals[:, 2] > 0).all()
    lengths = np.linalg.norm(np.diff(wall_sides(rings), axis=1), axis=2).sum()
    assert lengths == pytest.approx(building.free.length, rel=1e-9)


def test_without_outlines_there_are_no_walls():
    assert len(wall_mesh([], 2.5)[1]) == len(floor_mesh([])[1]) == 0
    assert facing_free([np.zeros((3, 2))]) == []


def test_upper_edges_follow_the_walls_and_are_few():
    """A staircase of 5 cm steps along 4 m is one line, and no edge is more than 5 cm from its outline."""
    steps = [[0.0, 0.0]]
    for k in range(80):
        steps += [[0.05 * (k + 1), 0.025 * (k % 2)], [0.05 * (k + 1), 0.025 * ((k + 1) % 2)]]
    ring = np.array([*steps, [4.0, 3.0], [0.0, 3.0], [0.0, 0.0]])
    edges = upper_edges([ring], 2.5)
    assert len(edges) < 8 < 100 < len(wall_sides([ring]))
    assert (edges[..., 2] == 2.5).all()
    lines = shapely.linestrings(edges[..., :2])
    assert shapely.hausdorff_distance(shapely.LinearRing(ring), shapely.union_all(lines)) <= EDGE_M


@pytest.mark.parametrize(("aspect", "covered"), [(0.46, COVERED), (0.85, 0.0), (1.24, 0.0), (1.78, 0.0)])
@pytest.mark.parametrize("size", [(6.2, 3.0), (4.0, 15.0), (30.0, 30.0)])
def test_the_view_from_above_shows_all_of_a_plan(size, aspect, covered):
    """Each corner of the walls is in the free part of the window, with a margin of 3 to 5 %, and one is at its border.

    Projected by hand: the eye looks along `ahead`, x is to the right, coordinates are relative to half of the window.
    """
    low, high, tall = np.array([-1.0, 2.0]), np.array([-1.0, 2.0]) + size, 2.5
    eye, target = view_from_above(low, high, aspect, tall, covered)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right, down = np.array([1.0, 0.0, 0.0]), np.cross(ahead, [1.0, 0.0, 0.0])
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (0.0, tall)])
    deep = (corners - eye) @ ahead
    half = math.tan(math.radians(FIELD_DEG) / 2)
    x, y = (corners - eye) @ right / deep / half / aspect, (corners - eye) @ down / deep / half
    lower = 1 - 2 * covered
    assert (np.abs(x) < 0.95).all() and (y > -0.95).all() and (y < lower - 0.03).all()
    assert np.abs(x).max() > 0.9 or (y.min() < -0.85 and y.max() > lower - 0.5)
    assert target[2] == pytest.approx(0, abs=1e-9), "it turns around a place on the floor"
