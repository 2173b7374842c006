"""Walls of layers that differ: against matrices written for the tests, against closed forms, and in the tracer."""

import numpy as np
import pytest
import trimesh

from tests.wireless.em.plane_waves import cavity_wall, slab
from tests.wireless.em.test_fresnel import CARRIER_HZ, transfer_matrices
from wireless.em.fresnel import fresnel
from wireless.em.materials import WALLS, Layer, Material, permittivity, wall_row
from wireless.tracing.tracer import Tracer, TracerConfig

WAVENUMBER = 2 * np.pi * CARRIER_HZ / 299792458.0
BOARD = Layer(thickness_m=0.013, material="plasterboard")
WOOL = Layer(thickness_m=0.06, relative_permittivity=1.2, conductivity_spm=0.01)
THREE = Material("insulated", (BOARD, WOOL, BOARD))
FIVE = Material("thick", (BOARD, WOOL, Layer(thickness_m=0.1, material="concrete"), WOOL, BOARD))


@pytest.mark.parametrize("material", [THREE, FIVE], ids=str)
def test_layers_equal_transfer_matrices(material):
    """TE and TM, 0 to 88 degrees: reflected and transmitted fields to 1e-10 (measured 2e-14)."""
    wall = wall_row(material, CARRIER_HZ)
    layers = list(zip(wall[::2], wall[1::2].real, strict=True))
    total_m = sum(thickness_m for _, thickness_m in layers)
    for angle in np.radians(np.linspace(0, 88, 40)):
        r_te, r_tm, t_te, t_tm = fresnel(np.cos(angle), wall, WAVENUMBER)
        # Ours is over the field that would be there without the wall.
        free = np.exp(-1j * WAVENUMBER * total_m * np.cos(angle))
        for polarisation, r, t in (("te", r_te, t_te * free), ("tm", r_tm, t_tm * free)):
            want = transfer_matrices(angle, layers, CARRIER_HZ, polarisation)
            assert abs(r - want[0]) < 1e-10
            assert abs(t - want[1]) < 1e-10


@pytest.mark.parametrize("name", WALLS)
def test_walls_by_name_equal_transfer_matrices(name):
    """Each shipped wall, TE and TM, 0 to 85 degrees, 28 and 60 GHz: reflected and transmitted power to 1e-10."""
    for frequency_hz in (28e9, 60e9):
        wall = wall_row(name, frequency_hz)
        layers = list(zip(wall[::2], wall[1::2].real, strict=True))
        wavenumber = 2 * np.pi * frequency_hz / 299792458.0
        for angle in np.radians(np.linspace(0, 85, 18)):
            r_te, r_tm, t_te, t_tm = fresnel(np.cos(angle), wall, wavenumber)
            for polarisation, r, t in (("te", r_te, t_te), ("tm", r_tm, t_tm)):
                want = transfer_matrices(angle, layers, frequency_hz, polarisation)
                assert abs(abs(r) - abs(want[0])) < 1e-10
                assert abs(abs(t) - abs(want[1])) < 1e-10


def test_the_published_wall_is_two_boards_with_air_between():
    """13 mm of relative permittivity 2.94, 89 mm of air, 13 mm: as mmwRobotNav says of its walls."""
    wall = wall_row("partition", CARRIER_HZ)
    assert wall[1::2].real.tolist() == [0.013, 0.089, 0.013]
    assert wall[0].real == wall[4].real == 2.94 and wall[2] == 1
    assert np.array_equal(wall, wall_row("drywall", CARRIER_HZ, 0.013, 0.089))


def test_layers_without_loss_keep_all_energy():
    """|r|^2 + |t|^2 = 1 to rounding, for two polarisations."""
    outer, inner = (Layer(thickness_m=d, relative_permittivity=e) for d, e in ((0.004, 6.3), (0.012, 1.5)))
    wall = wall_row(Material("glazing", (outer, inner, outer)), CARRIER_HZ)
    for cos_i in np.linspace(0.02, 1, 50):
        r_te, r_tm, t_te, t_tm = fresnel(cos_i, wall, WAVENUMBER)
        assert abs(r_te) ** 2 + abs(t_te) ** 2 == pytest.approx(1, abs=1e-12)
        assert abs(r_tm) ** 2 + abs(t_tm) ** 2 == pytest.approx(1, abs=1e-12)


