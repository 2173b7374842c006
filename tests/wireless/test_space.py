"""Tracing in space: the same as floor plans where both hold, whichever way the scene is turned."""

import numpy as np
import pytest
import shapely
import trimesh
from scipy.constants import speed_of_light
from scipy.spatial.transform import Rotation

from wireless.geometry import find_surfaces
from wireless.occlusion import hidden_each, make_tree
from wireless.paths import Interaction
from wireless.raytrace import SceneError, Tracer, TracerConfig

BEND = (0.0, 0.0), (9.0, 0.0), (9.0, 3.0), (4.0, 3.0), (4.0, 7.0), (0.0, 7.0)
PILLAR = (2.0, 2.0), (2.6, 2.1), (2.4, 2.7)
TX = np.array([[1.1, 5.37, 1.5], [8.2, 2.1, 0.3]])
RX = np.array([[7.3, 1.2, 1.2], [3.2, 1.1, 1.8], [0.7, 0.9, 1.5], [5.03, 2.73, 1.0]])


@pytest.fixture(scope="module")
def walls(ring):
    return np.concatenate([ring(*BEND), ring(*PILLAR)])


def table(paths):
    """Link, order, length, azimuths, elevations and gain of each path, in an order of its own."""
    rows = np.column_stack(
        [
            paths.link,
            paths.order,
            paths.delay_s * speed_of_light,
            np.cos(paths.aod_az),
            np.sin(paths.aoa_az),
            paths.aod_el,
            paths.aoa_el,
            np.abs(paths.gain).reshape(-1, 4) * 1e3,
        ]
    )
    return rows[np.lexsort(np.round(rows[:, ::-1], 7).T)]


@pytest.mark.parametrize("floor_ceiling", [False, True])
@pytest.mark.parametrize("edge_reflections", [0, 2])
def test_floor_plan_and_space_find_the_same_paths(extruded, walls, floor_ceiling, edge_reflections):
    """Two ways that share no geometry: views through triangles, and chains of images with a box tree.

    Every path of up to three reflections, or an edge and two, agrees in length, angles and four gains to
    1e-8.
    """
    mesh = extruded(walls, floor=True, ceiling=True)
    plan, space = (
        Tracer(
            mesh,
            config=TracerConfig(
                scene=scene,
                floor_ceiling=floor_ceiling,
                diffraction_reflections=edge_reflections,
                max_paths=2000,
            ),
        ).trace(TX, RX)
        for scene in ("plan", "space")
    )
    assert len(plan) == len(space) > 100
    np.testing.assert_allclose(table(space), table(plan), rtol=0, atol=1e-8)


def test_tilted_scene_keeps_lengths_and_powers(extruded, walls):
    """Turned about a slanted axis nothing is upright: same delays, same power over all polarisations.

    Only there do reflections and edges mix all field components; a wrong basis changes the sum of squares.
    """
    turn, shift = Rotation.from_rotvec([0.7, -0.4, 0.3]).as_matrix(), np.array([100.0, -3.0, 20.0])
    mesh = extruded(walls, floor=True, ceiling=True)
    tilted = trimesh.Trimesh(mesh.vertices @ turn.T + shift, mesh.faces, process=False)
    config = {"floor_ceiling": True, "max_paths": 2000, "polarisation": "both"}
    still = Tracer(mesh, config=TracerConfig(**config)).trace(TX, RX)
    moved = Tracer(tilted, config=TracerConfig(scene="auto", **config)).trace(
        TX @ turn.T + shift, RX @ turn.T + shift
    )
    assert len(still) == len(moved) > 300
    one, other = (
        np.column_stack([p.link, p.delay_s * speed_of_light, 1e3 * np.sqrt(p.power)]) for p in (still, moved)
    )
    np.testing.assert_allclose(
        one[np.lexsort(np.round(one, 7).T)], other[np.lexsort(np.round(other, 7).T)], rtol=0, atol=1e-7
    )


def test_furniture_is_seen_over_and_bent_around_at_its_top(extruded, ring):
    """A table-high block in a room: no floor plan. Above it there is sight, behind it rims diffract.

    Over the near and the far top rim the ways are those unfolded over these edges, by hand.
    """
    box = trimesh.creation.box(bounds=[(2, -40, 0), (3, 40, 1)])
    room = extruded(ring((-3, -50), (8, -50), (8, 50), (-3, 50)), floor=True)
    mesh = trimesh.util.concatenate([room, box])
    with pytest.raises(SceneError, match="scene='space'"):
        Tracer(mesh, config=TracerConfig(scene="plan"))
    tracer = Tracer(mesh, config=TracerConfig(max_reflections=0, diffraction_reflections=0))
    tx = np.array([[0.0, 0.0, 0.7]])
    paths = tracer.trace(tx, np.array([[5.0, 0.0, 2.5], [2.2, 0.0, 1.4]]))
    assert paths.between(0, 0).order.tolist()[0] == 0
    hit = paths.between(0, 1).point[paths.between(0, 1).order == 1][:, 0]
    assert any(np.allclose(p, (2, 0, 1), atol=1e-9) for p in hit)
    lengths = paths.between(0, 1).delay_s * speed_of_light
    assert np.abs(lengths - np.hypot(2, 0.3) - np.hypot(0.2, 0.4)).min() < 1e-9


