"""Paths among many triangles: those that rays find candidates for, judged by exhaustive search and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from scipy.constants import speed_of_light
from scipy.spatial import cKDTree

from wireless.geometry import shooting
from wireless.geometry.facets import find_surfaces
from wireless.geometry.shooting import Shooter, directions
from wireless.geometry.space import make_space
from wireless.paths import Interaction
from wireless.tracing import candidates
from wireless.tracing.tracer import Tracer, TracerConfig

#: Rows of two searches closer than this in length [m] and angles are one path.
SAME = 1e-6
#: Paths weaker than the strongest of their link by more than this do not count for recall [dB].
RANGE_DB = 40.0
NO_AIMS = np.empty(0, np.int64)
BOUNDS = np.array([(0.0, 0.0, 0.0), (7.0, 5.0, 3.0)])


def config(search, rays=100_000, **options):
    """Two reflections, or an edge and one; all paths are returned."""
    usual = {"max_reflections": 2, "floor_ceiling": True, "max_paths": 5000}
    return TracerConfig(scene="space", search=search, rays=rays, **usual | options)


def turned_boxes(count, rng):
    """Boxes in a room, none of which is parallel to another."""
    parts = []
    for _ in range(count):
        box = trimesh.creation.box(rng.uniform(0.3, 0.9, 3))
        box.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0, 3), (0.1, 0.2, 1)))
        box.apply_translation(rng.uniform((1, 1, 0.5), (6, 4, 1.2)))
        parts.append(box)
    return parts


def scenes():
    """Small meshes with flat furniture, with a corner to look round, and with a curved thing."""
    rng = np.random.default_rng(7)
    room = trimesh.creation.box(bounds=BOUNDS)
    corner = trimesh.creation.box(bounds=[(2.5, 2.0, 0.0), (7.0, 5.0, 3.0)])
    drum = trimesh.creation.cylinder(0.4, 1.1, sections=16)
    drum.apply_translation((3.4, 2.6, 0.9))
    return {
        "furnished": trimesh.util.concatenate([room, *turned_boxes(5, rng)]),
        "bent": trimesh.util.concatenate([room, corner, *turned_boxes(1, rng)]),
        "drum": trimesh.util.concatenate([room, drum]),
    }


SCENES = scenes()


def places(count, seed):
    """Points on the near side of a room, above most furniture."""
    return np.random.default_rng(seed).uniform((0.2, 0.2, 1.3), (6.8, 1.8, 2.8), (count, 3))


def rows(paths):
    """Link, order, edge, length, directions and powers of each path."""
    bent = (paths.interaction == Interaction.DIFFRACTION).any(axis=1)
    angles = paths.aod_az, paths.aoa_az, paths.aod_el, paths.aoa_el
    return np.column_stack([10 * paths.link, paths.order, bent, paths.delay_s * speed_of_light, *angles])


def found(some, others):
    """For each path of some, the same path's number among others, or -1."""
    far, which = cKDTree(rows(others)).query(rows(some))
    return np.where(far < SAME, which, -1)


def strong(paths):
    """Paths that count for recall."""
    most = np.zeros(len(paths.tx_position) * len(paths.rx_position))
    np.maximum.at(most, paths.link, paths.power)
    return paths.power > most[paths.link] * 10 ** (-RANGE_DB / 10)


@pytest.fixture(scope="module", params=SCENES)
def judged(request):
    """A mesh, ends of links, and all paths of exhaustive search."""
    mesh, tx, rx = SCENES[request.param], places(2, 1), places(15, 2)
    return mesh, tx, rx, Tracer(mesh, config=config("exhaustive")).trace(tx, rx)


@pytest.mark.parametrize("few", [True, False])
def test_rays_find_the_strong_paths_and_no_false_one(judged, few, monkeypatch):
    """Of the paths within 40 dB of the strongest at least 99.9 % at the default number of rays; gains to 1e-9."""
    mesh, tx, rx, every = judged
    if not few:
        monkeypatch.setattr(candidates, "RAYS_A_PATCH", 10**9)
    rays = Tracer(mesh, config=config("rays")).trace(tx, rx)
    same = found(rays, every)
    assert (same >= 0).all()
    np.testing.assert_allclose(rays.gain, every.gain[same], rtol=1e-9, atol=1e-15)
    wanted = every.select(strong(every))
    assert len(wanted) > 200
    assert (found(wanted, rays) >= 0).mean() >= (1 if few else 0.999)


