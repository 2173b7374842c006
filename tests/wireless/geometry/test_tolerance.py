"""What is one surface: estimates of rounding, fitted planes, and the facets and edges that come of them."""

import numpy as np
import pytest
import trimesh

from tests.wireless.tracing.rounded import Placed, box, in_32_bits, subdivided
from wireless.geometry.facets import find_surfaces
from wireless.geometry.occlusion import is_hidden
from wireless.geometry.space import make_space
from wireless.geometry.tolerance import NEAR_M, check_rounding, fit_planes, tolerance_of

TURN = (0.3, -0.8, 1.1)


def surfaces_of(mesh, snap_m=1e-6):
    return find_surfaces(mesh, np.zeros(len(mesh.faces), int), snap_m)


def hides(surfaces, p, q):
    every = np.ones(len(surfaces.facet_face), bool)
    tree = make_space(surfaces, every, ~every).tree
    return np.array([is_hidden(tree, a, b) for a, b in zip(p, q, strict=True)])


def bent_wall(rise_m, times=3):
    """Two halves of 2 x 3 m that meet along x = 0; the outer side of one rises by so much."""
    corners = np.array([(-2, 0, 0), (0, 0, 0), (2, 0, rise_m), (-2, 3, 0), (0, 3, 0), (2, 3, rise_m)], float)
    faces = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)]
    return subdivided(trimesh.Trimesh(corners, faces, process=False), times)


def test_tolerance_follows_the_size_of_coordinates_and_the_lattice_they_lie_on():
    """Steps of 32-bit numbers at the size of the mesh, or of the place where it was rounded; never below the option."""
    exact = Placed(TURN).points(box((8, 6, 2.7), (4, 3, 1.35)).vertices)
    assert 1e-6 < tolerance_of(exact, 1e-6) < 4e-6
    assert tolerance_of(exact, 1e-3) == 1e-3
    assert 1e-4 < tolerance_of(100 * exact, 1e-6) < 4e-4
    place = (3000.0, 5000.0, 0.0)
    rounded = (exact + place).astype(np.float32).astype(float) - place
    assert 4 * 2.0**-12 <= tolerance_of(rounded, 1e-6) <= 4 * 2.0**-11
    # Designed in whole metres, also far from zero in double precision: nothing was rounded.
    whole = np.array([(0, 0, 0), (8, 0, 0), (8, 6, 0), (0, 6, 3)], float)
    for place in (0.0, (691_607.0, 5_334_760.0, 519.0)):
        assert tolerance_of(whole + place, 1e-6) < 4e-6


@pytest.mark.parametrize("unit_m", [1.0, 0.001])
def test_meshes_rounded_to_32_bits_far_from_zero_are_rejected(unit_m):
    """At UTM coordinates such numbers are centimetres to half a metre apart; designed coordinates are not rounded."""
    place = np.array((691_607.3, 5_334_760.7, 519.0)) / unit_m
    turned = Placed(TURN).points(box((8, 6, 2.7), (4, 3, 1.35)).vertices) / unit_m
    check_rounding(turned + place, unit_m)
    check_rounding(turned.astype(np.float32), unit_m)
    check_rounding((turned + place / 1000).astype(np.float32), unit_m)
    whole = np.array([(0, 0, 0), (8, 0, 0), (8, 6, 0), (0, 6, 3)], float) + np.rint(place * unit_m)
    check_rounding(whole, 1.0)
    with pytest.raises(ValueError, match=r"y is rounded to 0.5\d* m, .* at 53347\d+.* m; move the mesh near"):
        check_rounding((turned + place).astype(np.float32), unit_m)
    with pytest.raises(ValueError, match=r"x is rounded to 0.06"):
        check_rounding(((turned + place) * (1, 0, 1)).astype(np.float32), unit_m)


def test_exact_planes_stay_exact_and_deviations_are_known():
    """Level facets keep bit-identical normals; rounded ones know how far their corners are off."""
    exact = subdivided(box((4, 3, 2.5), (1.1, 0.7, 1.3)), 2)
    fits = fit_planes(np.array(exact.triangles), 1e-6)
    assert len(fits.axis) == 6 and np.sort(np.abs(fits.axis), axis=1).tolist() == 6 * [[0, 0, 1]]
    assert surfaces_of(exact).near_m < 1.001 * NEAR_M
    surfaces = surfaces_of(in_32_bits(Placed(TURN, (5, 6, 7)).mesh(exact)))
    off = np.einsum("tki,ti->tk", surfaces.triangle, surfaces.facet_normal[surfaces.triangle_facet])
    off = np.abs(off - surfaces.plane[surfaces.triangle_facet, 3:]).max(axis=1)
    most = np.zeros(6)
    np.maximum.at(most, surfaces.triangle_facet, off)
    np.testing.assert_allclose(surfaces.facet_off_m, most, atol=1e-12)
    assert 1e-8 < most.max() < 1e-6 and surfaces.near_m > 2 * most.max()
    assert len(surfaces.edge) == 12


