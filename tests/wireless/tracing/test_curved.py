"""Round posts and curved walls: against the exact series of a cylinder, mirror images, and what hides them."""

import numpy as np
import pytest
from scipy.constants import speed_of_light
from scipy.special import hankel2, jv

from wireless.paths import Interaction
from wireless.tracing.tracer import SceneError, Tracer, TracerConfig

CARRIER_HZ = 28e9
WAVENUMBER = 2 * np.pi * CARRIER_HZ / speed_of_light
RADIUS_M = 0.2


def post(n=64, centre=(0.0, 0.0)):
    """Walls of a round post, whose chords are as often outside of the circle as inside."""
    angle = 2 * np.pi * np.arange(n + 1) / n
    radius = RADIUS_M * 2 / (1 + np.cos(np.pi / n))
    point = centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.stack([point[:-1], point[1:]], axis=1)


def traced(mesh, tx, rx, **more):
    """Paths over metal."""
    config = TracerConfig(
        **{"max_reflections": 1, "diffraction": False, "curved_walls": True, "max_paths": 100} | more
    )
    return Tracer(mesh, materials=("metal",), config=config).trace(np.atleast_2d(tx), np.atleast_2d(rx))


def around(radius, degrees, z=1.5):
    angle = np.radians(degrees)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)])


def series(radius_m, angle_rad):
    """Field that a metal cylinder scatters of a plane wave along -x, electric field along the axis."""
    n = np.arange(-400, 401)
    ratio = jv(n, WAVENUMBER * RADIUS_M) / hankel2(n, WAVENUMBER * RADIUS_M)
    ratio[~np.isfinite(ratio)] = 0
    with np.errstate(invalid="ignore", over="ignore"):
        waves = ratio * hankel2(n, WAVENUMBER * radius_m)
    waves[~np.isfinite(waves)] = 0
    return -(1j**n * waves * np.exp(1j * n * angle_rad)).sum()


@pytest.mark.parametrize("n", [16, 64])
def test_a_post_is_as_strong_as_a_cylinder(extruded, n):
    """Source 300 m away, receivers 12 m from the axis at 0 to 120 degrees: within 0.15 dB of the exact series.

    Of a source so far away a wave is plane, but as strong as from a point: the series is times lambda / (4 pi s1) and
    spreads along the axis, too, by s1 / (s1 + s2).
    """
    degrees = np.array([10.0, 30.0, 60.0, 90.0, 120.0])
    rx = around(12.0, degrees)
    paths = traced(extruded(post(n)), around(300.0, [0.0]), rx)
    bounced = paths.select(paths.order == 1)
    assert list(bounced.rx) == list(range(len(rx)))
    field = np.array([abs(series(12.0, np.radians(one))) for one in degrees])
    exact = field**2 / (2 * WAVENUMBER * 300.0) ** 2 * 300 / 312
    np.testing.assert_allclose(bounced.power_db, 10 * np.log10(exact), atol=0.15)


def test_from_far_away_the_echo_width_is_pi_a_cos(extruded):
    """Sigma = pi a cos(half the angle between both ends), which adds up to the width 2 a over all directions."""
    degrees = np.arange(-168.75, 169, 22.5)
    paths = traced(extruded(post()), around(2000.0, [0.0], 1.0), around(500.0, degrees, 1.0))
    bounced = paths.select(paths.order == 1)
    s, t = 2000 - RADIUS_M, 500 - RADIUS_M
    width = bounced.power * (2 * WAVENUMBER) ** 2 * s * t * (s + t) * 2 * np.pi
    expected = np.pi * RADIUS_M * np.cos(np.radians(degrees) / 2)
    np.testing.assert_allclose(width, expected, rtol=4e-3)
    assert width.sum() * np.radians(22.5) / (2 * np.pi) == pytest.approx(2 * RADIUS_M, rel=0.02)


def test_a_metal_wall_before_or_after_a_post_mirrors_it(extruded):
    """Length as from its mirror image within 1e-9, power within 0.2 %, of which metal absorbs 0.1; and reversed."""
    wall = [[(-8.0, -3.0), (8.0, -3.0)]]
    tx, rx = np.array([[4.0, 1.0, 1.2]]), np.array([[-2.0, 2.5, 2.0], [1.0, 3.0, 0.4]])
    image = np.array([1, -1, 1]) * tx + [0, -6, 0]
    direct = traced(extruded(post()), image, rx)
    direct = direct.select(direct.order == 1)
    both = traced(extruded(np.concatenate([post(), wall])), tx, rx, max_reflections=2)
    back = traced(extruded(np.concatenate([post(), wall])), rx, tx, max_reflections=2)
    for paths in (both, back):
        some = paths.select((paths.order == 2) & (np.abs(paths.point[:, :, 1] + 3) < 1e-9).any(axis=1))
        for power, length in zip(direct.power, direct.delay_s, strict=True):
            same = np.abs(some.delay_s / length - 1) < 1e-9
            assert same.sum() == 1 and some.power[same] == pytest.approx(power, rel=2e-3)
    bounce = both.point[both.order == 2][0]
    on_post = bounce[np.abs(np.hypot(*bounce[:, :2].T) - RADIUS_M) < 1e-3]
    assert len(on_post) == 1


def test_curved_walls_replace_their_chords_only(extruded):
    """A square post changes nothing; of a round one no chord reflects, and its corners diffract around it only."""
    tx, rx = np.array([[4.0, 1.0, 1.2]]), np.array([[2.0, 3.0, 2.0], [-4.0, -0.9, 1.0]])
    corners = np.array([(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)])
    square = extruded(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    flat, curved = (traced(square, tx, rx, diffraction=True, curved_walls=is_on) for is_on in (False, True))
    np.testing.assert_array_equal(flat.gain, curved.gain)
    few = traced(square, tx, rx, diffraction=True, max_paths=2)
    np.testing.assert_array_equal(few.gain, flat.select(flat.rank < 2).gain)
    paths = traced(extruded(post(16)), tx, rx, diffraction=True)
    lit = paths.select(paths.rx == 0)
    assert [int(kind) for kind in lit.interaction[lit.order == 1, 0]] == [Interaction.REFLECTION]
    shadow = paths.select(paths.rx == 1)
    assert len(shadow) and (shadow.interaction[:, 0] == Interaction.DIFFRACTION).all()


def test_a_hidden_post_reflects_nothing(extruded):
    """A screen hides it from the receiver; without the screen there is a path."""
    tx, rx = np.array([[4.0, 1.0, 1.2]]), np.array([[2.0, 3.0, 2.0]])
    screen = [[(-1.0, 1.0), (1.5, 0.5)]]
    for walls, number in ((post(), 1), (np.concatenate([post(), screen]), 0)):
        paths = traced(extruded(walls), tx, rx)
        on_post = np.hypot(*paths.point[:, 0, :2].T) < 0.3
        assert on_post.sum() == number


def test_curved_walls_need_a_floor_plan(extruded):
    mesh = extruded(post())
    with pytest.raises(SceneError, match="curved walls are traced in floor plans only"):
        traced(mesh, np.zeros(3), np.ones(3), scene="space")
    with pytest.raises(ValueError, match="curved walls are traced in floor plans only"):
        traced(mesh, np.array([3.0, 0, 1]), np.array([3.0, 3, 9]))
