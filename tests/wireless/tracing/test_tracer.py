"""Traced paths against what can be written down: free space, images in a box, ground, reciprocity."""

import itertools

import numpy as np
import pytest
from scipy.constants import speed_of_light

from tests.wireless.em.plane_waves import cavity_wall, reflection, slab
from wireless.em.materials import permittivity
from wireless.paths import Interaction
from wireless.tracing.tracer import SceneError, Tracer, TracerConfig

CARRIER_HZ = 28e9
WAVELENGTH_M = speed_of_light / CARRIER_HZ
ROOM = (0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)
ROOM_SIZE = np.array([6.0, 4.0, 3.0])
EPS = permittivity("drywall", CARRIER_HZ)
PS, DB = 1e-12, 0.01


def images_in_a_box(tx, rx, size, max_order, axes):
    """Every specular path in a box by its image: written for this test, shares no code with the tracer.

    The image of cell (m, n, p) is the transmitter mirrored that often per axis; its ray crosses |m| + |n| +
    |p| walls. The field is carried along the ray by 3 x 3 matrices, wall by wall in the order they are met.

    Returns:
        order, delay_s, direction at the transmitter, direction at the receiver, 2 x 2 gain of each path.
    """
    k = 2 * np.pi / WAVELENGTH_M
    found = []
    spans = [range(-max_order, max_order + 1) if axis in axes else (0,) for axis in range(3)]
    for cell in itertools.product(*spans):
        order = sum(abs(c) for c in cell)
        if order > max_order:
            continue
        image = np.array(
            [c * s + (x if c % 2 == 0 else s - x) for c, s, x in zip(cell, size, rx, strict=True)]
        )
        length = np.linalg.norm(image - tx)
        route = (image - tx) / length
        crossings = []
        for axis, c in enumerate(cell):
            planes = size[axis] * (np.arange(1, c + 1) if c > 0 else np.arange(c + 1, 1))
            crossings += [((plane - tx[axis]) / route[axis], axis) for plane in planes]
        total, out = np.eye(3, dtype=complex), route.copy()
        for _, axis in sorted(crossings):
            total, out = mirror_matrix(out, axis) @ total, np.where(np.arange(3) == axis, -out, out)
        at_tx, at_rx = polarisations(route), polarisations(-out)
        gain = at_rx @ total @ at_tx.T * np.exp(-1j * k * length) / (2 * k * length)
        found.append((order, length / speed_of_light, route, -out, gain))
    return found


def mirror_matrix(route, axis):
    """What a wall normal to an axis does to fields travelling along it."""
    normal = np.eye(3)[axis]
    r_te, r_tm = (r[0] for r in reflection(np.array([abs(route[axis])]), EPS))
    te = np.cross(route, normal)
    te /= np.linalg.norm(te)
    out = route - 2 * route[axis] * normal
    return r_te * np.outer(te, te) + r_tm * np.outer(np.cross(te, out), np.cross(te, route))


def polarisations(route):
    """Unit vectors theta and phi of a direction."""
    theta, phi = np.arccos(route[2]), np.arctan2(route[1], route[0])
    return np.array(
        [
            [np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)],
            [-np.sin(phi), np.cos(phi), 0.0],
        ]
    )


def direction(az, el):
    return np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=-1)


