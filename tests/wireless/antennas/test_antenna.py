"""Elements against independent quadrature, closed forms and the tables they come from."""

import numpy as np
import pytest
from scipy.integrate import dblquad

from wireless import MountedArray
from wireless.antennas.arrays import uniform_array
from wireless.antennas.elements import (
    ELEMENTS,
    DipoleElement,
    PatchElement,
    SectorElement,
    directivity,
    element_named,
)
from wireless.antennas.sphere import sphere, unit_vector


@pytest.mark.parametrize("name", ELEMENTS)
def test_directivity_integrates_to_four_pi(name):
    """Power density over its mean, summed over the sphere by adaptive quadrature in azimuth and elevation."""
    element = element_named(name)

    def density(elevation, azimuth):
        direction = unit_vector(np.array([azimuth]), np.array([elevation]))
        return float(element.amplitude(direction)[0] ** 2 * np.cos(elevation))

    halves = [(-np.pi / 2, np.pi / 2)] if name == "patch" else [(-np.pi, 0), (0, np.pi)]
    total = sum(dblquad(density, a, b, -np.pi / 2, np.pi / 2, epsabs=1e-4, epsrel=1e-4)[0] for a, b in halves)
    ahead = np.array([[1.0, 0.0, 0.0]])
    want = 4 * np.pi * element.amplitude(ahead) ** 2 / total
    assert directivity(element, ahead)[0] == pytest.approx(want[0], rel=2e-3)


def test_mean_over_the_sphere_is_exact_for_polynomials():
    """Means of 1, x^2, y^2 z^2 and x^4 y^2 z^2 over the sphere are 1, 1/3, 1/15 and 3/945."""
    (x, y, z), share = sphere(8)[0].T, sphere(8)[1]
    got = [share @ f for f in (np.ones_like(x), x**2, y**2 * z**2, x**4 * y**2 * z**2)]
    np.testing.assert_allclose(got, [1, 1 / 3, 1 / 15, 3 / 945], rtol=1e-13)


def test_patch_of_short_sides_is_a_magnetic_dipole_on_a_wall():
    """Slots far shorter than a wave radiate 1 - y^2 into the half space: directivity 3 straight ahead."""
    tiny = PatchElement(permittivity=5000.0, thickness_wl=1e-4)
    assert tiny.width_wl < 0.011
    assert directivity(tiny, np.array([[1.0, 0, 0]]))[0] == pytest.approx(3.0, rel=3e-3)


def test_patch_reaches_the_zenith_but_not_the_sides():
    """Upright slots: at the rim nothing in azimuth (plane of H), cos(pi L / lambda) upwards, nothing behind."""
    patch = PatchElement()
    rim = unit_vector(np.array([np.pi / 2 - 1e-9, 0.0, np.pi]), np.array([0.0, np.pi / 2 - 1e-9, 0.0]))
    got = patch.amplitude(rim)
    assert got[0] < 1e-8
    assert got[1] == pytest.approx(np.cos(np.pi * patch.length_wl), rel=1e-6)
    assert got[2] == 0.0


def test_sector_element_meets_its_table():
    """TR 38.901 table 7.3-1: -3 dB at 32.5 degrees to either side, -30 dB at most, sums of both in between."""
    az, el = np.deg2rad([[0.0, 32.5, 0.0, 32.5, 180.0, 60.0], [0.0, 0.0, 32.5, 32.5, 0.0, 60.0]])
    got = 20 * np.log10(SectorElement().amplitude(unit_vector(az, el)))
    both = 2 * 12 * (60 / 65) ** 2
    np.testing.assert_allclose(got, [0, -3, -3, -6, -30, -both], atol=1e-9)


def test_dipoles_have_the_directivity_of_the_textbook():
    """Balanis 4-91, table 4.1: 1.643 for half a wave, 1.5 for a short wire, 2.41 for a full wave; 0 along the wire."""
    side = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    for length_wl, want in ((0.5, 1.6409), (0.001, 1.5), (1.0, 2.411)):
        got = directivity(DipoleElement(length_wl=length_wl), side)
        assert got[0] == pytest.approx(want, rel=1e-3) and got[1] == 0
    at = unit_vector(np.array([0.3]), np.array([0.7]))
    theta = np.pi / 2 - 0.7
    assert DipoleElement().amplitude(at) == pytest.approx(np.cos(np.pi / 2 * np.cos(theta)) / np.sin(theta))


def test_bad_elements_are_named():
    """The message says what is known, and what is out of range."""
    with pytest.raises(ValueError, match=r"'dish'. Known: patch, 3gpp, .*, or a .csv, .msi or .pln file"):
        element_named("dish")
    with pytest.raises(ValueError, match=r"thickness_wl is 0.2"):
        PatchElement(thickness_wl=0.2)
    with pytest.raises(ValueError, match=r"permittivity is 0.5"):
        PatchElement(permittivity=0.5)


def test_3gpp_element_has_the_gain_of_the_standard():
    """TR 38.901, table 7.3-1: 8 dBi; the directivity of its shape is 9.83 dBi."""
    ahead = np.zeros(1), np.zeros(1), np.zeros(1, int)
    field = MountedArray(array=uniform_array(1, element="3gpp")).response(*ahead)
    assert 20 * np.log10(np.abs(field[0, 0, 0])) == pytest.approx(8.0, abs=1e-9)
    element = element_named("3gpp")
    assert 10 * np.log10(directivity(element, np.array([[1.0, 0, 0]]))[0]) == pytest.approx(9.83, abs=0.01)