def test_grazing_reflects_all():
    """Both ratios go to -1, and nothing gets in."""
    assert fresnel(0.0, wall_row(THREE, CARRIER_HZ), WAVENUMBER) == pytest.approx((-1, -1, 0, 0), abs=1e-9)


@pytest.mark.parametrize(
    ("layers", "config"),
    [
        ((BOARD,), TracerConfig(wall_thickness_m=0.013, max_transmissions=1)),
        (
            (BOARD, Layer(thickness_m=0.089, relative_permittivity=1.0), BOARD),
            TracerConfig(wall_thickness_m=0.013, wall_gap_m=0.089, max_transmissions=1),
        ),
    ],
    ids=["one layer", "two boards with air between"],
)
def test_what_a_setting_says_layers_say_too(layers, config):
    """Bit-identical paths as with the same wall by name and thickness."""
    mesh = trimesh.creation.box((6.0, 4.0, 2.5))
    tx, rx = np.array([[-2.0, 0.5, 0.2]]), np.array([[1.5, -1.0, 0.1], [9.0, 0.0, 0.3]])
    by_name = Tracer(mesh, materials=("plasterboard",), config=config).trace(tx, rx)
    by_layers = Tracer(mesh, materials=(Material("wall", layers),), config=config).trace(tx, rx)
    np.testing.assert_array_equal(by_layers.power_db, by_name.power_db)
    np.testing.assert_array_equal(by_layers.delay_s, by_name.delay_s)


def test_a_wall_of_three_layers_is_passed_as_its_matrices_say():
    """A path straight through: its gain over that in the open is T, both methods of tracing, to 1e-9 dB."""
    wall = trimesh.Trimesh(
        [[0, -20, -20], [0, 20, -20], [0, 20, 20], [0, -20, 20]], [[0, 1, 2], [0, 2, 3]], process=False
    )
    tx, rx = np.array([[-1.0, 0.0, 0.0]]), np.array([[2.0, 0.5, 0.0]])
    config = TracerConfig(scene="space", max_transmissions=1, wall_thickness_m=0.1, diffraction=False)
    found = Tracer(wall, materials=(THREE,), config=config).trace(tx, rx)
    row = wall_row(THREE, CARRIER_HZ)
    layers = list(zip(row[::2], row[1::2].real, strict=True))
    _, t = transfer_matrices(np.arctan2(0.5, 3.0), layers, CARRIER_HZ, "te")
    # Vertical polarisation lies along the wall: TE.
    open_db = 20 * np.log10(1 / (2 * WAVENUMBER * np.hypot(3.0, 0.5)))
    assert found.power_db[0] - open_db == pytest.approx(20 * np.log10(abs(t)), abs=1e-6)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Material("odd", (BOARD, WOOL)), "differ from its two sides"),
        (lambda: Material("none", ()), "layers of 'none' are 0"),
        (lambda: Layer(thickness_m=0.0, material="wood"), "thickness_m is 0.0"),
        (lambda: Layer(thickness_m=0.1), "expected one of them"),
        (lambda: Layer(thickness_m=0.1, material="wod"), "Did you mean 'wood'"),
        (lambda: Layer(thickness_m=0.1, relative_permittivity=0.5), "relative_permittivity is 0.5"),
    ],
)
def test_walls_that_cannot_be_are_rejected(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_closed_forms_are_what_single_layers_and_cavities_give():
    """`slab` and `cavity_wall`, at 30 degrees, from the compiled ratios."""
    eps, cos_i = permittivity("plasterboard", CARRIER_HZ), np.array([np.cos(np.pi / 6)])
    for got, want in (
        (
            fresnel(cos_i[0], wall_row("plasterboard", CARRIER_HZ, 0.013), WAVENUMBER),
            slab(cos_i, eps, 0.013, CARRIER_HZ),
        ),
        (
            fresnel(cos_i[0], wall_row("plasterboard", CARRIER_HZ, 0.013, 0.089), WAVENUMBER),
            cavity_wall(cos_i, eps, 0.013, 0.089, CARRIER_HZ),
        ),
    ):
        assert np.abs(np.array(got[:2]) - [want[0][0], want[1][0]]).max() < 1e-12