@pytest.mark.parametrize(("floor", "max_order"), [(False, 3), (False, 5), (True, 3)])
def test_room_has_the_paths_of_the_image_lattice(extruded, ring, floor, max_order):
    """An empty box is an infinite lattice of images: 4 k paths of order k in the plane, 4 k^2 + 2 in space."""
    mesh = extruded(ring(*ROOM), floor=floor, ceiling=floor)
    config = TracerConfig(max_reflections=max_order, diffraction=False, floor_ceiling=floor, max_paths=200)
    tracer = Tracer(mesh, frequency_hz=CARRIER_HZ, config=config)
    tx = np.array([[1.3, 2.9, 1.9], [5.2, 0.7, 0.4]])
    rx = np.array([[4.7, 1.1, 0.8], [2.2, 3.9, 2.7], [0.4, 0.43, 1.4]])
    paths = tracer.trace(tx, rx)
    for i, j in np.ndindex(2, 3):
        link = paths.between(i, j)
        expected = images_in_a_box(tx[i], rx[j], ROOM_SIZE, max_order, (0, 1, 2) if floor else (0, 1))
        counts = [4 * k * k + 2 if floor else 4 * k for k in range(1, max_order + 1)]
        assert np.bincount(link.order).tolist() == [1, *counts]
        for order, delay_s, along_tx, along_rx, gain in expected:
            near = np.linalg.norm(direction(link.aod_az, link.aod_el) - along_tx, axis=1)
            best = np.argmin(near + np.abs(link.delay_s - delay_s) * 1e9)
            assert link.order[best] == order and near[best] < 1e-4
            assert abs(link.delay_s[best] - delay_s) < PS
            assert np.linalg.norm(direction(link.aoa_az, link.aoa_el)[best] - along_rx) < 1e-4
            size = np.abs(gain).max()
            assert np.abs(link.gain[best] - gain).max() < size * (10 ** (DB / 20) - 1)


def test_an_open_path_is_friis(extruded):
    """(lambda / 4 pi d)^2 at the delay d / c, seen from both ends; the wall behind is out of reach."""
    mesh = extruded([[(-100, -5), (-100, 5)]], low=-50, high=50)
    config = TracerConfig(max_reflections=0, diffraction=False)
    rx = np.array([[1.0, 0, 0], [0, -7.0, 3.0], [30.0, 20.0, -10.0], [0, 0, 2.0]])
    paths = Tracer(mesh, config=config).trace(np.zeros((1, 3)), rx)
    distance = np.linalg.norm(rx, axis=1)
    assert np.array_equal(paths.rx, np.arange(4)) and not paths.order.any()
    np.testing.assert_allclose(paths.power, (WAVELENGTH_M / (4 * np.pi * distance)) ** 2, rtol=1e-12)
    np.testing.assert_allclose(paths.delay_s, distance / speed_of_light, rtol=1e-14)
    np.testing.assert_allclose(direction(paths.aod_az, paths.aod_el) * distance[:, None], rx, atol=1e-12)
    np.testing.assert_allclose(direction(paths.aoa_az, paths.aoa_el) * distance[:, None], -rx, atol=1e-12)
    k = 2 * np.pi / WAVELENGTH_M
    free = np.exp(-1j * k * distance) / (2 * k * distance)
    free[3] *= -1  # straight up: theta is +x at the transmitter and -x at the receiver
    np.testing.assert_allclose(paths.gain[:, 0, 0], free, rtol=1e-9)
    np.testing.assert_allclose(paths.gain[:, 1, 1], -free, rtol=1e-9)


@pytest.mark.parametrize("distance_m", [3.0, 30.0, 300.0])
def test_two_rays_over_ground(extruded, distance_m):
    """Vertical antennas over ground: direct and ground ray with R_TM and both directivities sin(theta)."""
    high, low = 4.0, 1.5
    mesh = extruded([[(-900, -900), (-900, -899)], [(900, 900), (900, 899)]], high=9.0, floor=True)
    config = TracerConfig(max_reflections=1, diffraction=False, floor_ceiling=True)
    paths = Tracer(mesh, materials=("concrete",), frequency_hz=2e9, config=config).trace(
        np.array([[0.0, 0, high]]), np.array([[distance_m, 0, low]])
    )
    k = 2 * np.pi * 2e9 / speed_of_light
    direct, ground = np.hypot(distance_m, high - low), np.hypot(distance_m, high + low)
    _, r_tm = reflection(np.array([(high + low) / ground]), permittivity("concrete", 2e9))
    expected = np.exp(-1j * k * direct) / direct + r_tm[0] * np.exp(-1j * k * ground) / ground
    routes = paths.select(paths.interaction[:, 0] != Interaction.DIFFRACTION)
    near = routes.select(routes.delay_s < 2 * direct / speed_of_light)
    assert len(near) == 2
    assert abs(abs(near.gain[:, 0, 0].sum()) * 2 * k - abs(expected)) < 1e-6 * abs(expected) + 1e-9