@pytest.mark.parametrize("law", ["nearer_face", "bisector"])
@pytest.mark.parametrize("name", SCENES)
def test_bounds_spare_none_of_the_strongest(name, law):
    """With lists of 5, 12 and 25 paths: those that are the strongest of all, with layered walls."""
    tx, rx = places(1, 21), places(20, 22)
    every = Tracer(SCENES[name], config=config("rays", diffraction_law=law)).trace(tx, rx)
    for keep in (5, 12, 25):
        stored = Tracer(SCENES[name], config=config("rays", diffraction_law=law, max_paths=keep)).trace(
            tx, rx
        )
        for link in range(len(rx)):
            want = np.sort(every.power[every.link == link])[::-1][:keep]
            np.testing.assert_allclose(stored.power[stored.link == link], want, rtol=1e-12)


def test_more_rays_find_the_same_paths_and_more():
    """Each number of rays finds what a smaller one did, up to where all is tried: directions are of one sequence."""
    np.testing.assert_array_equal(directions(300)[:100], directions(100))
    tx, rx = places(1, 3), places(10, 4)
    before = None
    counts = []
    for rays in (30, 300, 3000, 30_000):
        paths = Tracer(SCENES["furnished"], config=config("rays", rays)).trace(tx, rx)
        assert before is None or (found(before, paths) >= 0).all()
        before = paths
        counts.append(len(paths))
    assert counts[0] < counts[1] < counts[-1]


def test_what_lies_next_to_pairs_that_rays_find_is_found(monkeypatch):
    """Among many patches, of which few rays find few: next to them at least half of the paths that they miss."""
    monkeypatch.setattr(candidates, "RAYS_A_PATCH", 10**9)
    mesh, tx, rx = SCENES["furnished"], places(1, 3), places(20, 4)
    every = Tracer(mesh, config=config("exhaustive")).trace(tx, rx)
    nearby = Tracer(mesh, config=config("rays", 2000)).trace(tx, rx)
    monkeypatch.setattr(candidates, "with_neighbours", lambda pairs, near, possible: np.unique(pairs, axis=0))
    alone = Tracer(mesh, config=config("rays", 2000)).trace(tx, rx)
    assert (found(alone, nearby) >= 0).all()
    missed, still = ((found(every, some) < 0).sum() for some in (alone, nearby))
    assert missed > 20
    assert still < 0.5 * missed


def test_aimed_rays_find_chains_over_small_facets(monkeypatch):
    """Turned plates of 6 cm at 9 m: 2,000 rays miss chains over a plate and then a wall, aimed rays few of them."""
    monkeypatch.setattr(candidates, "RAYS_A_PATCH", 10**9)
    monkeypatch.setattr(candidates, "RAYS_NEARBY", 10**9)
    rng, parts = np.random.default_rng(3), [trimesh.creation.box(bounds=[(-12, -6, 0), (12, 6, 4)])]
    for y, z in np.stack(np.meshgrid(np.linspace(-4, 4, 9), np.linspace(0.8, 3.2, 5)), -1).reshape(-1, 2):
        plate = trimesh.creation.box((0.01, 0.06, 0.06))
        plate.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(-0.3, 0.3), (0, 1, 0.5)))
        parts.append(plate.apply_translation((9, y, z)))
    mesh, tx = trimesh.util.concatenate(parts), np.array([[0.1, 0.2, 1.7]])
    rx = rng.uniform((-11, -5, 0.5), (8, 5, 3.5), (2500, 3))
    options = {"diffraction": False, "max_transmissions": 0}
    every = Tracer(mesh, config=config("exhaustive", **options)).trace(tx, rx)
    aimed = Tracer(mesh, config=config("rays", 2000, **options)).trace(tx, rx)
    monkeypatch.setattr(shooting, "aimed_at", lambda ground, point, patch, rays: directions(1))
    alone = Tracer(mesh, config=config("rays", 2000, **options)).trace(tx, rx)
    assert (found(aimed, every) >= 0).all()
    over_plate = every.select((every.order == 2) & (np.abs(every.point[:, 0, 0] - 9) < 0.05))
    missed, still = ((found(over_plate, paths) < 0).sum() for paths in (alone, aimed))
    assert missed > 20
    assert still < 0.1 * missed


