"""Closed surfaces, and whether points are on the same sides of them, judged by bodies whose inside is known."""

import numpy as np
import pytest
import trimesh

from wireless.geometry.closed_surfaces import Sides, surfaces_of

RNG = np.random.default_rng(0)


def box(low, high):
    return trimesh.creation.box(bounds=np.array([low, high], float))


def joined(*parts):
    return trimesh.util.concatenate(parts)


def test_a_body_splits_space_in_two():
    """Of 3,000 points those within a sphere's facets, by their planes, are on one side and all others on another."""
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=0.8)
    points = RNG.uniform(-1, 1, (3000, 3))
    depth = np.einsum("fi,nfi->nf", sphere.face_normals, points[:, None] - sphere.triangles[:, 0]).max(axis=1)
    sides = Sides(sphere)
    inside, outside = points[depth < -1e-6], points[depth > 1e-6]
    assert len(inside) > 500 and len(outside) > 500
    assert sides.alike(inside) and sides.alike(outside)
    for one in inside[:20]:
        assert not sides.alike(np.vstack([one, outside[:1]]))


def test_two_bodies_are_distinguished():
    """In one box, in the other, in both and in none: four sides, where a parity over both would know two."""
    sides = Sides(joined(box((0, 0, 0), (2, 2, 2)), box((1, 1, 1), (3, 3, 3))))
    places = np.array([(0.5, 0.5, 0.5), (2.5, 2.5, 2.5), (1.5, 1.5, 1.5), (2.5, 0.5, 0.5)])
    for i in range(4):
        for j in range(4):
            assert sides.alike(places[[i, j]]) == (i == j)


def test_blocks_that_meet_in_an_edge_are_closed():
    """The edge has four triangles, so that the mesh is not called watertight; a box without its lid is open."""
    blocks = joined(box((0, 0, 0), (1, 1, 1)), box((1, 1, 0), (2, 2, 1)))
    blocks.merge_vertices()
    assert not blocks.is_watertight
    surface, closed, _ = surfaces_of(blocks)
    assert closed.tolist() == [True] and (surface == 0).all()
    bowl = box((0, 0, 0), (1, 1, 1))
    bowl.update_faces(bowl.face_normals[:, 2] < 0.5)
    surface, closed, _ = surfaces_of(joined(bowl, box((3, 3, 3), (4, 4, 4))))
    assert sorted(closed.tolist()) == [False, True]
    sides = Sides(joined(bowl, box((3, 3, 3), (4, 4, 4))))
    assert sides.alike(np.array([(0.5, 0.5, 0.5), (0.5, 0.5, 2.0)]))
    assert not sides.alike(np.array([(0.5, 0.5, 0.5), (3.5, 3.5, 3.5)]))


@pytest.mark.parametrize("at", [(1.0, 0.4, 0.3), (1.0, 1.0, 0.3), (1.0, 1.0, 1.0), (0.2, 0.3, 0.0)])
def test_a_point_on_a_surface_is_on_no_side(at):
    """On a face, a side or a corner: from there lines lead off on both sides."""
    sides = Sides(box((0, 0, 0), (1, 1, 1)))
    assert not sides.alike(np.array([at]))
    assert sides.alike(np.array([at]) + 0.5 * np.sign(np.array(at) - 0.5 + 1e-3))


def test_a_sheet_with_two_faces_is_open():
    """Each of its triangles stands twice, back to back, as scans have them: one passes it as one wall."""
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    sheet = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3), (2, 1, 0), (3, 2, 0)], process=False)
    surface, closed, _ = surfaces_of(joined(sheet, box((3, 3, 3), (4, 4, 4))))
    assert not closed[surface[:4]].any() and closed[surface[4:]].all()


def test_a_mesh_without_closed_surfaces_has_all_points_on_one_side():
    """A sheet alone; nothing to count."""
    sheet = trimesh.Trimesh(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)], process=False
    )
    sides = Sides(sheet)
    assert not sides.closed.any()
    assert sides.alike(RNG.normal(size=(5, 3)))


def test_a_face_that_stands_twice_is_met_once():
    """Whichever face of a box is doubled, its inside stays inside."""
    whole, places = box((0, 0, 0), (1, 1, 1)), np.array([(0.5, 0.5, 0.5), (3, 3, 3)])
    for face in whole.faces:
        for doubled in (face, face[::-1]):
            sides = Sides(trimesh.Trimesh(whole.vertices, [*whole.faces, doubled], process=False))
            assert sides.closed.all() and not sides.alike(places)


def test_a_point_is_found_inside_one_of_two_bodies():
    """Boxes that overlap: in each alone, in both, in none, and on the side of one."""
    both = joined(box((0, 0, 0), (2, 2, 2)), box((1, 1, 1), (3, 3, 3)))
    sides = Sides(both)
    places = np.array([(0.5, 0.5, 0.5), (2.5, 2.5, 2.5), (1.5, 1.5, 1.5), (2.5, 0.5, 0.5), (2, 0.5, 0.5)])
    first, second = (np.full(len(places), sides.surface[face]) for face in (0, 12))
    inside, on = sides.inside(places, first)
    assert inside[:4].tolist() == [True, False, True, False] and on.tolist() == [False] * 4 + [True]
    inside, on = sides.inside(places, second)
    assert inside.tolist() == [False, True, True, False, False] and not on.any()
