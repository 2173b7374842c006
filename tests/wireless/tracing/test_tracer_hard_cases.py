"""Places and meshes where tracers lose, double or invent paths: what must come out, each time."""

import itertools

import numpy as np
import pytest
import shapely
import trimesh
from scipy.constants import speed_of_light

from wireless.tracing.tracer import Tracer, TracerConfig

ROOM = (0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)
#: An L-shaped room with a slanted pillar: two walls meet outwards at (4, 3).
BEND = (0.0, 0.0), (9.0, 0.0), (9.0, 3.0), (4.0, 3.0), (4.0, 7.0), (0.0, 7.0)
PILLAR = (2.0, 2.0), (2.6, 2.1), (2.4, 2.7)
TX = np.array([[1.1, 5.3, 1.5]])
RX = np.array([[7.3, 1.2, 1.2], [3.2, 1.1, 1.8], [0.7, 0.9, 1.5], [5.03, 2.73, 1.0]])


def columns(paths):
    """Rows that describe each path but for its ids, sorted so that equals come in any order."""
    rows = np.column_stack(
        [
            paths.rx,
            paths.order,
            paths.delay_s * speed_of_light,
            np.cos(paths.aod_az - 0.1),  # no jump at 180 degrees
            np.sin(paths.aoa_az - 0.1),
            paths.aod_el,
            paths.aoa_el,
            10 * np.log10(paths.power) * 1e-3,
        ]
    )
    return rows[np.lexsort(np.round(rows[:, ::-1], 6).T)]


def same(one, other, atol=1e-6):
    """Complain unless both hold the same paths."""
    assert len(one) == len(other) > 0
    np.testing.assert_allclose(columns(one), columns(other), rtol=0, atol=atol)


def trace(mesh, tx=TX, rx=RX, **options):
    options = {"max_paths": 300} | options
    return Tracer(mesh, config=TracerConfig(**options)).trace(tx, rx)


@pytest.fixture(scope="module")
def bend(ring):
    return np.concatenate([ring(*BEND), ring(*PILLAR)])


def only_reflections(**options):
    return {"diffraction": False} | options


def test_all_reflections_of_brute_force(extruded, bend):
    """Every chain of up to three walls, each leg tested against every wall: the same paths, no more, no less.

    Written apart: images by mirroring in sequence, hidden legs by GEOS.
    """
    lines = shapely.linestrings(bend)
    expected = []
    rng = np.random.default_rng(8)
    places = np.concatenate([RX[:, :2], rng.uniform(0, (4, 7), (6, 2)), rng.uniform((4, 0), (9, 3), (4, 2))])
    for i, rx in enumerate(places):
        for order in range(4):
            for chain in itertools.product(range(len(bend)), repeat=order):
                if (length := chain_length(bend, lines, TX[0, :2], rx, chain)) is not None:
                    expected.append((i, order, length))
    paths = trace(extruded(bend), rx=np.insert(places, 2, 1.5, axis=1), **only_reflections())
    got = np.column_stack([paths.rx, paths.order, paths.delay_s * speed_of_light])
    assert len(expected) > 150
    np.testing.assert_allclose(got[np.lexsort(got.T[::-1])], np.array(sorted(expected)), atol=1e-9)


def chain_length(walls, lines, tx, rx, chain):
    """Length of the specular path over a chain of walls; None if there is none."""
    images = [tx]
    for wall in chain:
        a, b = walls[wall]
        normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
        images.append(images[-1] - 2 * np.dot(images[-1] - a, normal) * normal)
    points, target = [rx], rx
    for wall, image in zip(chain[::-1], images[:0:-1], strict=True):
        a, b = walls[wall]
        matrix = np.column_stack([target - image, a - b])
        if abs(np.linalg.det(matrix)) < 1e-12:
            return None
        along, on_wall = np.linalg.solve(matrix, a - image)
        if not (0 < along < 1 and 0 <= on_wall <= 1):
            return None
        points.append(target := image + along * (target - image))
    points.append(tx)
    for k in range(len(points) - 1):
        own = set((*chain[::-1], -1)[max(0, k - 1) : k + 1])
        others = [line for i, line in enumerate(lines) if i not in own]
        if shapely.intersects(shapely.linestrings([points[k], points[k + 1]]), others).any():
            return None
    return np.linalg.norm(images[-1] - rx)