def test_edges_behind_houses_are_those_of_exhaustive_search():
    """A street of houses, where most edges are hidden from a receiver: all paths, whatever receiver came before."""
    rng, parts = np.random.default_rng(4), [trimesh.creation.box(bounds=[(0, 0, -0.5), (60, 60, 0)])]
    for x, y in np.stack(np.meshgrid([12, 30, 48], [12, 30, 48]), axis=-1).reshape(-1, 2):
        house = trimesh.creation.box((*rng.uniform(6, 10, 2), 2 * rng.uniform(5, 9)))
        house.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0, 1.5), (0, 0, 1)))
        parts.append(house.apply_translation((x, y, 0.01)))
    mesh, tx = trimesh.util.concatenate(parts), np.array([[21.0, 20.3, 14.0]])
    rx = np.stack(np.meshgrid(np.arange(1, 60, 4.0), np.arange(1, 60, 4.0), [1.5]), axis=-1).reshape(-1, 3)
    bent = {"max_reflections": 1, "diffraction_reflections": 2, "diffraction_side_reflections": 1}
    every = Tracer(mesh, config=config("exhaustive", **bent)).trace(tx, rx)
    tracer = Tracer(mesh, config=config("rays", **bent))
    paths, again = tracer.trace(tx, rx), tracer.trace(tx, rx[::-1])
    is_bent = (paths.interaction == Interaction.DIFFRACTION).any(axis=1)
    assert (is_bent & (paths.order == 3)).sum() > 100
    assert len(paths) == len(every) == len(again)
    assert (found(every, paths) >= 0).all()
    np.testing.assert_array_equal(np.sort(again.power), np.sort(paths.power))


def test_directions_fill_the_sphere_evenly():
    """Caps of any direction get their share of 10,000 directions within 0.3 %, a fifth of what chance gives."""
    routes = directions(10_000)
    np.testing.assert_allclose(np.linalg.norm(routes, axis=1), 1, atol=1e-12)
    axes = np.random.default_rng(0).normal(size=(200, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    share = (routes @ axes.T > 0.6).mean(axis=0)
    assert np.abs(share - 0.2).max() < 0.003


def test_paths_do_not_depend_on_workers_or_on_other_links(monkeypatch):
    """One worker or three, receivers all together or each alone: the same bits."""
    monkeypatch.setattr("wireless.tracing.blocks.BLOCK_RX", 4)
    tx, rx = places(3, 5), places(9, 6)
    tracer = Tracer(SCENES["drum"], config=config("rays", 2000, diffraction_reflections=2, max_paths=40))
    one, three = (tracer.trace(tx, rx, workers=n) for n in (1, 3))
    np.testing.assert_array_equal(one.gain, three.gain)
    np.testing.assert_array_equal(one.point, three.point)
    alone = tracer.trace(tx[1:2], rx[7:8])
    np.testing.assert_array_equal(alone.gain, one.between(1, 7).gain)


def test_a_transmitter_is_remembered_and_forgotten_without_a_trace(monkeypatch):
    """Traced before or not, or forgotten since for want of memory: the same bits, and no more is stored than may be."""
    tx, rx = places(3, 10), places(4, 11)
    tracer = Tracer(SCENES["drum"], config=config("rays", max_paths=30))
    first = tracer.trace(tx, rx)
    again = tracer.trace(tx, rx)
    known = tracer.scene._candidates(0)._known
    assert len(known) == 3
    monkeypatch.setattr(candidates, "MEMORY", 0)
    forgotten = Tracer(SCENES["drum"], config=config("rays", max_paths=30))
    for paths in (again, forgotten.trace(tx, rx)):
        np.testing.assert_array_equal(paths.gain, first.gain)
        np.testing.assert_array_equal(paths.point, first.point)
    assert len(forgotten.scene._candidates(0)._known) == 1


def test_edges_bend_rays_along_keller_cones():
    """Behind a screen's edge rays reach each wall of a box that its cone meets, and no other.

    Source and edge are at right angles: all rays stay in the plane through the source across the edge, so that the two
    walls of the box that are parallel to it are not met.
    """
    screen = trimesh.creation.box(bounds=[(-0.01, -1.0, -0.6), (0.01, 1.0, 0.6)])
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=BOUNDS - BOUNDS.mean(axis=0)), screen])
    surfaces = find_surfaces(mesh, np.zeros(len(mesh.faces), int), 1e-6)
    every = np.ones(len(surfaces.facet_face), bool)
    space = make_space(surfaces, every, ~every)
    # The middle of the upper edge of the face towards the source, cut short so that the cone is a plane.
    middle = surfaces.edge.mean(axis=1)
    edge = np.flatnonzero((np.abs(middle - [-0.01, 0.0, 0.6]) < 1e-9).all(axis=1))
    source = np.array([[-2.0, 0.0, 0.6]])
    short = surfaces.edge.copy()
    short[edge[0]] *= [1.0, 1e-6, 1.0]
    space = space._replace(surfaces=surfaces._replace(edge=short))
    (behind,) = Shooter(space, 0).bend(source, edge, np.ones(1, bool), 10**9, 1)
    normals = surfaces.facet_normal[space.patch_facet[behind.chain[:, 0]]]
    assert len(behind.chain) >= 4
    assert (np.abs(normals[:, 1]) < 1e-9).all()
    assert (behind.sight == 0).all()


