"""Walls met by plane waves: against textbook values, energy, and transfer matrices computed apart."""

import numpy as np
import pytest
from scipy.constants import mu_0, speed_of_light

from tests.wireless.em.plane_waves import cavity_wall, reflection, slab
from wireless.em.materials import permittivity, properties

CARRIER_HZ = 28e9
COSINES = np.cos(np.radians(np.linspace(0.0, 89.9, 200)))


def transfer_matrices(angle, layers, frequency_hz, polarisation):
    """Layers (eps, thickness) by 2 x 2 (ABCD) matrices of tangential fields; written for this test, shares no code.

    E and H along the faces before and after obey [E0, H0] = M [E1, H1]; impedances are over that of vacuum,
    TE: 1 / (n cos), TM: cos / n. For TM the result is turned to the sign custom of the electric field used by
    `tests.wireless.em.plane_waves`, in which a mirrored normal wave counts as positive.
    """
    z0 = {"te": 1 / np.cos(angle), "tm": np.cos(angle)}[polarisation]
    m = np.eye(2)
    for eps, thickness_m in layers:
        inside = np.sqrt(eps - np.sin(angle) ** 2)  # n cos(angle inside)
        z1 = {"te": 1 / inside, "tm": inside / eps}[polarisation]
        delta = 2 * np.pi * frequency_hz / speed_of_light * thickness_m * inside
        m = m @ np.array([[np.cos(delta), 1j * z1 * np.sin(delta)], [1j * np.sin(delta) / z1, np.cos(delta)]])
    e, h = m @ np.array([1.0, 1.0 / z0])  # behind the last: a wave that leaves, E = 1
    incident, reflected = (e + z0 * h) / 2, (e - z0 * h) / 2
    sign = {"te": 1, "tm": -1}[polarisation]
    return sign * reflected / incident, 1 / incident


def test_normal_incidence_is_the_textbook_ratio():
    """(1 - n) / (1 + n): eps = 4 gives -1/3 for TE and +1/3 for TM, whose direction is mirrored."""
    r_te, r_tm = reflection(np.array([1.0]), 4.0 + 0j)
    assert r_te[0] == pytest.approx(-1 / 3) and r_tm[0] == pytest.approx(1 / 3)


def test_tm_vanishes_at_brewster_angle():
    """tan(theta_B) = n makes r_TM zero; there |r_TE| = (n^2 - 1) / (n^2 + 1)."""
    eps = 5.24 + 0j
    cos_b = np.cos(np.arctan(np.sqrt(eps.real)))
    r_te, r_tm = reflection(np.array([cos_b]), eps)
    assert abs(r_tm[0]) < 1e-12
    assert abs(r_te[0]) == pytest.approx((eps.real - 1) / (eps.real + 1), rel=1e-12)


@pytest.mark.parametrize("name", ["drywall", "concrete", "glass", "metal"])
def test_grazing_incidence_reflects_all_with_a_change_of_sign(name):
    """Both ratios reach -1 exactly at 90 degrees, for half-space, slab and cavity wall; nothing gets through."""
    eps = permittivity(name, CARRIER_HZ)
    half = reflection(np.array([0.0]), eps)
    assert np.allclose(half, -1, atol=1e-12)
    for wall in (
        slab(np.array([0.0]), eps, 0.013, CARRIER_HZ),
        cavity_wall(np.array([0.0]), eps, 0.013, 0.089, CARRIER_HZ),
    ):
        assert np.allclose(wall[:2], -1, atol=1e-12)
        assert np.allclose(wall[2:], 0, atol=1e-12)


def test_vacuum_neither_reflects_nor_delays():
    """No reflection, and t = exp(-j k d cos i), grazing included."""
    cosines = np.append(COSINES, 0.0)
    r_te, r_tm, t_te, t_tm = slab(cosines, 1.0 + 0j, 0.1, CARRIER_HZ)
    straight = np.exp(-2j * np.pi * CARRIER_HZ / speed_of_light * 0.1 * cosines)
    assert np.abs([r_te, r_tm]).max() < 1e-12
    assert np.abs([t_te - straight, t_tm - straight]).max() < 1e-9


@pytest.mark.parametrize("thickness_m", [0.001, 0.0127, 0.3])
@pytest.mark.parametrize("eps", [2.94 + 0j, 6.31 + 0j])
def test_lossless_slab_keeps_all_energy(eps, thickness_m):
    """|r|^2 + |t|^2 = 1 to 1e-12: vacuum on both sides, so powers compare directly."""
    r_te, r_tm, t_te, t_tm = slab(COSINES, eps, thickness_m, CARRIER_HZ)
    for r, t in ((r_te, t_te), (r_tm, t_tm)):
        assert np.abs(np.abs(r) ** 2 + np.abs(t) ** 2 - 1).max() < 1e-12


@pytest.mark.parametrize("name", ["drywall", "concrete", "wood", "ceiling_board", "glass", "plywood"])
def test_lossy_slab_never_gains_energy(name):
    """|r|^2 + |t|^2 < 1 at every angle for walls of 1 mm to 1 m."""
    for thickness_m in np.geomspace(0.001, 1.0, 13):
        r_te, r_tm, t_te, t_tm = slab(COSINES, permittivity(name, CARRIER_HZ), float(thickness_m), CARRIER_HZ)
        for r, t in ((r_te, t_te), (r_tm, t_tm)):
            assert (np.abs(r) ** 2 + np.abs(t) ** 2 < 1).all()


