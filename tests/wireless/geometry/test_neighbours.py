"""Neighbours of patches and edges, and pairs next to pairs, judged by bodies that can be counted by hand."""

import numpy as np
import trimesh

from wireless.geometry.facets import find_surfaces
from wireless.geometry.neighbours import Neighbours, edge_neighbours, patch_neighbours, with_neighbours
from wireless.geometry.space import make_space


def space_of(mesh):
    surfaces = find_surfaces(mesh, np.zeros(len(mesh.faces), int), 1e-6)
    every = np.ones(len(surfaces.facet_face), bool)
    return make_space(surfaces, every, ~every)


def test_sides_of_a_box_are_neighbours_of_all_but_the_opposite_one():
    """Five of six, each itself among them, and five of its twelve edges, by a corner; a second box has none of them."""
    far = trimesh.creation.box(bounds=np.array([(5.0, 5.0, 5.0), (6.0, 6.0, 6.0)]))
    space = space_of(trimesh.util.concatenate([trimesh.creation.box(), far]))
    patches, edges = patch_neighbours(space), edge_neighbours(space)
    normal = space.surfaces.facet_normal[space.patch_facet]
    middle = space.ground.triangle[space.ground.start[:-1]].mean(axis=1)
    for p in range(12):
        _, near = patches.of(np.array([p]))
        assert len(set(near)) == len(near) == 5 and p in near
        assert (np.linalg.norm(middle[near] - middle[p], axis=1) < 3).all()
        parallel = (abs(normal @ normal[p]) > 0.5) & (np.linalg.norm(middle - middle[p], axis=1) < 3)
        assert parallel.sum() == 2 and parallel[near].sum() == 1
    assert (np.diff(edges.start) == 5).all() and len(edges.start) == 25


def test_rows_of_neighbours_are_those_of_each_thing():
    """Things in any order, one of them twice."""
    near = Neighbours(np.array([0, 1, 4, 6]), np.array([0, 0, 1, 2, 1, 2]))
    row, other = near.of(np.array([2, 0, 2]))
    assert row.tolist() == [0, 0, 1, 2, 2]
    assert other.tolist() == [1, 2, 0, 1, 2]


def test_pairs_next_to_pairs_are_tried_and_stored():
    """On a line of ten: a neighbour of the second first, then of the first of what can be; nothing is tried twice."""
    line = Neighbours(
        np.cumsum([0, 2, *[3] * 8, 2]),
        np.concatenate([np.arange(max(i - 1, 0), min(i + 2, 10)) for i in range(10)]),
    )
    tried = []

    def possible(pairs):
        tried.extend(map(tuple, pairs.tolist()))
        return pairs[pairs[:, 1] != 6]

    got = with_neighbours(np.array([[2, 5], [2, 5]]), (line, line), possible)
    assert got.tolist() == [[a, b] for a in (1, 2, 3) for b in (4, 5)]
    assert len(set(tried)) == len(tried) and (2, 5) not in tried and (2, 6) in tried
    assert not len(with_neighbours(np.empty((0, 2), int), (line, line), possible))