def test_two_reflections_about_an_edge_are_found_on_either_side(judged):
    """Chains of two before or behind an edge, and one on each side: all are among exhaustive search's paths."""
    mesh, tx, rx, _ = judged
    options = {"max_reflections": 0, "diffraction_reflections": 2, "max_paths": 5000}
    every, rays = (
        Tracer(mesh, config=config(search, **options)).trace(tx[:1], rx[:2])
        for search in ("exhaustive", "rays")
    )
    assert (found(rays, every) >= 0).all()
    edge = (rays.interaction == Interaction.DIFFRACTION).argmax(axis=1)
    two = rays.order == 3
    assert {0, 1, 2} <= set(edge[two])
    assert (found(every.select(strong(every)), rays) >= 0).mean() > 0.95


def test_a_room_with_a_finely_divided_sphere_has_its_own_images():
    """20,480 triangles hang in a box: line of sight and all single and double images of the box, by hand."""
    centre, radius = np.array([3.0, 2.5, 1.4]), 0.6
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    sphere.apply_translation(centre)
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=BOUNDS), sphere])
    tx, rx = places(1, 8), np.random.default_rng(9).uniform((0.2, 3.3, 0.2), (6.8, 4.8, 2.8), (20, 3))
    tracer = Tracer(mesh, config=config("auto", diffraction=False, max_paths=200))
    paths = tracer.trace(tx, rx)
    length = paths.delay_s * speed_of_light
    checked = 0
    for r, one in enumerate(rx):
        mine = length[paths.rx == r]
        for walls in box_chains():
            points = box_path(tx[0], one, walls)
            gap = min(distance(p, q, centre) for p, q in pairwise(points)) - radius
            if abs(gap) < 1e-3:
                continue
            far = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
            there = bool((np.abs(mine - far) < 1e-9).any())
            assert there == (gap > 0)
            checked += gap > 0
    assert checked > 200


def box_chains():
    """No wall, each of six (axis and side), and each two of different axes."""
    walls = [(axis, side) for axis in range(3) for side in range(2)]
    return [(), *((w,) for w in walls), *((v, w) for v in walls for w in walls if v[0] < w[0])]


def box_path(tx, rx, walls):
    """Points of the path over walls of a box that are at right angles to each other; their order does not matter."""
    image = np.array(tx)
    for axis, side in walls:
        image[axis] = 2 * BOUNDS[side, axis] - image[axis]
    shares = [(BOUNDS[side, axis] - image[axis]) / (rx[axis] - image[axis]) for axis, side in walls]
    points, bounced = [rx], []
    for share, (axis, side) in sorted(zip(shares, walls, strict=True), reverse=True):
        point = image + share * (rx - image)
        for a, s in bounced:
            point[a] = 2 * BOUNDS[s, a] - point[a]
        points.append(point)
        bounced.append((axis, side))
    return np.array([*points, tx])