def test_ends_can_be_swapped(extruded, ring):
    """Reciprocity: the same paths backwards, gains transposed; also behind slanted and lossy edges."""
    pillar = ring((2.5, 1.5), (3.4, 1.7), (3.3, 2.3), (2.4, 2.1))
    mesh = extruded(np.concatenate([ring(*ROOM), pillar]), floor=True, ceiling=True)
    config = TracerConfig(diffraction_reflections=2, floor_ceiling=True, max_paths=60, polarisation="both")
    tracer = Tracer(mesh, config=config)
    rng = np.random.default_rng(5)
    a, b = (
        rng.uniform((0.1, 0.1, 0.1), (2.2, 3.9, 2.9), (4, 3)),
        rng.uniform((3.6, 0.1, 0.1), (5.9, 3.9, 2.9), (4, 3)),
    )
    there, back = tracer.trace(a, b), tracer.trace(b, a)
    for i, j in np.ndindex(4, 4):
        one, other = there.between(i, j), back.between(j, i)
        assert len(one) == len(other) == 60
        np.testing.assert_allclose(one.power, other.power, rtol=1e-9)
        clear = np.append(np.diff(one.power) < -1e-6 * one.power[1:], True)
        clear &= np.append(True, clear[:-1])  # order among equals is free
        np.testing.assert_allclose(
            one.gain[clear], other.gain[clear].transpose(0, 2, 1), rtol=1e-6, atol=1e-14
        )
        np.testing.assert_allclose(one.aoa_az[clear], other.aod_az[clear], atol=1e-9)
        np.testing.assert_allclose(one.delay_s[clear], other.delay_s[clear], rtol=1e-12)


def test_unusable_input_is_named(extruded):
    """Empty meshes, materials without faces, points that are no positions or above the ceiling."""
    mesh = extruded([[(0, 0), (1, 0)]])
    with pytest.raises(SceneError, match="0 faces"):
        Tracer(type(mesh)())
    with pytest.raises(ValueError, match="indices into 1 materials"):
        Tracer(mesh, face_material=np.array([0, 1]))
    with pytest.raises(ValueError, match="Did you mean"):
        Tracer(mesh, materials=("drywal",))
    tracer = Tracer(mesh, config=TracerConfig(scene="plan"))
    with pytest.raises(ValueError, match="rx has heights from 9"):
        tracer.trace(np.array([[0.0, 1, 1]]), np.array([[0.0, 1, 9]]))
    with pytest.raises(ValueError, match="finite positions"):
        tracer.trace(np.array([[0.0, 1, np.nan]]), np.array([[0.0, 1, 1]]))


@pytest.mark.parametrize(("thickness", "gap"), [(0.08, 0.0), (0.013, 0.089)])
@pytest.mark.parametrize("angle_deg", [0.0, 35.0, 80.0])
def test_walls_let_through_what_layers_do(extruded, angle_deg, thickness, gap):
    """Two parallel walls: the straight path has t of each; off by default, and then nothing arrives.

    Vertical fields are TE and horizontal ones TM. Judge: the layers of `tests.wireless.em.plane_waves`, less the phase
    of the path through the wall, which a ray drawn straight on has already. To 1e-8.
    """
    walls = [[(-90, 0), (90, 0)], [(-90, 1), (90, 1)]]
    across = np.array([np.tan(np.radians(angle_deg)), 1.0, 0.0]) * 3
    tx = np.array([[0.0, -1.0, 1.5]])
    options = {"max_reflections": 0, "diffraction": False, "wall_thickness_m": thickness, "wall_gap_m": gap}
    assert len(Tracer(extruded(walls), config=TracerConfig(**options)).trace(tx, tx + across)) == 0
    config = TracerConfig(max_transmissions=2, **options)
    paths = Tracer(extruded(walls), config=config).trace(tx, tx + across)
    assert paths.order == [2] and (paths.interaction[0, :2] == Interaction.TRANSMISSION).all()
    k, length = 2 * np.pi / WAVELENGTH_M, np.linalg.norm(across)
    cos_i = np.cos(np.radians([angle_deg]))
    if gap:
        _, _, *through = cavity_wall(cos_i, EPS, thickness, gap, CARRIER_HZ)
    else:
        _, _, *through = slab(cos_i, EPS, thickness, CARRIER_HZ)
    deep = 2 * thickness + gap if gap else thickness
    t_te, t_tm = (t[0] * np.exp(1j * k * deep * cos_i[0]) for t in through)
    free = np.exp(-1j * k * length) / (2 * k * length)
    np.testing.assert_allclose(paths.gain[0], np.diag([t_te**2, -(t_tm**2)]) * free, rtol=1e-8, atol=1e-18)


