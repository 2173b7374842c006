"""Tracing in space: the same as floor plans where both hold, however the scene is rotated."""

from types import SimpleNamespace

import numpy as np
import pytest
import shapely
import trimesh
from scipy.constants import speed_of_light
from scipy.spatial.transform import Rotation

from tests.wireless.tracing.path_rows import table
from wireless.geometry.facets import find_surfaces, floor_and_ceiling, without_rims
from wireless.geometry.occlusion import is_hidden, make_tree
from wireless.paths import Interaction
from wireless.tracing.tracer import SceneError, Tracer, TracerConfig

BEND = (0.0, 0.0), (9.0, 0.0), (9.0, 3.0), (4.0, 3.0), (4.0, 7.0), (0.0, 7.0)
PILLAR = (2.0, 2.0), (2.6, 2.1), (2.4, 2.7)
TX = np.array([[1.1, 5.37, 1.5], [8.2, 2.1, 0.3]])
RX = np.array([[7.3, 1.2, 1.2], [3.2, 1.1, 1.8], [0.7, 0.9, 1.5], [5.03, 2.73, 1.0]])


@pytest.fixture(scope="module")
def walls(ring):
    return np.concatenate([ring(*BEND), ring(*PILLAR)])


@pytest.mark.parametrize("floor_ceiling", [False, True])
@pytest.mark.parametrize("edge_reflections", [0, 2])
def test_floor_plan_and_space_find_the_same_paths(extruded, walls, floor_ceiling, edge_reflections):
    """Two methods that share no geometry: views through triangles, and chains of images with a box tree.

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
    shifted = Tracer(tilted, config=TracerConfig(scene="auto", **config)).trace(
        TX @ turn.T + shift, RX @ turn.T + shift
    )
    assert len(still) == len(shifted) > 300
    one, other = (
        np.column_stack([p.link, p.delay_s * speed_of_light, 1e3 * np.sqrt(p.power)])
        for p in (still, shifted)
    )
    np.testing.assert_allclose(
        one[np.lexsort(np.round(one, 7).T)], other[np.lexsort(np.round(other, 7).T)], rtol=0, atol=1e-7
    )


def test_furniture_is_seen_over_and_bent_around_at_its_top(extruded, ring):
    """A table-high block in a room: no floor plan. Above it there is sight, behind it rims diffract.

    Over the near and the far top rim the paths are those unfolded over these edges, by hand.
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


def crossed(triangle, p, q):
    """Whether some triangle crosses each segment, by signed volumes of tetrahedra."""
    a, b, c = (triangle[None, :, k] for k in range(3))

    def volume(o, x, y, z):
        return np.einsum("...i,...i->...", np.cross(x - o, y - o), z - o)

    ends = volume(a, b, c, p[:, None]) * volume(a, b, c, q[:, None]) < 0
    turns = [volume(p[:, None], q[:, None], x, y) > 0 for x, y in ((a, b), (b, c), (c, a))]
    return (ends & (turns[0] == turns[1]) & (turns[1] == turns[2])).any(axis=1)


def test_sight_past_random_triangles_is_that_of_brute_force():
    """400 random triangles, 3000 segments, far from the origin too: hidden where some triangle crosses.

    Judge: signed volumes of the five tetrahedra, all triangles at once, no tree.
    """
    rng = np.random.default_rng(2)
    for shift in (0.0, 1e4):
        triangle = rng.uniform(0, 10, (400, 1, 3)) + rng.uniform(-0.6, 0.6, (400, 3, 3)) + shift
        p, q = rng.uniform(0, 10, (2, 3000, 3)) + shift
        expected = crossed(triangle, p, q)
        tree = make_tree(triangle)
        got = np.array([is_hidden(tree, a, b) for a, b in zip(p, q, strict=True)])
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


OUTLINES = {
    "convex": (((0, 0), (9, 0), (9, 7), (0, 7)), [[(4, 0.2), (4, 3)], [(4, 3), (4, 6)], [(4, 3), (8, 3)]]),
    "bent": (BEND, [[(4, 0.2), (4, 2.8)], [(0.5, 4.2), (3.4, 4.4)], [(6.1, 0.4), (6.3, 2.2)]]),
}