def test_receiver_on_a_wall_sees_both_sides(extruded):
    """A point of a sheet is seen from either side, without the sheet's own reflection (it has no length)."""
    mesh = extruded([[(0, 0), (4, 0)]])
    paths = trace(mesh, np.array([[1, 1, 1.5], [1, -1, 1.5]]), np.array([[2, 0, 1.5]]), diffraction=False)
    assert paths.tx.tolist() == [0, 1] and paths.order.tolist() == [0, 0]


def test_receiver_in_a_corner_of_the_room(extruded, ring):
    """Limit of the lattice where images coincide: line of sight and reflections at the two other walls."""
    paths = trace(
        extruded(ring(*ROOM)),
        np.array([[2.0, 1.5, 1.5]]),
        np.array([[6.0, 4.0, 1.5]]),
        **only_reflections(max_reflections=1),
    )
    assert sorted(paths.order) == [0, 1, 1]
    assert np.isfinite(paths.gain).all()


def test_receiver_at_the_transmitter_receives_echoes_only(extruded, ring):
    """No path without length, and one echo from each of the four walls, at twice its distance."""
    here = np.array([[2.0, 1.5, 1.5]])
    paths = trace(extruded(ring(*ROOM)), here, here, **only_reflections(max_reflections=1))
    assert sorted(np.round(paths.delay_s * speed_of_light, 9)) == [3.0, 4.0, 5.0, 8.0]


def test_receiver_on_the_shadow_boundary_has_the_limit_from_either_side(extruded):
    """Exactly behind an edge the field is that of a receiver 10 nm aside, on either side: within 0.1 dB."""
    mesh = extruded([[(0, 0), (50, 0)], [(0, 0), (0, -50)]])
    tx, rx = (
        np.array([[-2.0, 1.0, 1.5]]),
        np.array([[2.0, -1.0, 1.5], [2, -1 + 1e-8, 1.5], [2, -1 - 1e-8, 1.5]]),
    )
    mesh = extruded([[(0, 0), (0, -50)]])
    paths = trace(mesh, tx, rx)
    total = np.array([paths.gain[paths.rx == i, 0, 0].sum() for i in range(3)])
    assert sorted(paths.count()[0]) == [1, 2, 2] or sorted(paths.count()[0]) == [2, 3, 3]
    assert np.abs(20 * np.log10(np.abs(total[1:] / total[0]))).max() < 0.1


def test_grazing_rays_cancel(extruded):
    """A micrometre above a wall direct and reflected ray are both found, and add up to almost nothing."""
    tx, rx = np.array([[-4.0, 1e-6, 1.5]]), np.array([[4.0, 1e-6, 1.5]])
    paths = trace(extruded([[(-9, 0), (9, 0)]]), tx, rx, diffraction=False)
    assert sorted(paths.order) == [0, 1]
    assert abs(paths.gain[:, 0, 0].sum()) < 1e-4 * abs(paths.gain[0, 0, 0])


def test_cut_doubled_and_turned_walls_are_one(extruded, bend):
    """A wall in pieces, twice, and facing either side is the same wall: same paths, none doubled or lost."""
    pieces = np.concatenate(
        [np.stack([np.linspace(a, b, 8)[:-1], np.linspace(a, b, 8)[1:]], 1) for a, b in bend]
    )
    halves = trimesh.util.concatenate([extruded(pieces), extruded(bend[:, ::-1]), extruded(bend)])
    same(trace(halves), trace(extruded(bend)))