def test_sight_past_random_triangles_is_that_of_brute_force():
    """400 random triangles, 3000 segments, far from the origin too: hidden where some triangle crosses.

    Judge: signed volumes of the five tetrahedra, all triangles at once, no tree.
    """
    rng = np.random.default_rng(2)
    for shift in (0.0, 1e4):
        triangle = rng.uniform(0, 10, (400, 1, 3)) + rng.uniform(-0.6, 0.6, (400, 3, 3)) + shift
        p, q = rng.uniform(0, 10, (2, 3000, 3)) + shift
        a, b, c = (triangle[None, :, k] for k in range(3))

        def volume(o, x, y, z):
            return np.einsum("...i,...i->...", np.cross(x - o, y - o), z - o)

        ends = volume(a, b, c, p[:, None]) * volume(a, b, c, q[:, None]) < 0
        turns = [volume(p[:, None], q[:, None], x, y) > 0 for x, y in ((a, b), (b, c), (c, a))]
        expected = (ends & (turns[0] == turns[1]) & (turns[1] == turns[2])).any(axis=1)
        tree = make_tree(triangle)
        got = hidden_each(tree, p, q)
        assert np.array_equal(got, expected) and 0.2 < got.mean() < 0.95


def test_facets_and_edges_of_a_cut_and_doubled_box():
    """A cube in 6 x 32 triangles, some twice, some turned: 6 facets and 12 edges of 270 degrees, whole."""
    box = trimesh.creation.box((2, 2, 2)).subdivide().subdivide()
    mesh = trimesh.util.concatenate([box, trimesh.creation.box((2, 2, 2))])
    mesh.faces[::3] = mesh.faces[::3, ::-1]
    surfaces = find_surfaces(mesh, np.zeros(len(mesh.faces), int), 1e-6)
    assert len(surfaces.facet_face) == 6 and len(surfaces.edge) == 12
    np.testing.assert_allclose(surfaces.edge_gap_rad, 1.5 * np.pi, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(np.diff(surfaces.edge, axis=1), axis=2), 2, atol=1e-9)


def test_wall_on_a_floor_has_no_edge_at_its_foot(extruded):
    """One sheet on a larger floor, sharing no vertex with it: edges at its top and sides, not below."""
    wall = extruded([[(0, 0), (4, 0)]])
    floor = trimesh.Trimesh(
        [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)], process=False
    )
    surfaces = find_surfaces(trimesh.util.concatenate([wall, floor]), np.zeros(4, int), 1e-6)
    own = surfaces.edge[np.abs(surfaces.edge[..., 0] - 2).max(axis=1) < 3]
    lines = shapely.linestrings(own[:, :, [0, 2]])
    expected = shapely.linestrings([[(0, 0), (0, 3)], [(0, 3), (4, 3)], [(4, 3), (4, 0)]])
    assert shapely.union_all(lines).equals(shapely.union_all(expected))
    np.testing.assert_allclose(surfaces.edge_gap_rad, 2 * np.pi, atol=1e-9)


def test_walls_are_passed_alike_in_floor_plan_and_space(extruded, ring):
    """Partitions and a pillar that let through two walls a path: both ways find the same paths, to 1e-8.

    Each reflected and each diffracted path may pass walls on any leg; the layers' ratios depend on the angle and
    the polarisation there. The outline is convex: outside of others the rims of floor and ceiling diffract,
    which floor plans leave out.
    """
    outer = ring((0, 0), (9, 0), (9, 7), (0, 7))
    inner = [[(4, 0.2), (4, 3)], [(4, 3), (4, 6)], [(4, 3), (8, 3)]]
    mesh = extruded(np.concatenate([outer, ring(*PILLAR), inner]), floor=True, ceiling=True)
    plan, space = (
        Tracer(
            mesh,
            config=TracerConfig(
                scene=scene,
                max_reflections=2,
                max_transmissions=2,
                wall_thickness_m=0.1,
                floor_ceiling=True,
                max_paths=2000,
            ),
        ).trace(TX, RX)
        for scene in ("plan", "space")
    )
    through = (plan.interaction == Interaction.TRANSMISSION).sum(axis=1)
    assert (np.bincount(through, minlength=3) > 50).all()
    assert len(plan) == len(space)
    np.testing.assert_allclose(table(space), table(plan), rtol=0, atol=1e-8)


def test_a_wall_passed_where_its_triangles_meet_is_one_wall(extruded):
    """Through the middle of a rectangle, which lies on its diagonal, and through it doubled: one interaction."""
    wall = extruded([[(0, 0), (4, 0)]], low=0, high=4)
    options = {"max_reflections": 0, "diffraction": False, "max_transmissions": 3, "wall_thickness_m": 0.1}
    for mesh in (wall, trimesh.util.concatenate([wall, wall])):
        tracer = Tracer(mesh, config=TracerConfig(scene="space", **options))
        paths = tracer.trace(np.array([[2.0, -1, 2]]), np.array([[2.0, 1, 2]]))
        assert paths.order.tolist() == [1]
        np.testing.assert_allclose(paths.point[0, 0], (2, 0, 2), atol=1e-12)