@pytest.mark.parametrize("slab", ["rectangle", "outline"])
@pytest.mark.parametrize("shape", OUTLINES)
def test_walls_are_passed_alike_in_floor_plan_and_space(extruded, ring, shape, slab):
    """Partitions and a pillar that transmit, two walls per path: both methods find the same paths, to 1e-8.

    Each reflected and each diffracted path may pass walls on any leg; the layers' ratios depend on the angle and
    the polarisation there. Through the walls of a bent building the rims of its floor and ceiling are seen
    from outside, be they at the foot of the wall or farther out: neither method bends rays around them, for
    floors and ceilings are taken to go on. (Outside they reflect in floor plans, so not where they end.)
    """
    outer, inner = OUTLINES[shape]
    walls = np.concatenate([ring(*outer), ring(*PILLAR), inner])
    mesh = extruded(walls, floor=slab == "rectangle", ceiling=slab == "rectangle")
    if slab == "outline":
        flat = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(outer)))
        corners = np.concatenate([shapely.get_coordinates(t)[:3] for t in flat])
        slabs = np.concatenate([np.insert(corners, 2, z, axis=1) for z in (0.0, 3.0)])
        faces = np.arange(len(slabs)).reshape(-1, 3)
        mesh = trimesh.util.concatenate([mesh, trimesh.Trimesh(slabs, faces, process=False)])
    plan, space = (
        Tracer(
            mesh,
            config=TracerConfig(
                scene=scene,
                max_reflections=2,
                max_transmissions=2,
                wall_thickness_m=0.1,
                floor_ceiling=slab == "rectangle",
                max_paths=2000,
            ),
        ).trace(TX, RX)
        for scene in ("plan", "space")
    )
    through = (plan.interaction == Interaction.TRANSMISSION).sum(axis=1)
    assert (np.bincount(through, minlength=3) > 50).all()
    assert len(plan) == len(space)
    np.testing.assert_allclose(table(space), table(plan), rtol=0, atol=1e-8)


def test_lids_keep_their_rims_and_ceilings_do_not(extruded, ring):
    """A box on a larger plane bends rays at the four rims of its top; a closed room at upright edges only."""
    plane = trimesh.creation.box(bounds=[(-9, -9, -1), (9, 9, 0)])
    box = trimesh.creation.box(bounds=[(-1, -1, 0), (1, 1, 2)])
    room = extruded(np.concatenate([ring(*BEND), ring(*PILLAR)]), floor=True, ceiling=True)
    for mesh, expected in ((trimesh.util.concatenate([plane, box]), 4), (room, 0)):
        surfaces = find_surfaces(mesh, np.zeros(len(mesh.faces), int), 1e-6)
        stored = without_rims(surfaces, floor_and_ceiling(surfaces))
        rims, before = (
            (np.abs(s.edge[..., 2] - mesh.bounds[1, 2]) < 1e-9).all(axis=1).sum() for s in (stored, surfaces)
        )
        assert rims == expected and before >= 4
        upright = [(np.abs(s.edge_wedge[:, 0, 2]) > 1 - 1e-9).sum() for s in (stored, surfaces)]
        assert upright[0] == upright[1] >= 8


def furnished_room(extruded, ring):
    """A room with a doorway, and four turned boxes that stand on the floor or hang in the air."""
    rng = np.random.default_rng(4)
    door = [[(4, 0), (4, 2.2)], [(4, 3.4), (4, 6)]]
    parts = [extruded(np.concatenate([ring((0, 0), (8, 0), (8, 6), (0, 6)), door]), floor=True, ceiling=True)]
    for lift in (0.0, 0.0, 0.9, 0.4):
        size = rng.uniform(0.4, 1.2, 3)
        box = trimesh.creation.box(size)
        box.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0, 3), (lift, 0.2 * lift, 1)))
        low = box.bounds[0, 2]
        box.apply_translation(np.append(rng.uniform((1, 1), (7, 5)), lift - low))
        parts.append(box)
    return trimesh.util.concatenate(parts)


def test_all_paths_among_furniture_are_those_of_brute_force(extruded, ring):
    """Chains of up to two facets, and each edge with up to one: every one tried, all legs past all triangles.

    Judge: images, the shortest path over an edge by ternary search, signed volumes; no cones, no bounds, no
    tree. Numbers of interactions and lengths agree to 1e-6 m. A method that leaves out a chain too many fails here,
    where boxes are turned and hide each other in part.
    """
    mesh = furnished_room(extruded, ring)
    rng = np.random.default_rng(6)
    places = rng.uniform((0.3, 0.3, 1.2), (7.7, 5.7, 2.7), (7, 3))
    config = TracerConfig(max_reflections=2, floor_ceiling=True, max_paths=3000)
    paths = Tracer(mesh, config=config).trace(places[:1], places[1:])
    bent = (paths.interaction == Interaction.DIFFRACTION).any(axis=1)
    got = np.column_stack([paths.rx, paths.order, bent, paths.delay_s * speed_of_light])
    surfaces = find_surfaces(mesh, np.zeros(len(mesh.faces), int), 1e-6)
    expected = np.array(
        [(i, *route) for i, rx in enumerate(places[1:]) for route in brute_force(surfaces, places[0], rx)]
    )
    assert len(expected) > 150 and 30 < bent.sum() < len(got) - 30
    assert len(got) == len(expected)
    got, expected = (rows[np.lexsort(np.round(rows[:, ::-1], 6).T)] for rows in (got, expected))
    np.testing.assert_allclose(got, expected, atol=1e-6)