@pytest.mark.parametrize("bits", [32, 64])
def test_walls_bent_within_the_tolerance_are_one_facet_without_an_edge(bits):
    """Below the tolerance one facet; above it two, whose seam is an edge only where the bend is visible."""
    for rise_m, facets, seams in ((5e-7, 1, 0), (1e-4, 2, 0), (0.1, 2, 1)):
        placed = Placed(TURN, (1, 2, 3))
        mesh = placed.mesh(bent_wall(rise_m))
        surfaces = surfaces_of(in_32_bits(mesh) if bits == 32 else mesh)
        middle = placed.back(surfaces.edge.mean(axis=1) - placed.shift)
        assert len(surfaces.facet_face) == facets
        inner = (np.abs(middle[:, 0]) < 0.1) & (np.abs(middle[:, 1] - 1.5) < 1)
        assert inner.sum() == seams


@pytest.mark.parametrize("rise_m", [0.0, 5e-7, 2e-6, 1e-5, 1e-3, 0.1])
def test_seams_of_bent_walls_let_nothing_through(rise_m):
    """2,000 segments through points of the seam, in 32 bits: all hidden; 2,000 that pass next to the wall: none."""
    rng, placed = np.random.default_rng(0), Placed(TURN, (1, 2, 3))
    surfaces = surfaces_of(in_32_bits(placed.mesh(bent_wall(rise_m))))
    at = np.column_stack([np.zeros(2000), rng.uniform(0.01, 2.99, 2000), np.zeros(2000)])
    route = rng.uniform((-1, -1, 0.3), (1, 1, 2), (2000, 3))
    assert hides(surfaces, placed.points(at - route), placed.points(at + route)).all()
    aside = np.tile((0.0, 3.001, 0.0), (2000, 1))
    route[:, 1] = 0
    assert not hides(surfaces, placed.points(aside - route), placed.points(aside + route)).any()


def test_slivers_are_no_holes():
    """A wall that is a fan of 400 triangles, each 0.3 um wide but for the last, hides all that crosses it."""
    low = np.append(np.arange(400) * 3e-7, [1.0, 2.0])
    foot = np.column_stack([low, np.zeros_like(low), np.zeros_like(low)])
    faces = [(i, i + 1, 402) for i in range(401)] + [(401, 403, 402)]
    wall = trimesh.Trimesh(np.concatenate([foot, [(0, 2, 0), (2, 2, 0)]]), faces, process=False)
    placed, rng = Placed(TURN), np.random.default_rng(1)
    surfaces = surfaces_of(in_32_bits(placed.mesh(wall)))
    assert len(surfaces.facet_face) == 1
    at = np.column_stack([rng.uniform(0, 1.2e-4, 2000), rng.uniform(0, 0.01, 2000), np.zeros(2000)])
    route = rng.uniform((-1, -1, 0.3), (1, 1, 1), (2000, 3))
    assert hides(surfaces, placed.points(at - route), placed.points(at + route)).all()


def test_of_sheets_on_each_other_the_first_material_is_met():
    """A square of one material in the middle of another's wall: in any order of faces the first one is whole."""
    square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    wall, sheet = (trimesh.Trimesh(half * square, [(0, 1, 2), (0, 2, 3)]) for half in (2.0, 1.0))
    for order in (1, -1):
        mesh = trimesh.util.concatenate([wall, sheet][::order])
        for materials, areas in (([0, 1], [16.0]), ([1, 0], [4.0, 12.0])):
            surfaces = find_surfaces(mesh, np.repeat(materials[::order], 2), 1e-6)
            u, v = (surfaces.triangle[:, k] - surfaces.triangle[:, 0] for k in (1, 2))
            size = np.linalg.norm(np.cross(u, v), axis=1) / 2
            np.testing.assert_allclose(np.bincount(surfaces.triangle_facet, size), areas)
            assert len(surfaces.edge) == 4
