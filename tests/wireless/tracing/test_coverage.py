"""Coverage maps of meshes: closed forms, cells by what they are, limits."""

import numpy as np
import pytest
import trimesh

from wireless import CellState, CoverageMap, LinkState, MountedArray, Tracer, TracerConfig, uniform_array
from wireless.em.materials import permittivity

FREQUENCY_HZ, C = 28e9, 299792458.0
PLAIN = TracerConfig(max_reflections=1, diffraction=False)
DARK = TracerConfig(max_reflections=0, diffraction=False)


def ground(half_m: float = 20.0) -> trimesh.Trimesh:
    corner = half_m * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return trimesh.Trimesh(corner, [[0, 1, 2], [0, 2, 3]], process=False)


def with_house(bottom: bool = True) -> trimesh.Trimesh:
    """A house of 4 x 4 x 6 m on level ground, with or without a bottom."""
    house = trimesh.creation.box((4.0, 4.0, 6.0))
    house.apply_translation((6.0, 0.0, 3.0))
    if not bottom:
        house.update_faces(house.face_normals[:, 2] > -0.5)
    return trimesh.util.concatenate([ground(), house])


@pytest.fixture(scope="module")
def open_ground() -> Tracer:
    return Tracer(ground(), materials=("concrete",), frequency_hz=FREQUENCY_HZ, config=PLAIN)


@pytest.fixture(scope="module")
def shaded() -> CoverageMap:
    """Two transmitters on either side of a house, without reflections."""
    tracer = Tracer(with_house(), materials=("concrete",), frequency_hz=FREQUENCY_HZ, config=DARK)
    return tracer.coverage([[0.0, 0.0, 3.0], [12.0, 0.0, 3.0]], cell_m=1.0, tx_power_dbm=(23.0, 20.0))