def distance(p, q, centre):
    """Least distance of a path from a point."""
    share = np.clip((centre - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
    return np.linalg.norm(p + share * (q - p) - centre)


def test_rays_name_the_walls_that_they_bounce_off():
    """In an empty box rays find each chain of two walls, opposite ones too; none names one wall twice running."""
    mesh = trimesh.creation.box(bounds=BOUNDS - BOUNDS.mean(axis=0))
    surfaces = find_surfaces(mesh, np.zeros(len(mesh.faces), int), 1e-6)
    space = make_space(surfaces, np.ones(6, bool), np.zeros(6, bool))
    (pairs,) = Shooter(space, 0).shoot(np.zeros(3), 20_000, 2, 0, NO_AIMS).chains
    assert len(pairs) == 30
    assert (pairs[:, 0] != pairs[:, 1]).all()


@pytest.mark.parametrize(
    ("options", "word"),
    [({"rays": 5}, "rays"), ({"rays": 10**8}, "rays")],
)
def test_a_search_that_there_is_not_is_rejected(options, word):
    """The message names the option and what is expected."""
    with pytest.raises(ValueError, match=f"^{word} is .*expected"):
        TracerConfig(**options)


@pytest.fixture(scope="module")
def two_rooms():
    """A box with a sheet across it that has a doorway, and furniture on either side."""
    sheet = trimesh.Trimesh(
        [(3.5, y, z) for y, z in [(0, 0), (2, 0), (2, 3), (0, 3), (2, 2.1), (3, 2.1), (3, 3)]]
        + [(3.5, y, z) for y, z in [(3, 0), (5, 0), (5, 3)]],
        [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 2), (7, 8, 9), (7, 9, 6)],
        process=False,
    )
    rng = np.random.default_rng(3)
    return trimesh.util.concatenate([trimesh.creation.box(bounds=BOUNDS), sheet, *turned_boxes(3, rng)])


@pytest.mark.parametrize(("few", "bound"), [(True, 1.0), (False, 0.999)])
@pytest.mark.parametrize("passed", [1, 2])
def test_rays_pass_walls_as_exhaustive_search_does(two_rooms, few, bound, passed, monkeypatch):
    """Through a sheet and furniture: the paths of exhaustive search within 40 dB, and no other; gains to 1e-9.

    With few patches nothing is missed; else (the second case) rays pass walls.
    """
    if not few:
        monkeypatch.setattr(candidates, "RAYS_A_PATCH", 10**9)
    tx = np.array([[0.6, 2.1, 0.9], [2.6, 4.5, 1.2]])
    rx = np.random.default_rng(4).uniform((0.2, 0.2, 0.5), (6.8, 4.8, 2.0), (16, 3))
    every, rays = (
        Tracer(
            two_rooms,
            materials=("partition",),
            config=config(search, max_transmissions=passed),
        ).trace(tx, rx)
        for search in ("exhaustive", "rays")
    )
    same = found(rays, every)
    assert (same >= 0).all()
    np.testing.assert_allclose(rays.gain, every.gain[same], rtol=1e-9, atol=1e-15)
    wanted = every.select(strong(every))
    through = (wanted.interaction == Interaction.TRANSMISSION).sum(axis=1)
    assert (through == passed).sum() > 50
    assert (found(wanted, rays) >= 0).mean() >= bound


def test_a_ray_that_passes_a_wall_is_mirrored_behind_it(two_rooms):
    """Beyond a sheet rays meet the far wall of the box as often as walls may be passed, and name it as if alone."""
    surfaces = find_surfaces(two_rooms, np.zeros(len(two_rooms.faces), int), 1e-6)
    every = np.ones(len(surfaces.facet_face), bool)
    sheet = np.isclose(np.abs(surfaces.facet_normal[:, 0]), 1) & np.isclose(surfaces.facet_point[:, 0], 3.5)
    far = np.isclose(np.abs(surfaces.facet_normal[:, 0]), 1) & np.isclose(surfaces.facet_point[:, 0], 7.0)
    space = make_space(surfaces, every, sheet)
    # Where only the sheet hides the far wall, above furniture: through the doorway its upper half cannot be met.
    point = np.array([1.0, 0.5, 2.9])
    met = []
    for through in (0, 1):
        (pairs,) = Shooter(space, through).shoot(point, 20_000, 2, 0, NO_AIMS).chains
        facets = space.patch_facet[pairs]
        assert not (sheet[facets[:, 0]] & sheet[facets[:, 1]]).any()
        met.append({tuple(f) for f in facets if far[f[0]]})
    assert met[0] < met[1]


def test_half_spaces_let_no_ray_through():
    """Furniture of wood hides, behind walls of layers that do not: no path through it, not even one without power."""
    rng = np.random.default_rng(5)
    room = trimesh.creation.box(bounds=BOUNDS)
    mesh = trimesh.util.concatenate([room, *turned_boxes(4, rng)])
    of_face = (np.arange(len(mesh.faces)) >= len(room.faces)).astype(int)
    tx, rx = places(1, 12), np.random.default_rng(6).uniform((1, 1, 0.6), (6, 4, 1.4), (12, 3))
    for search in ("exhaustive", "rays"):
        none, two = (
            Tracer(
                mesh,
                materials=("partition", "wood"),
                face_material=of_face,
                config=config(search, max_transmissions=n),
            ).trace(tx, rx)
            for n in (0, 2)
        )
        assert len(two) == len(none) > 50
        assert (two.power > 0).all()