def brute_force(surfaces, tx, rx):
    """Interactions, whether there is an edge, and length of each path of a link."""
    facets = range(len(surfaces.facet_face))
    chains = [(), *((f,) for f in facets), *((f, g) for f in facets for g in facets if f != g)]
    for chain in chains:
        points = reflections(surfaces, tx, chain, rx)
        if points is not None and in_sight(surfaces.triangle, [tx, *points, rx]):
            yield len(chain), 0, route_length([tx, *points, rx])
    middle = surfaces.edge.mean(axis=1)
    ends = surfaces.triangle.min(axis=(0, 1)), surfaces.triangle.max(axis=(0, 1))
    outer = (np.abs(middle - ends[0]) < 1e-9).sum(axis=1) + (np.abs(middle - ends[1]) < 1e-9).sum(axis=1)
    edges = surfaces.edge[outer < 2]  # corners of the room are edges on the outside only
    for before, after in [((), ()), *(((f,), ()) for f in facets), *(((), (f,)) for f in facets)]:
        start, stop = images(surfaces, tx, before)[-1], images(surfaces, rx, after)[-1]
        bends, inside = shortest_over(edges, start, stop)
        for bend in bends[inside]:
            one, other = reflections(surfaces, tx, before, bend), reflections(surfaces, rx, after, bend)
            if one is None or other is None:
                continue
            points = [tx, *one, bend, *other[::-1], rx]
            if in_sight(surfaces.triangle, points):
                yield len(points) - 2, 1, route_length(points)


def route_length(points):
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


def images(surfaces, source, chain):
    """A point and its images."""
    found = [source]
    for f in chain:
        normal = surfaces.facet_normal[f]
        found.append(found[-1] - 2 * ((found[-1] - surfaces.facet_point[f]) @ normal) * normal)
    return found


def reflections(surfaces, source, chain, target):
    """Points on facets from the source on; None if one is not in its facet."""
    points = []
    for f, image in zip(chain[::-1], images(surfaces, source, chain)[:0:-1], strict=True):
        normal, at = surfaces.facet_normal[f], surfaces.facet_point[f]
        a, b = (image - at) @ normal, (target - at) @ normal
        if a * b >= 0:
            return None
        target = image + a / (a - b) * (target - image)
        own = surfaces.triangle[surfaces.facet_start[f] : surfaces.facet_start[f + 1]]
        turns = np.einsum("tki,i->tk", np.cross(np.roll(own, -1, axis=1) - own, target - own), normal)
        if not ((turns > 0).all(axis=1) | (turns < 0).all(axis=1)).any():
            return None
        points.insert(0, target)
    return points


def shortest_over(edges, start, stop):
    """Where the path over each edge is shortest, by ternary search, and whether that is not at its ends."""
    low, high = np.zeros(len(edges)), np.ones(len(edges))

    def at(share):
        return edges[:, 0] + share[:, None] * (edges[:, 1] - edges[:, 0])

    def length(share):
        return np.linalg.norm(at(share) - start, axis=1) + np.linalg.norm(at(share) - stop, axis=1)

    for _ in range(60):
        third = (high - low) / 3
        nearer = length(low + third) < length(high - third)
        low, high = np.where(nearer, low, low + third), np.where(nearer, high - third, high)
    return at(low), (low > 1e-6) & (low < 1 - 1e-6)


def in_sight(triangle, points):
    """Whether no triangle crosses a leg, less 1e-6 m at both ends."""
    p, q = np.array(points[:-1]), np.array(points[1:])
    if np.linalg.norm(q - p, axis=1).min() < 1e-6:  # an edge lies in its own faces
        return False
    route = (q - p) / np.linalg.norm(q - p, axis=1)[:, None] * 1e-6
    return not crossed(triangle, p + route, q - route).any()


def test_a_wall_passed_where_its_triangles_meet_is_one_wall(extruded):
    """Through the middle of a rectangle, which lies on its diagonal, and through it doubled: one interaction."""
    wall = extruded([[(0, 0), (4, 0)]], low=0, high=4)
    options = {"max_reflections": 0, "diffraction": False, "max_transmissions": 3, "wall_thickness_m": 0.1}
    for mesh in (wall, trimesh.util.concatenate([wall, wall])):
        tracer = Tracer(mesh, config=TracerConfig(scene="space", **options))
        paths = tracer.trace(np.array([[2.0, -1, 2]]), np.array([[2.0, 1, 2]]))
        assert paths.order.tolist() == [1]
        np.testing.assert_allclose(paths.point[0, 0], (2, 0, 2), atol=1e-12)


