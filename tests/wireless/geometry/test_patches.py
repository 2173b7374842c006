"""Patches and convex walls of made meshes, whose number and area are known."""

import numpy as np
import pytest
import trimesh

from wireless.geometry.facets import find_surfaces
from wireless.geometry.patches import find_patches


def _sheet(*polygons) -> trimesh.Trimesh:
    """Convex polygons in the plane y = 1.3, each as a fan of triangles."""
    vertices, faces = [], []
    for polygon in polygons:
        first = len(vertices)
        vertices += [(x, 1.3, z) for x, z in polygon]
        faces += [(first, first + k, first + k + 1) for k in range(1, len(polygon) - 1)]
    return trimesh.Trimesh(vertices, faces)


def _rectangle(x, z, width, height):
    return [(x, z), (x + width, z), (x + width, z + height), (x, z + height)]


def _patches(mesh, divisions=0, rounded=False):
    for _ in range(divisions):
        mesh = mesh.subdivide()
    if rounded:
        turned = trimesh.transformations.rotation_matrix(0.3, [0.1, 0.2, 1])
        mesh.apply_transform(turned)
        mesh.vertices = mesh.vertices.astype(np.float32).astype(float)
    return find_patches(find_surfaces(mesh, np.zeros(len(mesh.faces), int), 1e-6))


def _area(corner, count):
    polygon = corner[:count]
    a, b = polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]
    return np.linalg.norm(np.cross(a, b), axis=1).sum() / 2


# Three divisions give 128 triangles, which are joined otherwise than 8.
@pytest.mark.parametrize("divisions", [1, 3])
@pytest.mark.parametrize("rounded", [False, True])
def test_find_patches_makes_a_divided_rectangle_one_wall(divisions, rounded):
    patches = _patches(_sheet(_rectangle(0, 0, 4, 3)), divisions, rounded)
    assert len(patches.wall) == len(patches.facet) == 1
    assert not patches.wall_of.any()
    assert _area(patches.window[0], patches.corners[0]) == pytest.approx(12, abs=1e-3)


@pytest.mark.parametrize("divisions", [1, 3])
def test_find_patches_counts_doubled_triangles_once(divisions):
    once = _sheet(_rectangle(0, 0, 4, 3))
    doubled = trimesh.util.concatenate([once, once])
    patches = _patches(doubled, divisions)
    assert len(patches.wall) == 1
    assert _area(patches.wall[0], 4) == pytest.approx(12)


@pytest.mark.parametrize("divisions", [1, 3])
def test_find_patches_joins_rectangles_whose_sides_meet_in_part(divisions):
    patches = _patches(_sheet(_rectangle(0, 0, 4, 3), _rectangle(4, 0, 2, 3)), divisions)
    halves = _patches(
        _sheet(_rectangle(0, 0, 4, 3), _rectangle(4, 0, 2, 1), _rectangle(4, 1, 2, 2)), divisions
    )
    for result in (patches, halves):
        assert len(result.wall) == 1
        assert _area(result.wall[0], result.wall_corners[0]) == pytest.approx(18)


@pytest.mark.parametrize("hole_m", [2.0, 0.002])
@pytest.mark.parametrize("divisions", [0, 3])
@pytest.mark.parametrize("rounded", [False, True])
def test_find_patches_leaves_a_hole_open(divisions, rounded, hole_m):
    """A hole of 2 mm takes less area than cracks along all sides may, but is wider than a crack."""
    side, rest = 1 + hole_m, 4 - 1 - hole_m
    frame = _sheet(
        _rectangle(0, 0, 1, 4),
        _rectangle(side, 0, rest, 4),
        _rectangle(1, 0, hole_m, 1),
        _rectangle(1, side, hole_m, rest),
    )
    patches = _patches(frame, divisions, rounded)
    assert len(patches.facet) == 1
    assert len(patches.wall) == len(patches.triangle)
    assert sum(map(_area, patches.wall, patches.wall_corners)) == pytest.approx(16 - hole_m**2, abs=1e-3)


def test_find_patches_separates_sheets_apart_in_one_plane():
    patches = _patches(_sheet(_rectangle(0, 0, 1, 3), _rectangle(2, 0, 1, 3), _rectangle(0, 5, 3, 1)), 2)
    assert len(patches.facet) == 3
    for k, span in enumerate(zip(patches.start[:-1], patches.start[1:], strict=True)):
        assert (patches.wall_of[patches.triangle[slice(*span)]] == k).all()


def test_find_patches_follows_the_facets_triangle_by_triangle():
    triangles = _sheet([(0, 0), (1, 0), (0, 1)], [(5, 0), (6, 0), (5, 2)])
    patches = _patches(triangles)
    assert sorted(map(_area, patches.window, patches.corners)) == pytest.approx([0.5, 1])