def two_rays(
    distance_m: np.ndarray, heights_m: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fields between vertical antennas over a concrete half-space, and lengths, of the direct and the reflected ray.

    Isotropic antennas send along theta: along the ray's own vertical plane, in which TM reflection acts.
    """
    k, up, low = 2 * np.pi * FREQUENCY_HZ / C, sum(heights_m), heights_m[0] - heights_m[1]
    direct, reflected = np.hypot(distance_m, low), np.hypot(distance_m, up)
    sine = up / reflected
    eps = permittivity("concrete", FREQUENCY_HZ)
    root = np.sqrt(eps - (1 - sine**2))
    tm = (eps * sine - root) / (eps * sine + root)
    spread = C / (4 * np.pi * FREQUENCY_HZ)
    line_of_sight = spread / direct * np.exp(-1j * k * direct)
    other = tm * spread / reflected * np.exp(-1j * k * reflected)
    return line_of_sight, other, direct, reflected


@pytest.mark.parametrize("coherent", [False, True])
def test_coverage_of_level_ground_is_the_two_ray_model(open_ground, coherent):
    """Gain, first delay and delay spread at each of 1600 cells: within 1e-9 of the closed form."""
    coverage = open_ground.coverage([[0.3, 0.2, 5.0]], cell_m=1.0, height_m=1.5, coherent=coherent)
    assert coverage.gain.shape == (1, 40, 40) and (coverage.state == CellState.REACHED).all()
    assert (coverage.position[..., 2] == 1.5).all()
    assert coverage.position[0, 39, :2].tolist() == [19.5, -19.5]
    distance = np.linalg.norm(coverage.position[..., :2] - [0.3, 0.2], axis=-1)
    line_of_sight, other, direct, reflected = two_rays(distance, (5.0, 1.5))
    power = np.abs(np.stack([line_of_sight, other])) ** 2
    expected = np.abs(line_of_sight + other) ** 2 if coherent else power.sum(axis=0)
    assert coverage.gain[0] == pytest.approx(expected, rel=1e-6 if coherent else 1e-9)
    assert coverage.power_dbm[0] == pytest.approx(23 + 10 * np.log10(expected), abs=1e-5)
    assert coverage.delay_s[0] == pytest.approx(direct / C, rel=1e-12)
    share = power / power.sum(axis=0)
    mean = (share * [direct, reflected]).sum(axis=0)
    spread = np.sqrt((share * (np.stack([direct, reflected]) - mean) ** 2).sum(axis=0)) / C
    assert coverage.delay_spread_s[0] == pytest.approx(spread, rel=1e-6)
    assert (coverage.category == LinkState.LOS).all()


def test_coverage_sinr_is_that_of_its_powers(shaded):
    """By hand from the powers in milliwatts; the noise of 400 MHz and 6 dB is -81.98 dBm."""
    assert shaded.noise_dbm == pytest.approx(-174 + 10 * np.log10(400e6) + 6)
    power = np.nan_to_num(10 ** (shaded.power_dbm / 10))
    noise = 10 ** (shaded.noise_dbm / 10)
    both = (power > 0).all(axis=0)
    assert 100 < both.sum() < both.size
    for i in range(2):
        sinr = 10 * np.log10(power[i][both] / (noise + power[1 - i][both]))
        assert shaded.sinr_db[i][both] == pytest.approx(sinr, abs=1e-9)
        alone = (power[i] > 0) & (power[1 - i] == 0)
        assert shaded.sinr_db[i][alone] == pytest.approx(shaded.snr_db[i][alone], abs=1e-9)
    is_unserved = (power == 0).all(axis=0)
    assert is_unserved.any() and (shaded.best_server[is_unserved] == -1).all()
    assert (shaded.best_server[~is_unserved] == power.argmax(axis=0)[~is_unserved]).all()
    assert np.isnan(shaded.best("sinr_db")[is_unserved]).all()
    free_space = 23 - 20 * np.log10(4 * np.pi * np.linalg.norm([5.5, 0.5, 1.5]) * FREQUENCY_HZ / C)
    assert shaded.power_dbm[0, 20, 14] == pytest.approx(free_space, abs=1e-9)  # at (-5.5, 0.5), 1.5 m lower


def test_coverage_separates_shadows_and_the_inside_of_bodies(shaded):
    """Behind the house nothing arrives, in it neither; all else is reached, by Friis."""
    x, y = np.moveaxis(shaded.position[..., :2], 2, 0)
    is_house = (abs(x - 6) < 2) & (abs(y) < 2)
    assert is_house.sum() == 16 and (shaded.state[:, is_house] == CellState.IN_BODY).all()
    is_shadow = (x > 8) & (abs(y) < x / 2)  # the house's front edges, at x = 4, are at y = -2 and 2
    assert is_shadow.sum() > 50 and (shaded.state[0, is_shadow] == CellState.NO_PATH).all()
    assert (shaded.state[0, ~is_shadow & ~is_house & (x < 4)] == CellState.REACHED).all()
    assert (shaded.power_dbm[0, is_shadow] == -np.inf).all() and np.isnan(shaded.gain[0, is_house]).all()
    assert np.isnan(shaded.delay_s[0, is_shadow]).all()


def test_coverage_of_houses_without_a_bottom_and_of_rooms():
    """A house that stands on the ground without a bottom is a body; around a room in which it is sent is outside."""
    tracer = Tracer(with_house(bottom=False), materials=("concrete",), config=DARK)
    state = tracer.coverage([[0.0, 0.0, 3.0]], cell_m=1.0).state[0]
    assert (state[18:22, 24:28] == CellState.IN_BODY).all() and (state == CellState.IN_BODY).sum() == 16
    room = trimesh.creation.box((8.0, 6.0, 3.0))
    table = trimesh.creation.box((1.0, 1.0, 2.0))
    table.apply_translation((2.5, 0.5, 0.0))
    tracer = Tracer(trimesh.util.concatenate([room, table]), materials=("concrete",), config=DARK)
    coverage = tracer.coverage([[-1.0, 0.3, 1.0]], cell_m=1.0, bounds_m=(-6.0, -3.0, 6.0, 3.0))
    assert (coverage.state[0, :, [0, 1, 10, 11]] == CellState.OUTSIDE).all()
    assert coverage.state[0, 3, 8] == CellState.IN_BODY
    assert coverage.state[0, 3, 9] == CellState.NO_PATH
    assert (coverage.state[0, :, 2:8] == CellState.REACHED).all()


def test_coverage_of_cells_is_the_mean_of_their_points(open_ground):
    """Four points a cell, as the map of half the side has them; the middle of a cell has another value."""
    options = {"tx": [[0.3, 0.2, 5.0]], "bounds_m": (-2.0, -2.0, 3.0, 2.0)}
    fine = open_ground.coverage(cell_m=0.5, **options)
    mean = open_ground.coverage(cell_m=1.0, points_per_side=2, **options)
    assert (fine.points_per_cell, mean.points_per_cell, mean.gain.shape) == (1, 4, (1, 4, 5))

    def blocks(values):
        return values[0].reshape(4, 2, 5, 2)

    assert mean.gain[0] == pytest.approx(blocks(fine.gain).mean(axis=(1, 3)), rel=1e-9)
    assert mean.delay_s[0] == pytest.approx(blocks(fine.delay_s).min(axis=(1, 3)))
    weighted = blocks(fine.gain * fine.delay_spread_s).sum(axis=(1, 3)) / blocks(fine.gain).sum(axis=(1, 3))
    assert mean.delay_spread_s[0] == pytest.approx(weighted, rel=1e-9)
    assert mean.position[0, 0].tolist() == [-1.5, -1.5, 1.5] and mean.edges[4, 5].tolist() == [3.0, 2.0]
    middle = open_ground.coverage(cell_m=1.0, **options)
    assert abs(mean.gain[0] / middle.gain[0] - 1).max() > 1e-3


def test_coverage_has_the_gain_of_antennas(open_ground):
    """A 3GPP element that faces the receiver: 8 dBi, and 30 dB less behind; ports of an array share the power."""
    tx = [[0.0, 0.0, 1.5]]
    options = {"cell_m": 1.0, "bounds_m": (9.0, -0.5, 10.0, 0.5), "height_m": 1.5}
    tracer = Tracer(ground(), materials=("concrete",), config=DARK)
    isotropic = tracer.coverage(tx, **options).gain
    element = uniform_array(1, element="3gpp")
    for yaw, gain_db in ((0.0, 8.0), (np.pi, -22.0)):
        gain = tracer.coverage(tx, tx_antenna=MountedArray(array=element, yaw_rad=yaw), **options).gain
        assert 10 * np.log10(gain / isotropic) == pytest.approx(gain_db, abs=1e-3)
    array = MountedArray(array=uniform_array(4, 2, element="isotropic"))
    assert tracer.coverage(tx, tx_antenna=array, **options).gain == pytest.approx(isotropic)
    assert tracer.coverage(tx, rx_antenna=array, **options).gain == pytest.approx(8 * isotropic)


def test_coverage_in_batches_turns_each_receiver_by_its_angle(open_ground, monkeypatch):
    """Batches of two cells, sectors of receivers turned at random: the gains of a single batch."""
    cells = {"cell_m": 10.0, "height_m": 1.5}
    yaw_rad = np.random.default_rng(0).uniform(-np.pi, np.pi, 16)
    turned = MountedArray(array=uniform_array(1, element="3gpp"), yaw_rad=yaw_rad)
    single = open_ground.coverage([[0.0, 0.0, 3.0]], rx_antenna=turned, **cells)
    for module in ("wireless.coverage", "wireless.tracing.coverage"):
        with monkeypatch.context() as patch:
            patch.setattr(f"{module}._BATCH_LINKS", 2)
            batches = open_ground.coverage([[0.0, 0.0, 3.0]], rx_antenna=turned, **cells)
        np.testing.assert_array_equal(batches.gain, single.gain)


def test_coverage_table_has_a_row_per_transmitter_and_cell(shaded):
    """Rows in the order of the arrays; the noise is in the metadata."""
    table = shaded.to_table()
    assert table.num_rows == shaded.gain.size
    np.testing.assert_array_equal(table["sinr_db"].to_numpy(), shaded.sinr_db.ravel())
    np.testing.assert_array_equal(table["x_m"].to_numpy()[:40], np.arange(40) - 19.5)
    best = table["is_best_server"].to_numpy().reshape(shaded.gain.shape)
    assert (best.argmax(axis=0) == shaded.best_server)[shaded.best_server >= 0].all()
    assert float(table.schema.metadata[b"noise_dbm"]) == shaded.noise_dbm


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"cell_m": 0.001},
            "1600000000 receivers on 40 x 40 m, more than 1000000 places. Take wider cells, such as",
        ),
        ({"cell_m": float("nan")}, "grid is nan, expected"),
        ({"cell_m": -1.0}, "grid is -1.0, expected"),
        (
            {"bounds_m": (30.0, 30.0, 40.0, 40.0)},
            r"which reaches from \[-20.0, -20.0\] to \[20.0, 20.0\]",
        ),
        ({"bounds_m": (3.0, 3.0, 2.0, 4.0)}, "expected the lower-left and the upper-right corner"),
        ({"bounds_m": (3.0, float("nan"), 4.0, 4.0)}, "expected the lower-left and the upper-right corner"),
        ({"bounds_m": (3.0, 4.0, 5.0)}, "expected the lower-left and the upper-right corner"),
        ({"points_per_side": 0}, "points_per_side is 0"),
        (
            {"points_per_side": 100, "cell_m": 0.1},
            "points_per_side is 100, which makes 1600000000 points in 160000 cells",
        ),
        ({"tx": [0.0, 0.0, 5.0]}, r"tx has shape \(3,\), expected"),
        ({"tx": [[0.0, 0.0, float("nan")]]}, r"tx has shape \(1, 3\), expected .* finite"),
        ({"tx_power_dbm": (1.0, 2.0)}, "or one for each transmitter"),
        ({"bandwidth_mhz": 0.0}, "bandwidth_mhz is 0.0"),
    ],
)
def test_coverage_rejects_maps_that_cannot_be(options, message, open_ground):
    with pytest.raises(ValueError, match=message):
        open_ground.coverage(**{"tx": [[0.0, 0.0, 5.0]], **options})


def test_coverage_plots_quantities_of_a_transmitter_and_of_the_best_server(shaded):
    """Cells without a path are empty; the number of the best server counts from 1, as in names of files.

    Times are in nanoseconds, and labels name the unit.
    """
    for quantity, tx, expected, label in (
        ("power_dbm", 0, shaded.power_dbm[0], "received power [dBm]"),
        ("sinr_db", None, shaded.best("sinr_db"), "SINR [dB]"),
        ("best_server", None, shaded.best_server + 1.0, "best server"),
        ("delay_spread_s", None, 1e9 * shaded.best("delay_spread_s"), "delay spread [ns]"),
    ):
        axes = shaded.plot(quantity, tx)
        assert axes.figure.axes[-1].get_ylabel() == label
        shown = np.ma.filled(axes.collections[0].get_array(), np.nan)
        reached = shaded.state[0] == 3 if tx == 0 else shaded.best_server >= 0
        np.testing.assert_array_equal(np.isfinite(shown), reached)
        np.testing.assert_allclose(shown[reached], expected[reached])
        axes.figure.clf()


@pytest.mark.parametrize("polarisation", ["vertical", "horizontal", "both"])
def test_coverage_has_the_polarisation_of_the_tracer(polarisation):
    """Gains are sums of the powers that the tracer gives its paths."""
    config = TracerConfig(max_reflections=1, diffraction=False, polarisation=polarisation)
    tracer = Tracer(with_house(), materials=("concrete",), config=config)
    coverage = tracer.coverage([[0.0, 1.0, 4.0]], cell_m=4.0)
    paths = tracer.trace([[0.0, 1.0, 4.0]], coverage.position.reshape(-1, 3))
    power = np.bincount(paths.rx, paths.power, len(paths.rx_position)).reshape(10, 10)
    reached = coverage.state[0] == CellState.REACHED
    assert reached.sum() > 50 and coverage.gain[0][reached] == pytest.approx(power[reached], rel=1e-9)
    assert not power[~reached].any()