@pytest.mark.parametrize("angle_deg", [0.0, 22.5, 50.0])
def test_cavity_walls_reflect_as_their_layers_do(extruded, angle_deg):
    """One wall of two plasterboards: the reflected path has r of both together, TE and TM, to 1e-6.

    At 22.5 degrees that is 13 dB less than a half-space reflects, at 50 degrees 0.8 dB more.
    """
    aside = np.tan(np.radians(angle_deg)) * 3
    tx, rx = np.array([[-aside, 3.0, 1.5]]), np.array([[aside, 3.0 + 1e-9, 1.5]])
    config = TracerConfig(max_reflections=1, diffraction=False, wall_thickness_m=0.013, wall_gap_m=0.089)
    paths = Tracer(extruded([[(-90, 0), (90, 0)]]), config=config).trace(tx, rx)
    bent = paths.select(paths.order == 1)
    cos_i = np.cos(np.radians([angle_deg]))
    r_te, r_tm, _, _ = cavity_wall(cos_i, EPS, 0.013, 0.089, CARRIER_HZ)
    length = 6 / cos_i[0]
    spread = WAVELENGTH_M / (4 * np.pi * length)
    assert abs(bent.gain[0, 0, 0]) == pytest.approx(spread * abs(r_te[0]), rel=1e-6)
    assert abs(bent.gain[0, 1, 1]) == pytest.approx(spread * abs(r_tm[0]), rel=1e-6)


def test_reflections_and_passed_walls_combine(extruded, ring):
    """A box cut by a partition, from one room to the other: every path passes the partition just once.

    All of the box's images whose path crosses the partition (or a mirrored one) once are there, among those
    that the partition reflects as well; and ends can be swapped.
    """
    mesh = extruded(np.concatenate([ring(*ROOM), [[(2.5, 0), (2.5, 4)]]]))
    config = TracerConfig(
        diffraction=False, max_transmissions=1, wall_thickness_m=0.1, max_reflections=3, max_paths=200
    )
    tracer = Tracer(mesh, config=config)
    tx, rx = np.array([[1.3, 2.9, 1.5]]), np.array([[4.7, 1.1, 1.5]])
    paths = tracer.trace(tx, rx)
    passed = (paths.interaction == Interaction.TRANSMISSION).sum(axis=1)
    assert (passed == 1).all()
    # Without the delay of the partition.
    legs_m = np.linalg.norm(np.diff(paths.corners(), axis=1), axis=2)
    delays = np.sort(np.nansum(legs_m, axis=1) / speed_of_light)
    once = [
        delay
        for order, delay, route, _, _ in images_in_a_box(tx[0], rx[0], ROOM_SIZE, 3, (0, 1))
        if partition_crossings(tx[0, 0], route[0] * delay * speed_of_light) == 1
    ]
    assert len(once) > 8
    assert np.abs(delays[:, None] - np.array(once)).min(axis=0).max() < 1e-15
    np.testing.assert_allclose(np.sort(tracer.trace(rx, tx).delay_s), np.sort(paths.delay_s), atol=1e-18)


def partition_crossings(start, run):
    """How often a path that runs so far along the box's long side meets the partition or its mirror images."""
    cells = np.arange(-10, 10)
    planes = np.concatenate([12.0 * cells + 2.5, 12.0 * cells - 2.5])
    return int(((planes - start) * (planes - start - run) < 0).sum())
