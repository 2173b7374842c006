"""Paths that rough walls scatter: against the radar equation, Monte Carlo over rays, and conservation of energy."""

import numpy as np
import pytest
import trimesh
from scipy.constants import speed_of_light

from tests.wireless.em.plane_waves import reflection
from wireless.em.materials import Layer, Material, permittivity
from wireless.em.scattering import lobe, lobe_integral
from wireless.paths import Interaction, LinkState
from wireless.tracing.tracer import Tracer, TracerConfig

CARRIER_HZ = 28e9
WAVELENGTH_M = speed_of_light / CARRIER_HZ
WALL = [[(-3.0, 0.0), (3.0, 0.0)]]
TX, RX = np.array([[-1.0, 2.0, 1.5]]), np.array([[1.2, 1.4, 1.1]])


def config(**more):
    return TracerConfig(
        **{"max_reflections": 0, "diffraction": False, "max_paths": 5000, "scattering": 0.4} | more
    )


def scattered(mesh, tx=TX, rx=RX, **more):
    """Scattered paths of links, walls of concrete that are half-spaces."""
    paths = Tracer(mesh, materials=("concrete",), config=config(**more)).trace(tx, rx)
    return paths.select(paths.interaction[:, 0] == Interaction.SCATTERING)


def test_diffracted_paths_stay_as_strong_where_walls_scatter(extruded):
    """Also where the mesh has more edges than facets: only reflections lose what is scattered."""
    mesh = trimesh.creation.icosphere(subdivisions=0)
    options = {"diffraction": True, "scene": "space", "floor_ceiling": False, "diffraction_reflections": 0}
    around = np.random.default_rng(0).normal(size=(60, 3))
    ends = np.array([[-3.0, 0.3, 0.1]]), 1.5 * around / np.linalg.norm(around, axis=1, keepdims=True)
    rough, smooth = (
        Tracer(mesh, config=config(scattering=share, **options)).trace(*ends) for share in (0.4, None)
    )
    reflected = rough.select(rough.interaction[:, 0] != Interaction.SCATTERING)
    assert len(smooth) and np.array_equal(reflected.power, smooth.power)


@pytest.mark.parametrize("scene", ["plan", "space"])
@pytest.mark.parametrize("alpha", [None, 0, 4])
def test_a_small_piece_follows_the_radar_equation(extruded, alpha, scene):
    """A wall of 2 cm by 2 cm, far away: P = sigma lambda^2 / ((4 pi)^3 r_i^2 r_s^2), within 0.1 %.

    sigma = 4 pi S^2 |r_te|^2 A cos(theta_i) f / F by hand, as in a level plane vertical fields are TE.
    """
    mesh = extruded([[(-0.01, 0.0), (0.01, 0.0)]], low=1.49, high=1.51)
    tx, rx = np.array([[-3.0, 4.0, 1.5]]), np.array([[2.0, 1.5, 1.5]])
    power = scattered(mesh, tx, rx, scattering_lobe=alpha, scene=scene).power.sum()
    cos_i, cos_s = np.array([4 / 5]), np.array([1.5 / 2.5])
    cos_psi = np.array([np.dot([3 / 5, 4 / 5], [2 / 2.5, 1.5 / 2.5])])
    r_te = abs(reflection(cos_i, permittivity("concrete", CARRIER_HZ))[0][0])
    shape = (lobe(cos_psi, cos_s, alpha) / lobe_integral(cos_i, alpha))[0]
    sigma = 4 * np.pi * 0.4**2 * r_te**2 * 0.02**2 * cos_i[0] * shape
    assert power == pytest.approx(sigma * WAVELENGTH_M**2 / ((4 * np.pi) ** 3 * 25 * 6.25), rel=1e-3)


