"""Storeys over each other: the same paths as in space, where every facet and every edge is tried."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
import trimesh
from scipy.constants import speed_of_light

from tests.wireless.tracing.path_rows import table
from wireless.geometry.stack import find_stack
from wireless.paths import Interaction
from wireless.tracing.scenes import PlanScene, SpaceScene
from wireless.tracing.stack_scene import StackScene
from wireless.tracing.tracer import SceneError, Tracer, TracerConfig

HEIGHT, SLAB = 2.5, 0.3
FLOOR = HEIGHT + SLAB


def flat(area, z):
    """Triangles that fill polygons at a height."""
    parts = [
        shapely.get_parts(shapely.constrained_delaunay_triangles(one)) for one in shapely.get_parts(area)
    ]
    xy = np.array([shapely.get_coordinates(t)[:3] for part in parts for t in part]).reshape(-1, 3, 2)
    return np.concatenate([xy, np.full((*xy.shape[:2], 1), z)], axis=2)


def upright(area, low, high):
    """Two triangles over each side of polygons."""
    found = []
    for ring in shapely.get_rings(shapely.get_parts(area)):
        xy = shapely.get_coordinates(ring)
        for a, b in pairwise(xy):
            found += [[(*a, low), (*b, low), (*b, high)], [(*a, low), (*b, high), (*a, high)]]
    return np.array(found)


def stacked(free, openings):
    """Mesh around storeys of 2.5 m with slabs of 0.3 m, whose triangles share no vertices."""
    parts, nothing = [], shapely.Polygon()
    for k, area in enumerate(free):
        below, above = ([nothing, *openings, nothing])[k : k + 2]
        z = k * FLOOR
        parts += [flat(area - below, z), flat(area - above, z + HEIGHT), upright(area, z, z + HEIGHT)]
        if not above.is_empty:
            parts.append(upright(above, z + HEIGHT, z + FLOOR))
    corners = np.concatenate(parts)
    return trimesh.Trimesh(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), process=False)


def random_building(rng, n):
    """Storeys with a turned pillar and a wall each; openings in the middle, at a wall, or with a bay."""
    free, openings = [], []
    for _ in range(n):
        area = shapely.box(0, 0, 6 + rng.uniform(0, 1), 5)
        x, y = rng.uniform((0.7, 0.7), (1.5, 4))
        pillar = shapely.box(x - 0.2, y - 0.2, x + 0.2, y + 0.2)
        area = area - shapely.affinity.rotate(pillar, rng.uniform(0, 90))
        x = rng.uniform(1.9, 2.3)
        free.append(area - shapely.box(x, -1, x + 0.15, rng.uniform(1.5, 3)))
    bay = shapely.Polygon([(3, 2), (4.5, 2.2), (4.6, 4), (3.8, 3.9), (3.7, 3), (3.1, 3.1)])
    for _ in range(n - 1):
        y = rng.uniform(1, 3)
        plain = shapely.box(3 + rng.uniform(0, 0.5), y, 5, y + rng.uniform(1, 1.8))
        openings.append([plain, bay, shapely.box(3.2, 3.5, 4.8, 5)][rng.integers(3)])
    return free, openings


def random_points(rng, free, count):
    """Points on all storeys in turn."""
    found = []
    while len(found) < count:
        p, k = rng.uniform((0, 0), (7, 5)), len(found) % len(free)
        if shapely.contains_xy(free[k].buffer(-0.05), *p):
            found.append((*p, k * FLOOR + rng.uniform(0.2, 2.3)))
    return np.array(found)


def traced(mesh, tx, rx, scene, **options):
    options = {"max_transmissions": 0, "max_paths": 3000, "search": "exhaustive", **options}
    return Tracer(mesh, config=TracerConfig(scene=scene, **options)).trace(tx, rx, workers=1)


@pytest.mark.parametrize("seed", range(12))
def test_storeys_and_space_find_the_same_paths(seed):
    """Views through layers against chains of images among all triangles, which share no geometry."""
    rng = np.random.default_rng(seed)
    free, openings = random_building(rng, 2 + seed % 2)
    points = random_points(rng, free, 9)
    mesh = stacked(free, openings)
    storeys, space = (
        traced(mesh, points[:3], points[3:], scene, max_reflections=2) for scene in ("storeys", "space")
    )
    assert len(storeys) == len(space) > 100
    np.testing.assert_allclose(table(storeys), table(space), rtol=0, atol=1e-8)
    of = np.floor(points[:, 2] / FLOOR).astype(int)
    between = of[:3][storeys.tx] != of[3:][storeys.rx]
    assert between.sum() > 20 and (~between).sum() > 20
    corner = storeys.interaction == Interaction.DIFFRACTION
    heights = storeys.point[..., 2][corner] % FLOOR
    rim = np.isclose(heights, HEIGHT) | np.isclose(heights, 0) | np.isclose(heights, FLOOR)
    assert rim.sum() > 10 and (~rim).sum() > 10


@pytest.mark.parametrize(
    "options", [{"max_reflections": 3}, {"max_reflections": 1, "diffraction_reflections": 2}]
)
def test_more_reflections_agree_too(options):
    """Three of them, or an edge and two: more windows within windows."""
    rng = np.random.default_rng(40)
    free, openings = random_building(rng, 3)
    points = random_points(rng, free, 6)
    mesh = stacked(free, openings)
    one, other = (traced(mesh, points[:2], points[2:], scene, **options) for scene in ("storeys", "space"))
    assert len(one) == len(other) > 100
    np.testing.assert_allclose(table(one), table(other), rtol=0, atol=1e-8)


@pytest.fixture(scope="module")
def two_rooms():
    """Two rooms of 6 x 4 m2 over each other, an opening of 2 x 2 m2 in the middle."""
    room = shapely.box(0, 0, 6, 4)
    return stacked([room, room], [shapely.box(2, 1, 4, 3)])


def test_slab_hides_and_its_rim_bends_rays(two_rooms):
    """By hand: straight through the opening, nothing straight through the slab, Keller's point on a rim between.

    From (3, 2, 1.5) to (3.2, 2, 4.3) the path crosses the slab within the opening. To (0.4, 2, 3.1) it does not, and
    the upper rim at x = 2, z = 2.8 is in the plane of both: the path over it is as long as both straight parts.
    """
    tx, rx = np.array([[3.0, 2.0, 1.5]]), np.array([[3.2, 2.0, 4.3], [0.4, 2.0, 3.1]])
    paths = traced(two_rooms, tx, rx, "auto", max_reflections=0, diffraction_reflections=0)
    through, behind = paths.between(0, 0), paths.between(0, 1)
    assert (through.order == 0).sum() == 1 and not (behind.order == 0).any()
    length = np.hypot(1, 1.3) + np.hypot(1.6, 0.3)
    over = np.abs(behind.delay_s * speed_of_light - length).argmin()
    np.testing.assert_allclose(behind.point[over, 0], (2, 2, 2.8), atol=1e-9)
    assert behind.delay_s[over] * speed_of_light == pytest.approx(length, abs=1e-9)


def test_auto_takes_plan_storeys_or_space(two_rooms, extruded, ring):
    """One storey is a plan, several are storeys, a table under a lid is neither, nor is a leaning roof."""
    room = extruded(ring((0, 0), (6, 0), (6, 4), (0, 4)), floor=True, ceiling=True)
    shelf = trimesh.util.concatenate(
        [room] + [trimesh.creation.box(bounds=[(1, 1, low), (2, 2, low + 0.7)]) for low in (0.4, 1.5)]
    )
    leaning = two_rooms.copy()
    leaning.vertices[:, 2] += np.where(leaning.vertices[:, 2] > 5, 0.1 * leaning.vertices[:, 0], 0)
    kinds = [type(Tracer(mesh).scene) for mesh in (room, two_rooms, shelf, leaning)]
    assert kinds == [PlanScene, StackScene, SpaceScene, SpaceScene]
    with pytest.raises(SceneError, match=r"no storeys over each other.*scene='space'"):
        Tracer(room, config=TracerConfig(scene="storeys"))


def test_what_storeys_reject_is_traced_in_space_without_an_error(two_rooms):
    """Floors that reflect, points outside or on an upper floor, walls that may be passed into another room."""
    tx, inside = np.array([[3.0, 2.0, 1.5]]), np.array([[3.2, 2.0, 4.3]])
    for rx in ([[9.0, 2.0, 1.5]], [[1.0, 1.0, 2.8]], [[1.0, 1.0, 9.0]], [[1.0, 1.0, 2.65]]):
        rx = np.array(rx)
        got, space = (traced(two_rooms, tx, rx, scene, max_reflections=1) for scene in ("auto", "space"))
        np.testing.assert_array_equal(table(got), table(space))
        with pytest.raises(ValueError, match=r"rx has positions.*scene='space'"):
            traced(two_rooms, tx, rx, "storeys")
    for options in ({"floor_ceiling": True}, {"max_transmissions": 2, "wall_thickness_m": 0.1}):
        got, space = (
            traced(two_rooms, tx, inside, scene, max_reflections=1, **options) for scene in ("auto", "space")
        )
        np.testing.assert_array_equal(table(got), table(space))
        with pytest.raises(SceneError, match=r"because .*scene='space'"):
            traced(two_rooms, tx, inside, "storeys", **options)


def test_one_wall_passed_leads_out_of_closed_storeys(two_rooms):
    """Who passes one face of a closed room does not come back into one, so that nothing changes."""
    tx, rx = np.array([[3.0, 2.0, 1.5]]), np.array([[3.2, 2.0, 4.3], [1.0, 1.0, 1.0]])
    none, one = (
        traced(two_rooms, tx, rx, "auto", max_transmissions=n, wall_thickness_m=0.1, wall_passage="face")
        for n in (0, 1)
    )
    np.testing.assert_array_equal(table(none), table(one))


def test_slabs_reflect_only_if_asked_for(two_rooms):
    """In space too: all floors and ceilings of storeys, not the lowest and the highest alone."""
    tx, rx = np.array([[1.0, 2.0, 1.5]]), np.array([[1.4, 3.0, 1.0]])
    options = {"max_reflections": 1, "diffraction": False}
    quiet, loud = (traced(two_rooms, tx, rx, "space", floor_ceiling=on, **options) for on in (False, True))
    assert not np.isin(np.round(quiet.point[:, 0, 2], 9), (0.0, 2.5)).any()
    assert np.isin((0.0, 2.5), np.round(loud.point[:, 0, 2], 9)).all()


def test_walls_through_several_layers_are_cut(two_rooms):
    """One wall of both storeys and the slab between, in one piece: an opening at a wall, as other programs write it."""
    room, hole = shapely.box(0, 0, 6, 4), shapely.box(2, 0, 4, 2)
    mesh = stacked([room, room], [hole])
    front = np.abs(mesh.triangles[:, :, 1]).max(axis=1) < 1e-9
    level = np.ptp(mesh.triangles[:, :, 2], axis=1) < 1e-9
    wide = np.array([(2, 0, 0), (4, 0, 0), (4, 0, 5.3), (2, 0, 5.3)], float)
    sides = [
        np.array([(a, 0, z), (b, 0, z), (b, 0, z + 2.5), (a, 0, z + 2.5)])
        for a, b in ((0, 2), (4, 6))
        for z in (0, 2.8)
    ]
    quads = np.array([wide, *sides])
    walls = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3)
    corners = np.concatenate([mesh.triangles[~front | level], walls])
    whole = trimesh.Trimesh(
        corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), process=False
    )
    assert find_stack(whole, np.zeros(len(whole.faces), int), 1e-6) is not None
    tx, rx = np.array([[1.0, 2.5, 1.5]]), np.array([[3.2, 1.0, 4.3], [5.0, 1.0, 1.0]])
    one, other = (traced(each, tx, rx, "storeys", max_reflections=2) for each in (mesh, whole))
    assert len(one) == len(other) > 20
    np.testing.assert_allclose(table(one), table(other), rtol=0, atol=1e-8)