def test_slivers_and_degenerate_triangles_do_nothing(extruded, bend):
    """Triangles without area, and needles in the plane of a wall, change no path."""
    mesh = extruded(bend)
    junk = np.array(
        [
            [(1, 1, 1), (1, 1, 1), (1, 1, 1)],
            [(1, 1, 0), (2, 2, 0), (3, 3, 0)],
            [(3, 0, 0), (3, 1e-12, 3), (3, 0, 3)],
        ],
        float,
    )
    spoilt = trimesh.util.concatenate(
        [mesh, trimesh.Trimesh(junk.reshape(-1, 3), np.arange(9).reshape(3, 3), process=False)]
    )
    same(trace(spoilt), trace(mesh))


@pytest.mark.parametrize("crack_m", [1e-7, -1e-7, 1e-12])
def test_nothing_leaks_through_cracks(extruded, ring, crack_m):
    """A partition that stops a tenth of a micrometre before (or behind) a wall shuts its room completely."""
    walls = np.concatenate([ring(*ROOM), [[(3.0, 0.0 - crack_m), (3.0, 4.0 + crack_m)]]])
    tx, rx = np.array([[1.2, 1.7, 1.5]]), np.array([[4.1, 2.2, 1.5], [2.1, 3.2, 1.5]])
    closed = np.concatenate([ring(*ROOM), [[(3.0, 0.0), (3.0, 4.0)]]])
    paths = trace(extruded(walls), tx, rx)
    assert set(paths.rx) == {1}
    same(paths, trace(extruded(closed), tx, rx))


def test_walls_a_millimetre_apart_are_two(extruded):
    """Behind both: nothing but diffraction; between them: one echo each; in front: the near one reflects."""
    walls = [[(-5, 0), (5, 0)], [(-5, 0.001), (5, 0.001)]]
    tx = np.array([[-1.0, -1.0, 1.5], [-1e-3, 4e-4, 1.5]])
    rx = np.array([[1.0, -1.0, 1.5], [1.0, 1.0, 1.5], [1e-3, 6e-4, 1.5]])
    paths = trace(extruded(walls), tx, rx, diffraction=False, max_reflections=1)
    assert paths.count().tolist() == [[2, 0, 0], [0, 0, 3]]
    echo = paths.between(1, 2).select(paths.between(1, 2).order == 1).delay_s * speed_of_light
    np.testing.assert_allclose(np.sort(echo), np.hypot(2e-3, [1e-3, 1e-3]), rtol=1e-9)


def test_millimetre_legs_are_found(extruded):
    """A receiver half a millimetre off the wall gets its reflection, a twentieth of a wave away."""
    paths = trace(
        extruded([[(-5, 0), (5, 0)]]),
        np.array([[0, 2.0, 1.5]]),
        np.array([[1, 5e-4, 1.5]]),
        diffraction=False,
    )
    assert sorted(paths.order) == [0, 1]
    np.testing.assert_allclose(paths.point[paths.order == 1][0, 0, 1], 0, atol=1e-12)


def test_path_through_a_corner_of_the_room_counts_once(extruded, ring):
    """Where an image's ray meets two walls in one point, either order is one path: 4 k of order k still."""
    tx, rx = np.array([[5.2, 0.7, 1.5]]), np.array([[0.4, 0.4, 1.5]])
    paths = trace(extruded(ring(*ROOM)), tx, rx, **only_reflections(max_reflections=5))
    assert np.bincount(paths.order).tolist() == [1, 4, 8, 12, 16, 20]


