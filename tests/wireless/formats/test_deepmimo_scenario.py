"""Scenarios for DeepMIMO: what a reader of the published format gets, and what the package itself does.

The package is not among the test requirements, since it needs a NumPy older than the newest; the test that
needs it is skipped where it is missing (`pip install deepmimo`).
"""

import io
import json

import numpy as np
import pytest

from wireless import Array, Channel, Interaction, MountedArray, Tracer, TracerConfig, element_named
from wireless.em.materials import Layer, Material
from wireless.formats.deepmimo_scenario import scenario_name, scene_files, transmitter_files

TX = np.array([[1.0, 1.4, 1.5], [4.0, 3.1, 1.2]])
RX = np.array([[5.0, 0.9, 1.5], [1.5, 3.2, 2.0], [2.6, 1.3, 1.5], [5.5, 3.5, 1.5]])  # the third is sealed off
CONFIG = TracerConfig(diffraction_reflections=2)


@pytest.fixture(scope="module")
def mesh(extruded, ring):
    outline = ring((0, 0), (6, 0), (6, 4), (0, 4))
    return extruded(np.concatenate([outline, ring((2, 1), (3, 1), (3, 2), (2, 2))]))


@pytest.fixture(scope="module")
def paths(mesh):
    return Tracer(mesh, config=CONFIG).trace(TX, RX)


@pytest.fixture(scope="module")
def scenarios(mesh, paths, tmp_path_factory):
    """Folder of scenarios, with one in it."""
    folder = tmp_path_factory.mktemp("run") / "deepmimo_scenarios"
    (folder / "box").mkdir(parents=True)
    files = scene_files(
        mesh=mesh,
        materials=("metal", "drywall"),
        face_material=np.arange(len(mesh.faces)) % 2,
        frequency_hz=28e9,
        config=CONFIG,
        n_tx=2,
        n_rx=4,
        n_rx_active=3,
    )
    for i in range(2):
        files |= transmitter_files(paths, i)
    for name, content in files.items():
        (folder / "box" / name).write_bytes(content)
    return folder


def matrix(scenarios, name, tx):
    with np.load(scenarios / "box" / f"{name}_t000_tx{tx:03}_r001.npz") as file:
        return file[name]


def test_matrices_have_the_published_shapes_and_units(scenarios, paths):
    """Receiver by path (by interaction, by axis), NaN beyond the last path; decibels, degrees from the zenith."""
    for tx in range(2):
        found = paths.count()[tx]
        assert found[2] == 0
        here = np.arange(found.max()) < found[:, None]
        for name in ("power", "phase", "delay", "aoa_az", "aoa_el", "aod_az", "aod_el", "inter"):
            values = matrix(scenarios, name, tx)
            assert values.shape == (4, found.max())
            assert (np.isfinite(values) == here).all()
        mine = paths.select(paths.tx == tx)
        level = np.degrees(mine.aoa_el[0])
        assert matrix(scenarios, "aoa_el", tx)[0, 0] == pytest.approx(90 - level, abs=1e-4)
        assert matrix(scenarios, "inter_pos", tx).shape == (4, found.max(), 3, 3)
        assert matrix(scenarios, "rx_pos", tx) == pytest.approx(RX)
        assert matrix(scenarios, "tx_pos", tx) == pytest.approx(TX[tx : tx + 1])


def test_channels_made_from_the_matrices_are_the_sum_of_gains(scenarios, paths):
    """sqrt(power) e^(j phase), summed over the paths of a link: within the rounding of float32, 2e-6 of it."""
    for tx in range(2):
        power, phase = matrix(scenarios, "power", tx), matrix(scenarios, "phase", tx)
        channel = np.nansum(10 ** (power / 20) * np.exp(1j * np.radians(phase)), axis=1)
        mine = paths.select(paths.tx == tx)
        exact = np.zeros(4, complex)
        np.add.at(exact, mine.rx, mine.gain[:, 0, 0])
        assert np.abs(channel - exact).max() < 2e-6 * np.abs(mine.gain).max()


def test_interactions_are_digits_in_the_order_of_the_path(scenarios, paths):
    """0 for line of sight; else digit i is the kind at position i, from the transmitter on."""
    inter, at = matrix(scenarios, "inter", 0), matrix(scenarios, "inter_pos", 0)
    kinds = set()
    for path in range(len(paths.select(paths.tx == 0))):
        rx, rank = paths.rx[path], paths.rank[path]
        digits = [int(digit) for digit in f"{inter[rx, rank]:.0f}"]
        order = paths.order[path]
        assert digits == (list(paths.interaction[path, :order]) or [0])
        assert at[rx, rank, :order] == pytest.approx(paths.point[path, :order], abs=1e-5)
        assert np.isnan(at[rx, rank, order:]).all()
        kinds |= set(digits)
    assert kinds == {Interaction.NONE, Interaction.REFLECTION, Interaction.DIFFRACTION}