@pytest.mark.parametrize("scene", ["plan", "space"])
@pytest.mark.parametrize("alpha", [None, 4])
def test_a_wall_scatters_as_rays_that_are_shot_at_it(extruded, alpha, scene):
    """Rays from the transmitter in all directions, each joined to the receiver where it meets the wall: within 1 %."""
    paths = scattered(extruded(WALL, high=2.5), scattering_lobe=alpha, scene=scene)
    rng = np.random.default_rng(0)
    n = 2_000_000
    z, az = rng.uniform(-1, 1, n), rng.uniform(0, 2 * np.pi, n)
    route = np.column_stack([np.sqrt(1 - z**2) * np.cos(az), np.sqrt(1 - z**2) * np.sin(az), z])
    down = route[:, 1] < 0
    at = np.where(down, -TX[0, 1] / np.where(down, route[:, 1], -1), 0)[:, None] * route + TX[0]
    hit = down & (np.abs(at[:, 0]) < 3) & (at[:, 2] > 0) & (at[:, 2] < 2.5)
    route, at = route[hit], at[hit]
    out = RX[0] - at
    r_s = np.linalg.norm(out, axis=1)
    out /= r_s[:, None]
    cos_i, cos_s = -route[:, 1], out[:, 1]
    cos_psi = (route * (1, -1, 1) * out).sum(axis=1)
    te, tm = (np.abs(r) ** 2 for r in reflection(cos_i, permittivity("concrete", CARRIER_HZ)))
    across = np.cross(route, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    theta = np.cross(np.cross([0.0, 0.0, 1.0], route), route)
    theta /= np.linalg.norm(theta, axis=1, keepdims=True)
    share = (across * theta).sum(axis=1) ** 2
    each = (
        0.4**2 * (share * te + (1 - share) * tm) * lobe(cos_psi, cos_s, alpha) / lobe_integral(cos_i, alpha)
    )
    total = (each * WAVELENGTH_M**2 / (4 * np.pi * r_s**2)).sum() / n
    assert paths.power.sum() == pytest.approx(total, rel=0.01)


def test_power_does_not_depend_on_the_size_of_tiles(extruded):
    """Tiles of 1 m, 0.5 m and 0.125 m add up to the same power within 0.5 %, also 10 cm from the wall."""
    mesh = extruded(WALL, high=2.5)
    near = np.array([[0.4, 0.1, 1.3]])
    for rx in (RX, near):
        coarse, middle, fine = (
            scattered(mesh, rx=rx, scattering_tile_m=m).power.sum() for m in (1.0, 0.5, 0.125)
        )
        assert coarse == pytest.approx(fine, rel=0.005) and middle == pytest.approx(fine, rel=0.005)


@pytest.mark.parametrize("scene", ["plan", "space"])
def test_reflected_and_scattered_power_is_what_a_smooth_wall_reflects(extruded, scene):
    """Reflections keep 1 - S^2 each; a sphere of receivers round a small piece takes S^2 |r|^2 of what falls on it.

    Receivers at 3,000 even directions before the wall: within 1 %.
    """
    mesh = extruded(WALL, high=2.5)
    smooth, rough = (
        Tracer(
            mesh, materials=("concrete",), config=config(scattering=s, max_reflections=1, scene=scene)
        ).trace(TX, RX)
        for s in (None, 0.4)
    )
    mirrored = [p.power[p.interaction[:, 0] == Interaction.REFLECTION] for p in (smooth, rough)]
    assert mirrored[1] == pytest.approx((1 - 0.4**2) * mirrored[0], rel=1e-12)
    piece = extruded([[(-0.005, 0.0), (0.005, 0.0)]], low=1.495, high=1.505)
    n = 3000
    cos_s = (np.arange(n) + 0.5) / n
    turn = np.arange(n) * np.pi * (3 - np.sqrt(5))
    level = np.sqrt(1 - cos_s**2)
    around = np.column_stack([level * np.cos(turn), cos_s, level * np.sin(turn)]) * 0.004 / 0.005
    tracer = Tracer(piece, materials=("concrete",), config=config(scene=scene))
    powers = tracer._scattering.powers
    tx, middle = np.array([-3.0, 4.0, 1.5]) - tracer.scene.origin, [0, 0, 1.5] - tracer.scene.origin
    some = np.flatnonzero(tracer._scattering.tiles.normal[:, 1] > 0)
    received = np.array([powers(tx, one + middle, some)[:, 0].sum() for one in around])
    # Each receiver takes lambda^2 / 4 pi of the power per area, on a sphere of radius 0.8 m.
    out = (received * 4 * np.pi / WAVELENGTH_M**2).mean() * 2 * np.pi * 0.8**2
    r_te = abs(reflection(np.array([0.8]), permittivity("concrete", CARRIER_HZ))[0][0])
    fallen = 0.01**2 * 0.8 / (4 * np.pi * 25)
    assert out == pytest.approx(0.4**2 * r_te**2 * fallen, rel=0.01)


@pytest.mark.parametrize("scene", ["plan", "space"])
def test_only_what_both_ends_see_scatters(extruded, scene):
    """A wall between hides the half of the other: all tiles lie where neither segment crosses it; behind is nothing."""
    mesh = extruded([*WALL, [(0.0, 0.5), (0.0, 4.0)]], high=2.5)
    paths = scattered(mesh, scene=scene)
    on_far = np.abs(paths.point[:, 0, 1]) < 1e-9
    assert on_far.any()
    for end in (TX[0], RX[0]):
        x, y = (paths.point[on_far, 0] - end).T[:2]
        crossed = end[0] * (paths.point[on_far, 0, 0]) < 0
        height = end[1] + y * (-end[0]) / np.where(x == 0, 1e-9, x)
        assert not (crossed & (height > 0.5 + 1e-6)).any()
    assert len(scattered(extruded(WALL, high=2.5), rx=np.array([[1.0, -1.0, 1.0]]), scene=scene)) == 0


def test_paths_are_one_bounce_and_the_same_each_time(extruded):
    """Order 1, delay and directions by the tile's middle, first order for the link state; twice the same, any block."""
    mesh = extruded(WALL, high=2.5)
    paths = scattered(mesh)
    point = paths.point[:, 0]
    length = np.linalg.norm(point - TX[0], axis=1) + np.linalg.norm(point - RX[0], axis=1)
    np.testing.assert_allclose(paths.delay_s * speed_of_light, length, rtol=1e-12)
    np.testing.assert_allclose(np.abs(paths.gain[:, 0, 0]) ** 2, paths.power, rtol=1e-12)
    assert (paths.order == 1).all() and (np.diff(paths.power) <= 0).all()
    both = scattered(mesh, rx=np.vstack([RX, RX + 0.3]))
    np.testing.assert_array_equal(both.gain[both.rx == 0], paths.gain)
    hidden = extruded([*WALL, [(0.0, 0.5), (0.0, 4.0)]], high=2.5)
    tracer = Tracer(hidden, materials=("concrete",), config=config())
    assert tracer.trace(TX, RX).link_state() == LinkState.FIRST_ORDER


def test_a_material_says_how_rough_it_is(extruded):
    """S = 0.8 of its own in place of 0.4, and a lobe of its own: 4 times the power of its smooth twin's; 0 is none."""
    mesh = extruded(WALL, high=2.5)
    boards = (Layer(thickness_m=0.013, material="drywall"),)
    sums = {
        s: Tracer(mesh, materials=(Material("m", boards, s),), config=config(max_transmissions=0))
        .trace(TX, RX)
        .power[1:]
        .sum()
        for s in (None, 0.0, 0.8)
    }
    assert sums[0.0] == 0.0
    assert sums[0.8] == pytest.approx(4 * sums[None], rel=1e-9)


def test_a_leaning_wall_scatters_as_an_upright_one(extruded):
    """Wall and ends turned by 37 degrees about the wall: the same power of both polarisations, within 0.2 %."""
    mesh = extruded(WALL, high=2.5)
    turn = np.array([[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]])
    leaning = mesh.copy()
    leaning.vertices = mesh.vertices @ turn.T
    upright = scattered(mesh, polarisation="both").power.sum()
    assert scattered(leaning, TX @ turn.T, RX @ turn.T, polarisation="both").power.sum() == pytest.approx(
        upright, rel=2e-3
    )


def test_points_above_a_plan_scatter_in_space(extruded):
    """A receiver above the ceiling gets what a scene in space gives; storeys as such are rejected."""
    mesh, rx = extruded(WALL, high=2.5), RX + np.array([0, 0, 2.0])
    assert len(scattered(mesh, rx=rx)) > 10
    np.testing.assert_array_equal(scattered(mesh, rx=rx).gain, scattered(mesh, rx=rx, scene="space").gain)
    with pytest.raises(ValueError, match="floor plans and in space"):
        TracerConfig(scattering=0.3, scene="storeys")