@pytest.fixture(params=["plan", "space"])
def traced(request, extruded, walls):
    """Traces the walls with floor and ceiling, as plan and in space, with two reflections about an edge."""
    mesh = extruded(walls, floor=True, ceiling=True)

    def trace(tx, rx, **options):
        config = TracerConfig(scene=request.param, diffraction_reflections=2, max_paths=4000, **options)
        return Tracer(mesh, config=config).trace(tx, rx)

    return trace


def test_floor_and_ceiling_of_meshes_reflect_unless_they_are_floor_plans():
    """By geometry alone, whatever engine traces it; a building is a floor plan also with furniture in it."""
    room, table = trimesh.creation.box((4, 4, 2.5)), trimesh.creation.box((1, 1, 0.5))
    turned = room.copy()
    turned.apply_transform(trimesh.transformations.rotation_matrix(0.3, (0, 0, 1)))
    turned.vertices = turned.vertices.astype(np.float32)
    furnished = trimesh.util.concatenate([room, table])
    building = SimpleNamespace(
        mesh=furnished, materials=("concrete",), face_material=np.zeros(24, int), floor_ceiling=False
    )
    for scene, engine, expected in (
        (room, "auto", False),
        (room, "space", False),
        (turned, "space", False),
        (furnished, "auto", True),
        (building, "auto", False),
    ):
        assert Tracer(scene, config=TracerConfig(scene=engine)).config.floor_ceiling is expected


@pytest.mark.parametrize("floor_ceiling", [False, True])
def test_reflections_on_a_side_of_an_edge_are_limited(traced, floor_ceiling):
    """At most one before and one after the edge: of all paths with two reflections exactly those, to 1e-12.

    Two on one side are left out, also if the floor is one of them; paths without an edge keep their three.
    """
    every, limited = (
        traced(TX, RX, floor_ceiling=floor_ceiling, diffraction_side_reflections=side) for side in (None, 1)
    )
    edge = every.interaction == Interaction.DIFFRACTION
    mirror = every.interaction == Interaction.REFLECTION
    before = (mirror & (np.cumsum(edge, axis=1) == 0)).sum(axis=1)
    after = mirror.sum(axis=1) - before
    wanted = every.select(~edge.any(axis=1) | ((before <= 1) & (after <= 1)))
    assert len(every) > len(wanted) > 0
    assert (edge.any(axis=1) & (before == 1) & (after == 1)).any()
    np.testing.assert_allclose(table(limited), table(wanted), rtol=0, atol=1e-12)


@pytest.mark.parametrize("floor_ceiling", [False, True])
def test_all_interactions_together_are_limited(traced, floor_ceiling):
    """At most three, walls passed through the pillar too: of all paths exactly those of up to three, to 1e-12."""
    every, limited = (
        traced(
            TX[:1],
            RX[:2],
            floor_ceiling=floor_ceiling,
            max_transmissions=2,
            wall_thickness_m=0.1,
            max_interactions=most,
        )
        for most in (None, 3)
    )
    wanted = every.select(every.order <= 3)
    assert len(every) > len(wanted) > 0
    edge = (every.interaction == Interaction.DIFFRACTION).any(axis=1)
    assert min(every.order[edge].max(), every.order[~edge].max()) > 3
    assert (limited.interaction == Interaction.TRANSMISSION).any()
    np.testing.assert_allclose(table(limited), table(wanted), rtol=0, atol=1e-12)


def test_points_above_a_plan_are_traced_in_space():
    """A lone cylinder looks like a floor plan; over it, paths are those of scene='space', between, of the plan."""
    cylinder = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=12)
    tx, rx = np.array([[3.0, 0.3, 0.5]]), np.array([[-3.0, 1.2, 4.0], [2.5, -2.0, 0.2]])
    auto, space = (
        Tracer(cylinder, config=TracerConfig(scene=scene)).trace(tx, rx) for scene in ("auto", "space")
    )
    assert len(auto) == len(space) > 2
    np.testing.assert_array_equal(auto.power_db, space.power_db)
    within = Tracer(cylinder).trace(tx, rx[1:])
    plan = Tracer(cylinder, config=TracerConfig(scene="plan")).trace(tx, rx[1:])
    np.testing.assert_array_equal(within.power_db, plan.power_db)