def test_parameters_name_both_sets_and_each_material(scenarios, mesh):
    params = json.loads((scenarios / "box" / "params.json").read_text())
    assert params["rt_params"]["frequency"] == 28e9
    assert params["rt_params"]["max_path_depth"] == 3  # three reflections; no wall is passed at 28 GHz
    sets = params["txrx_sets"]
    assert [
        (s["id"], s["is_tx"], s["is_rx"], s["num_points"], s["num_active_points"]) for s in sets.values()
    ] == [
        (0, True, False, 2, 2),
        (1, False, True, 4, 3),
    ]
    assert [m["name"] for m in params["materials"].values()] == ["metal", "drywall"]
    assert params["materials"]["material_1"]["permittivity"] == pytest.approx(2.94)
    with (
        np.load(scenarios / "box" / "faces.npz") as faces,
        np.load(scenarios / "box" / "vertices.npz") as points,
    ):
        assert sorted(faces) == ["0", "1"]
        assert points["vertices"][faces["1"]] == pytest.approx(mesh.triangles[1::2], abs=1e-6)


@pytest.mark.parametrize(
    ("config", "events", "expected"),
    [
        (TracerConfig(), 0, [("none", 0.0), ("none", 0.0)]),
        (TracerConfig(scattering=0.4), 1, [("directive", 0.4), ("directive", 0.1)]),
        (TracerConfig(scattering=0.4, scattering_lobe=None), 1, [("lambertian", 0.4), ("directive", 0.1)]),
    ],
)
def test_scene_files_state_what_the_tracer_scatters(mesh, config, events, expected):
    """Coefficients of materials count more than that of the tracer; without one, nothing scatters."""
    rough = Material("rough", (Layer(thickness_m=0.1, material="brick"),), scattering=0.1, lobe=7)
    files = scene_files(
        mesh=mesh,
        materials=("metal", rough),
        face_material=np.arange(len(mesh.faces)) % 2,
        frequency_hz=28e9,
        config=config,
        n_tx=1,
        n_rx=1,
        n_rx_active=1,
    )
    params = json.loads(files["params.json"])
    assert params["rt_params"]["max_scattering"] == events
    written = list(params["materials"].values())
    assert [(each["scattering_model"], each["scattering_coefficient"]) for each in written] == expected
    assert (written[1]["alpha_r"], written[1]["lambda_param"]) == (7, 1.0)


def test_links_without_any_path_leave_one_empty_column(paths, tmp_path):
    """Readers index the first path of each receiver: there is a column for it even if it is empty."""
    files = transmitter_files(paths.select(np.zeros(len(paths), bool)), 0)
    with np.load(io.BytesIO(files["power_t000_tx000_r001.npz"])) as file:
        assert file["power"].shape == (4, 1)
        assert np.isnan(file["power"]).all()


@pytest.mark.parametrize(
    ("name", "expected"), [("Colebrook", "colebrook"), ("My Plan: 2", "my_plan_2"), ("…", "scenario")]
)
def test_names_are_such_as_the_package_takes(name, expected):
    """It looks for folders in lower case, and rejects slashes, colons, quotes and the like."""
    assert scenario_name(name) == expected


def test_the_package_itself_reads_what_was_traced(scenarios, paths, mesh, monkeypatch):
    """`deepmimo.load`: the same powers, angles, lengths and sight of each link, and the building of the same size."""
    deepmimo = pytest.importorskip("deepmimo", reason="needs the deepmimo package, which is not installed")
    monkeypatch.chdir(scenarios.parent)
    loaded = deepmimo.load("box")
    for tx in range(2):
        one, mine = loaded[tx], paths.select(paths.tx == tx)
        assert one.tx_pos == pytest.approx(TX[tx : tx + 1])
        assert (one.num_paths == paths.count()[tx]).all()
        assert one.power[mine.rx, mine.rank] == pytest.approx(mine.power_db, abs=1e-4)
        assert one.delay[mine.rx, mine.rank] == pytest.approx(mine.delay_s, rel=1e-6)
        assert one.aod_az[mine.rx, mine.rank] == pytest.approx(np.degrees(mine.aod_az), abs=1e-4)
        assert (one.num_interactions[mine.rx, mine.rank] == mine.order).all()
        state = paths.link_state()[tx]
        assert (one.los == np.where(state == 0, -1, state == 1)).all()
    box = loaded.scene.bounding_box
    assert [[box.x_min, box.y_min, box.z_min], [box.x_max, box.y_max, box.z_max]] == pytest.approx(
        mesh.bounds
    )
    assert [material.name for material in loaded.materials] == ["metal", "drywall"]


def test_the_package_itself_computes_the_same_channels(scenarios, paths, monkeypatch):
    """`compute_channels` of a turned array of 4 x 2: our frequency response over sqrt(N); bound 1e-5 by its 32 bits."""
    deepmimo = pytest.importorskip("deepmimo", reason="needs the deepmimo package, which is not installed")
    monkeypatch.chdir(scenarios.parent)
    parameters = deepmimo.ChannelParameters(
        bs_antenna={"shape": [4, 2], "spacing": 0.5, "rotation": [0, 0, 30]},
        ue_antenna={"shape": [1, 1]},
        ofdm={"subcarriers": 64, "selected_subcarriers": np.arange(64), "bandwidth": 20e6},
    )
    theirs = deepmimo.load("box")[0].compute_channels(parameters)[:, 0]
    z, y = np.indices((2, 4)).reshape(2, 8)
    array = Array(element=element_named("isotropic"), position_wl=np.column_stack([0 * y, y / 2, z / 2]))
    channel = Channel.from_paths(paths, tx=MountedArray(array=array, yaw_rad=np.radians(30)))
    ours = channel.cfr(np.arange(64) * 20e6 / 64)[0, :, 0] / 8
    np.testing.assert_allclose(theirs, ours, atol=1e-5 * np.abs(ours).max())
