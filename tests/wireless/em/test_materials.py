"""Radio materials: the published fits against numbers worked out by hand."""

import numpy as np
import pytest

from tests.wireless.em.plane_waves import reflection
from wireless.em.materials import MATERIALS, Layer, Material, check_material, permittivity, properties

CARRIER_HZ = 28e9


def test_drywall_is_that_of_the_reference_at_28_ghz():
    """Relative permittivity 2.94 and 0.1226 S/m, which is 0.0116 * 28^0.7076 = 0.12259."""
    assert properties("drywall", CARRIER_HZ) == (2.94, pytest.approx(0.1226, abs=5e-5))


def test_concrete_at_28_ghz_by_hand():
    """5.24, and 0.0462 * 28^0.7822 = 0.6261 S/m, so Im(eps) = -17.975 * 0.6261 / 28 = -0.4019."""
    eps = permittivity("concrete", CARRIER_HZ)
    assert eps.real == 5.24
    assert eps.imag == pytest.approx(-17.975 * 0.6261 / 28, rel=2e-4)


def test_permittivity_falls_with_frequency_where_b_is_negative():
    """Wet ground at 10 GHz: 30 * 10^-0.4 = 11.943; catches f in the wrong unit."""
    assert properties("wet_ground", 10e9)[0] == pytest.approx(11.943, abs=1e-3)


def test_vacuum_is_vacuum_and_metal_reflects():
    """Exactly eps = 1; a metal half-space gives |r| within 1e-3 of 1 at normal incidence, 28 GHz."""
    assert permittivity("vacuum", CARRIER_HZ) == 1
    r_te, r_tm = reflection(np.array([1.0]), permittivity("metal", CARRIER_HZ))
    assert abs(r_te[0] + 1) < 1e-3 and abs(r_tm[0] - 1) < 1e-3


@pytest.mark.parametrize("name", MATERIALS)
def test_every_fit_is_passive_at_both_ends_of_its_range(name):
    """eps_r >= 1 and no gain; the first of overlapping rows holds, so ends may belong to another row."""
    for row in MATERIALS[name]:
        assert row.low_ghz < row.high_ghz
        for frequency_ghz in (row.low_ghz, row.high_ghz):
            eps = permittivity(name, frequency_ghz * 1e9)
            assert eps.real >= 1 and eps.imag <= 0


def test_frequencies_outside_of_the_table_are_rejected():
    """Floorboard was measured from 50 GHz on: no guess at 28 GHz; range and alternatives are named."""
    with pytest.raises(ValueError, match=r"28 GHz.*50 to 100.*wood"):
        permittivity("floorboard", CARRIER_HZ)
    with pytest.raises(ValueError, match="none"):
        permittivity("concrete", 1e12)


def test_unknown_material_gets_a_suggestion():
    """A near miss is named; Sionna's names with itu_ in front are known too."""
    with pytest.raises(ValueError, match=r"wall_material is 'plasterbord'.*Did you mean 'plasterboard'"):
        check_material("plasterbord", "wall_material")
    with pytest.raises(ValueError, match="Did you mean 'concrete'"):
        permittivity("itu_concrete", CARRIER_HZ)


def test_roughness_is_bounded():
    """A coefficient beyond 1 would scatter more than falls on a wall."""
    board = (Layer(thickness_m=0.01, material="wood"),)
    assert Material("rough", board, 0.3, 4).scattering == 0.3
    for scattering, lobe in ((1.1, None), (-0.1, None), (float("nan"), None), (0.2, -1), (0.2, 5000)):
        with pytest.raises(ValueError, match=r"scattering of 'rough'|lobe of 'rough'"):
            Material("rough", board, scattering, lobe)
