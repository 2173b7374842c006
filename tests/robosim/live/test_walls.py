"""Walls of the page from outlines alone."""

import numpy as np
import pytest
import shapely
import trimesh

from robosim.building.building import make_building
from robosim.drawing.plan_view import building_rings
from robosim.live.walls import EDGE_M, facing_free, floor_mesh, upper_edges, wall_mesh, wall_sides
from robosim.plans.files import read_plan
from tests.plans import two_rooms

SQUARE = np.array([[0.0, 0], [4, 0], [4, 3], [0, 3], [0, 0]])
ISLAND = np.array([[1.0, 1], [2, 1], [2, 2], [1, 2], [1, 1]])


@pytest.mark.parametrize("outer", [SQUARE, SQUARE[::-1]])
@pytest.mark.parametrize("inner", [ISLAND, ISLAND[::-1]])
def test_walls_face_free_space_however_outlines_are_wound(outer, inner):
    """A step from the middle of a wall along its front is free floor: inside of the room, outside of the island."""
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


def test_no_outline_makes_no_walls():
    assert len(wall_mesh([], 2.5)[1]) == len(floor_mesh([])[1]) == 0
    assert facing_free([np.zeros((3, 2))]) == []


def test_upper_edges_keep_to_the_walls_and_are_few():
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