def test_staircase_of_cells_sees_what_geos_sees(extruded):
    """A ring of 5 cm cells, outlined by 1000 walls: line of sight as GEOS has it, for 4000 pairs."""
    cells = (np.arange(-90, 90) + 0.5) * 0.05
    radius = np.hypot(*np.meshgrid(cells, cells))
    free = (radius > 2) & (radius < 4)
    walls = np.concatenate([edges(free), edges(free.T)[:, :, ::-1]]) * 0.05 - 4.5
    rng = np.random.default_rng(3)
    turn, out = rng.uniform(0, 2 * np.pi, 1004), rng.uniform(2.1, 3.9, 1004)
    points = np.column_stack([out * np.cos(turn), out * np.sin(turn), np.full(1004, 1.5)])
    tx, rx = points[:4], points[4:]
    paths = trace(extruded(walls), tx, rx, max_reflections=0, diffraction=False)
    sight = shapely.linestrings(np.stack(np.broadcast_arrays(tx[:, None, :2], rx[None, :, :2]), axis=2))
    hidden = shapely.intersects(shapely.multilinestrings(list(shapely.linestrings(walls))), sight)
    assert len(walls) > 900 and np.array_equal(paths.count() == 1, ~hidden) and 0.4 < hidden.mean() < 0.9


def edges(free):
    """Borders between cells above each other, in cells: (n, 2, 2)."""
    row, column = np.nonzero(free[1:] != free[:-1])
    return np.stack([np.column_stack([column, row + 1]), np.column_stack([column + 1, row + 1])], axis=1)


def test_ten_kilometres_from_the_origin(extruded, bend):
    """Coordinates of a map grid: the same paths; delays to 1e-3 ps, for positions are doubles of 1e-12 m."""
    shift = np.array([10e3, -7e3, 250.0])
    far = trace(extruded(bend + shift[:2], low=250.0, high=253.0), TX + shift, RX + shift)
    same(far, trace(extruded(bend)), atol=1e-5)
    near = trace(extruded(bend))
    assert np.abs(np.sort(far.delay_s) - np.sort(near.delay_s)).max() < 1e-15


def test_rotating_the_scene_turns_angles_only(extruded, bend):
    """Turned by 1 rad and moved, all azimuths turn by 1 rad; delays, elevations and gains stay."""
    c, s = np.cos(1.0), np.sin(1.0)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    shift = np.array([3.0, -11.0, 0.0])
    still = trace(extruded(bend), floor_ceiling=True)
    shifted = trace(
        extruded(bend @ turn[:2, :2].T + shift[:2]),
        TX @ turn.T + shift,
        RX @ turn.T + shift,
        floor_ceiling=True,
    )
    assert len(still) == len(shifted)
    np.testing.assert_allclose(np.sort(shifted.delay_s), np.sort(still.delay_s), rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.sort(shifted.power), np.sort(still.power), rtol=1e-6)
    for name in ("aoa_az", "aod_az"):
        got, old = getattr(shifted, name), getattr(still, name) + 1.0
        np.testing.assert_allclose(np.sort(np.sin(got)), np.sort(np.sin(old)), atol=1e-6)
        np.testing.assert_allclose(np.sort(np.cos(got)), np.sort(np.cos(old)), atol=1e-6)


@pytest.mark.parametrize("diffraction", [False, True])
def test_depth_never_removes_lower_orders(extruded, bend, diffraction):
    """Paths with up to d reflections are all there, unchanged, with a limit of d + 1."""
    mesh, last = extruded(bend), None
    for depth in range(5):
        paths = trace(mesh, max_reflections=depth, diffraction=diffraction)
        if last is not None:
            edge = (paths.interaction == 2).any(axis=1)
            same(paths.select(edge | (paths.order < depth)), last)
        last = paths


def test_weaker_paths_than_the_returned_ones_are_the_only_ones_dropped(extruded, bend):
    """The best 25 are the first 25 of all, whichever bounds have spared the computing of the rest."""
    options = {"diffraction_reflections": 2, "floor_ceiling": True}
    mesh = extruded(bend, floor=True, ceiling=True)
    some, everything = trace(mesh, max_paths=25, **options), trace(mesh, max_paths=3000, **options)
    assert everything.count().min() > 100
    np.testing.assert_array_equal(some.power, everything.strongest(25).power)