@pytest.mark.parametrize("name", ["drywall", "concrete", "glass", "wood"])
def test_slab_equals_transfer_matrices(name):
    """Magnitude and phase, TE and TM, 40 angles, three thicknesses: equal to 1e-10."""
    eps = permittivity(name, CARRIER_HZ)
    angles = np.radians(np.linspace(0, 88, 40))
    for thickness_m in (0.002, 0.0127, 0.05):
        got = slab(np.cos(angles), eps, thickness_m, CARRIER_HZ)
        for polarisation, r, t in (("te", got[0], got[2]), ("tm", got[1], got[3])):
            want = np.array(
                [transfer_matrices(a, [(eps, thickness_m)], CARRIER_HZ, polarisation) for a in angles]
            )
            assert np.abs(r - want[:, 0]).max() < 1e-10
            assert np.abs(t - want[:, 1]).max() < 1e-10


@pytest.mark.parametrize("gap_m", [0.0, 0.02, 0.089])
def test_cavity_wall_equals_transfer_matrices(gap_m):
    """Two plasterboards of 13 mm with air between, TE and TM, 40 angles: equal to 1e-10.

    A cavity that forgets what goes to and fro in the gap is wrong by up to 0.2.
    """
    eps = permittivity("drywall", CARRIER_HZ)
    angles = np.radians(np.linspace(0, 88, 40))
    got = cavity_wall(np.cos(angles), eps, 0.013, gap_m, CARRIER_HZ)
    layers = [(eps, 0.013), (1.0 + 0j, gap_m), (eps, 0.013)]
    for polarisation, r, t in (("te", got[0], got[2]), ("tm", got[1], got[3])):
        want = np.array([transfer_matrices(a, layers, CARRIER_HZ, polarisation) for a in angles])
        assert np.abs(r - want[:, 0]).max() < 1e-10
        assert np.abs(t - want[:, 1]).max() < 1e-10


def test_two_layers_without_gap_are_one_of_twice_the_thickness():
    eps = permittivity("glass", CARRIER_HZ)
    two, one = cavity_wall(COSINES, eps, 0.004, 0.0, CARRIER_HZ), slab(COSINES, eps, 0.008, CARRIER_HZ)
    assert np.abs(np.array(two) - one).max() < 1e-12


def test_thick_lossy_slab_is_a_half_space():
    """1 m of concrete: the back face is negligible (-150 dB), reflection equals Fresnel's to 1e-12."""
    eps = permittivity("concrete", CARRIER_HZ)
    thick, half = slab(COSINES, eps, 1.0, CARRIER_HZ), reflection(COSINES, eps)
    assert np.abs(np.array(thick[:2]) - half).max() < 1e-12
    assert np.abs(thick[2:]).max() < 10 ** (-150 / 20)


def test_loss_through_a_slab_is_that_of_its_conductivity():
    """Weakly lossy: 20 log10(e) (sigma / 2) sqrt(mu / eps) per metre, to 0.1 %; drywall 117 dB/m at 28 GHz.

    The difference between 1.0 and 1.1 m, as the faces add the same to both.
    """
    eps_r, sigma = properties("drywall", CARRIER_HZ)
    eps = permittivity("drywall", CARRIER_HZ)
    through = [abs(slab(np.array([1.0]), eps, d, CARRIER_HZ)[2][0]) for d in (1.0, 1.1)]
    per_metre_db = 20 * np.log10(through[0] / through[1]) / 0.1
    assert per_metre_db == pytest.approx(
        20 * np.log10(np.e) * sigma / 2 * mu_0 * speed_of_light / eps_r**0.5, rel=1e-3
    )


def test_walls_come_in_batches():
    """Angles and materials broadcast: (angles, materials) in one call equal single calls."""
    eps = np.array([permittivity(name, CARRIER_HZ) for name in ("drywall", "concrete")])
    r_te, r_tm = reflection(np.tile(COSINES[:, None], 2), np.tile(eps, (len(COSINES), 1)))
    one = reflection(COSINES, eps[1])
    assert np.array_equal(r_te[:, 1], one[0]) and np.array_equal(r_tm[:, 1], one[1])


def test_impossible_walls_are_rejected():
    """Gain, angles behind the wall, no thickness, a negative gap: the message names the value."""
    with pytest.raises(ValueError, match=r"Im\(eps\) is 0.1"):
        reflection(COSINES, 2 + 0.1j)
    with pytest.raises(ValueError, match="cos_i reaches from -1"):
        reflection(np.array([-1.0]), 2 + 0j)
    with pytest.raises(ValueError, match="thickness_m is 0"):
        slab(COSINES, 2 + 0j, 0.0, CARRIER_HZ)
    with pytest.raises(ValueError, match=r"gap_m is -0.1"):
        cavity_wall(COSINES, 2 + 0j, 0.013, -0.1, CARRIER_HZ)
