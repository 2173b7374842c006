"""`robosim trace`: its files, going on, and how it fails."""

import csv
import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest

from robosim.cli import main
from robosim.plans.files import write_ros
from robosim.radio.scene import RadioConfig, RadioScene, radio_site
from robosim.support.tum import write_tum
from tests.plans import two_rooms
from wireless import LinkState, Paths

PICTURES = {"power", "state", "aoa", "rays", "overview"}


@pytest.fixture(scope="module")
def traced(plan_file, tmp_path_factory):
    """A folder that two transmitters were traced into."""
    out = tmp_path_factory.mktemp("traced")
    main(f"trace {plan_file} --tx 0.7,1.5 --tx 5.5,2.5,2.0 --grid 0.4 --out {out}".split())
    return out


def test_all_formats_hold_the_same_links(traced):
    """Parquet, CSV, DeepMIMO and JSON agree on receivers, paths and states."""
    paths = Paths.read_parquet(traced / "paths.parquet")
    assert paths.tx_position.tolist() == [[0.7, 1.5, 1.5], [5.5, 2.5, 2.0]]
    n_rx = len(paths.rx_position)
    result = json.loads((traced / "trace.json").read_text())
    assert result["links"] == 2 * n_rx
    counted = np.bincount(paths.link_state().ravel(), minlength=4)
    assert [result["states"][one.name.lower()] for one in LinkState] == counted.tolist()
    for tx in range(2):
        with open(traced / f"two rooms_Tx_{tx + 1}.csv") as file:
            rows = list(csv.DictReader(file))
        assert [int(row["npaths"]) for row in rows] == paths.count()[tx].tolist()
        assert [int(row["link_state"]) for row in rows] == paths.link_state()[tx].tolist()
        with np.load(traced / f"deepmimo_scenarios/two_rooms/power_t000_tx{tx:03}_r001.npz") as file:
            assert np.isfinite(file["power"]).sum(axis=1).tolist() == paths.count()[tx].tolist()
        assert {f"{name}_tx{tx + 1}.png" for name in PICTURES} <= {file.name for file in traced.iterdir()}
    assert (traced / "two rooms_tx_pos.csv").read_text().splitlines() == [
        ",x,y,z",
        "0,0.7,1.5,1.5",
        "1,5.5,2.5,2",
    ]
    left_behind = [p for p in traced.rglob("*") if "partial" in p.name or p.name in ("units", ".lock")]
    assert not left_behind


def test_the_same_command_again_traces_nothing(traced, plan_file, capsys):
    before = (traced / "paths.parquet").read_bytes()
    main(f"trace {plan_file} --tx 0.7,1.5 --tx 5.5,2.5,2.0 --grid 0.4 --no-plots --out {traced}".split())
    assert "0 traced" in capsys.readouterr().out
    assert (traced / "paths.parquet").read_bytes() == before


def test_another_command_does_not_touch_the_folder(traced, plan_file, fails):
    again = ["trace", plan_file, "--tx", "0.7,1.5", "--tx", "5.5,2.5,2.0", "--grid", "0.4", "--out", traced]
    message = fails(*again, "--max-reflections", "1")
    assert "max_reflections 3 there, 1 now" in message
    assert "tolerance_m None there, 0.1 now" in fails(*again, "--tolerance", "0.1")
    assert "which holds the results of `robosim trace`" in fails(
        "trace", plan_file, "--tx", "1,1", "--rx", "2,2", "--out", traced
    )


def test_one_link_with_every_option(plan_file, tmp_path, capsys):
    out = tmp_path / "link"
    main(
        f"trace {plan_file} --tx 1,1 --rx 5,1.2,1.1 --frequency-ghz 60 --max-reflections 2 --no-diffraction "
        f"--diffraction-reflections 0 --floor-ceiling --max-transmissions 1 --wall-thickness 0.013 --wall-gap 0.089 "
        f"--max-paths 9 --polarisation both --material concrete --tolerance 0.05 --height 1.4 --tx-power-dbm 10 "
        f"--threshold-dbm -90 --workers 1 --out {out}".split()
    )
    assert "paths from 1 transmitter" in capsys.readouterr().out
    paths = Paths.read_parquet(out / "paths.parquet")
    assert paths.frequency_hz == 60e9
    assert paths.tx_position.tolist() == [[1, 1, 1.4]]
    assert paths.rx_position.tolist() == [[5, 1.2, 1.1]]
    assert 0 < len(paths) <= 9
    assert set(np.unique(paths.interaction)) <= {0, 1, 4}
    assert (out / "rays_tx1.png").exists()


def test_a_channel_along_a_trajectory(plan_file, tmp_path, capsys, fails):
    """Two seconds at 50 Hz: 101 samples, whose direct path shortens at the robot's speed."""
    poses = np.column_stack([np.linspace(2, 1.5, 5), np.full(5, 1.0), np.zeros(5)])
    write_tum(tmp_path / "trajectory.tum", np.linspace(10, 12, 5), poses)
    command = f"trace {plan_file} --tx 1,1 --along {tmp_path}/trajectory.tum --rate 50 --out {tmp_path}/out"
    main(command.split())
    assert "101 impulse responses from 1 transmitter" in capsys.readouterr().out
    channel = np.load(tmp_path / "out" / "channel_tx1.npz")
    assert channel["gain"].shape[0] == 101 and channel["time_s"][[0, -1]].tolist() == [10, 12]
    np.testing.assert_allclose(channel["doppler_hz"][:, 0], 28e9 * 0.25 / 299792458, rtol=1e-9)
    np.testing.assert_allclose(channel["delay_s"][:, 0] * 299792458, np.linspace(1, 0.5, 101), atol=1e-9)
    for other in (("--rx", "2,2"), ("--csi", "64x1MHz")):
        assert "either a trajectory or places of receivers" in fails(*command.split(), *other)


def test_a_transmitter_in_a_part_of_its_own_is_reported(tmp_path, capsys):
    """Rooms without a door: the one with the transmitter has 9 m2; half of all links are in outage."""
    plan = two_rooms(0.0)
    occupancy = plan.occupancy.copy()
    occupancy[:10, :60] = 1  # the first room is the smaller one
    write_ros(type(plan)(occupancy=occupancy, resolution_m=0.05, name="apart"), tmp_path / "apart.yaml")
    main(f"trace {tmp_path}/apart.yaml --tx 1,2 --grid 0.5 --no-plots --out {tmp_path}/out".split())
    said = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert "tx (1, 2) is in a part of 7.5 m2 without a passage to the largest one, of 9.0 m2" in said
    paths = Paths.read_parquet(tmp_path / "out" / "paths.parquet")
    assert (paths.link_state()[0][paths.rx_position[:, 0] > 3.1] == LinkState.OUTAGE).all()


def test_an_interruption_says_how_to_go_on(plan_file, tmp_path, monkeypatch, capsys):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("robosim.datasets.trace.trace_grid", interrupted)
    with pytest.raises(SystemExit) as stop:
        main(["trace", str(plan_file), "--tx", "1,1", "--out", str(tmp_path / "o")])
    assert stop.value.code == 130
    assert "Resume with the same command" in re.sub(r"\s+", " ", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            "--tx 3.1,0.5",
            "tx is (3.1, 0.5) m, outside of the free space of two rooms; the nearest free point is (3.",
        ),
        ("--tx -1,1", "the nearest free point is (0.01, 1.00) m"),
        ("--tx 1,1 --rx 3.1,0.5", "rx is (3.1, 0.5) m"),
        ("--tx 1,1,2.7", "height of tx (1, 1) is 2.7 m, expected 0 to 2.5 m"),
        ("--tx 1,1 --grid 0", "grid is 0.0, expected 0.01 to 100 m between receivers"),
        ("--tx 1,1 --grid -0.15", "grid is -0.15"),
        ("--tx 1,1 --height 3", "is 3 m, expected 0 to 2.5 m"),
        ("--tx 1,1 --frequency-ghz 28e9", "frequency_hz is 2.8e+19"),
        ("--tx 1,1 --max-reflections -1", "max_reflections is -1"),
        ("--tx 1,1 --max-transmissions 13", "max_transmissions is 13"),
        ("--tx 1,1 --wall-gap 0.089", "Give wall_thickness_m"),
        ("--tx 1,1 --wall-thickness 0.013 --wall-gap -1", "wall_gap_m is -1"),
        ("--tx 1,1 --material concret", "Did you mean 'concrete'"),
        ("--tx 1,1 --tx-power-dbm nan", "tx_power_dbm is nan"),
        ("--tx 1,1 --threshold-dbm nan", "threshold_dbm is nan"),
        ("--tx 1,1 --workers 0", "workers is 0"),
        ("--tx 1,1 --grid 1e-5", "grid is 1e-05, expected 0.01 to 100 m"),
        (
            "--tx 1,1 --grid 0.001",
            "between receivers: it makes 1000000 cells on each square metre. Try 0.15.",
        ),
        ("--tx 1,1 --rx 2,1 --bandwidth-mhz 20", "bandwidth_mhz is given without a grid"),
        ("--tx 1,1 --rx 2,1 --rate 50", "rate is 50, which samples a trajectory"),
        ("--tx 1,1 --along a.tum --threshold-dbm -90", "threshold_dbm is given with along"),
        ("--tx 1,1 --rx 1,1", "rx (1, 1) m is where tx (1, 1, 1.5) m is"),
        ("--tx 2,2 --tx 1,1,1 --rx 1.001,1,1.002", "Move one of them by 5 mm or more"),
        ("--tx 1,1 --tx 2,2 --tx 1,1,1.5", "tx (1, 1, 1.5) m is given twice. Leave one of them out."),
        ("--tx 1", "X,Y[,Z]"),
        (
            "--tx 1,1 --bandwidth-mhz 1e5",
            "bandwidth_mhz is 100000 at a carrier of 28 GHz, expected less than",
        ),
        ("--grid 0.5", "--tx"),
    ],
)
def test_mistakes_end_in_one_sentence(arguments, message, plan_file, tmp_path, fails):
    assert message in fails("trace", plan_file, *arguments.split(), "--out", tmp_path)


@pytest.mark.parametrize("wrong", [(-1.0, 1.0), (3.1, 0.5), (3.1, 2.987), (7.0, 4.0)])
def test_the_free_point_that_is_named_will_do(wrong):
    """Taken from the message, as a person would, to the centimetre."""
    scene = RadioScene(two_rooms(0.8), RadioConfig())
    with pytest.raises(ValueError, match="nearest free point is") as rejected:
        scene.places((wrong,), "tx")
    x, y = re.findall(r"point is \((-?[\d.]+), (-?[\d.]+)\)", str(rejected.value))[0]
    scene.places(((float(x), float(y)),), "tx")


def test_frequency_responses_are_written_and_drawn(plan_file, tmp_path, capsys, fails):
    """One link with both polarisations: the sum over its paths. A grid: all receivers; resumed with another --csi."""
    link, grid = tmp_path / "link", tmp_path / "grid"
    ends = f"{plan_file} --tx 1,1 --rx 5,1.2 --polarisation both --floor-ceiling"
    main(f"trace {ends} --csi 64x312.5kHz --out {link}".split())
    paths = Paths.read_parquet(link / "paths.parquet")
    offset_hz = (np.arange(64) - 32) * 312.5e3
    want = np.einsum(
        "nrt,nf->rtf", paths.gain, np.exp(-2j * np.pi * np.outer(paths.delay_s, offset_hz)), optimize=True
    )
    with np.load(link / "csi_tx1.npz") as file:
        np.testing.assert_array_equal(file["offset_hz"], offset_hz)
        np.testing.assert_allclose(file["response"][0], want, atol=1e-6 * np.abs(want).max())
    assert (link / "csi_tx1.png").exists() and "csi_tx1.npz" in capsys.readouterr().out
    command = f"trace {plan_file} --tx 0.7,1.5 --tx 5.5,2.5 --grid 0.8 --csi 8x1MHz --workers 1 --out {grid}"
    main([*command.split(), "--no-plots"])
    main(command.replace("8x1MHz", "3x20MHz").split())
    paths = Paths.read_parquet(grid / "paths.parquet")
    with np.load(grid / "csi_tx2.npz") as file:
        assert file["response"].shape == (len(paths.rx_position), 1, 1, 3)
        present = np.abs(file["response"]).any(axis=(1, 2, 3))
        assert (present == (paths.count()[1] > 0)).all()
        some = paths.between(1, int(np.argmax(present)))
        want = (some.gain[:, 0, 0] * np.exp(2j * np.pi * 20e6 * some.delay_s)).sum()
        assert file["response"][some.rx[0], 0, 0, 0] == pytest.approx(want, rel=1e-5)
    assert (grid / "csi_tx2.png").exists()
    for text in ("64", "0x1MHz", "64x312.5khz", "64x1GHz", "70000x1Hz", "3x0kHz"):
        assert f"csi is '{text}', expected a number of subcarriers" in fails(*command.split(), "--csi", text)


def test_antennas_of_frequency_responses(plan_file, tmp_path, fails):
    """A 3GPP element that faces the receiver, or turned away: 30 dB; a pattern file with its gain as given, -6 dBi."""
    cut = "\n".join(f"{angle} 3.0" for angle in range(0, 360, 10))
    (tmp_path / "even.msi").write_text(f"GAIN -3 dBi\nHORIZONTAL 36\n{cut}\nVERTICAL 36\n{cut}\n")
    link = f"trace {plan_file} --tx 1,1 --rx 2.5,1 --max-reflections 0 --no-diffraction --csi 1x1MHz"
    gains = {}
    for name in ("isotropic", "3gpp", "3gpp,180", f"{tmp_path}/even.msi,90,10,20"):
        out = tmp_path / f"out{len(gains)}"
        main([*link.split(), "--tx-antenna", name, "--out", str(out)])
        with np.load(out / "csi_tx1.npz") as file:
            gains[name] = 20 * np.log10(np.abs(file["response"][0, 0, 0, 0]))
    isotropic, facing, away, given = gains.values()
    assert facing - away == pytest.approx(30, abs=1e-3)
    assert facing - isotropic == pytest.approx(8, abs=1e-3)
    assert given < isotropic - 6 and given == pytest.approx(
        isotropic - 6, abs=0.6
    )  # turned by 20 degrees: -0.5 dB
    assert "tx_antenna is '3gpp,left', expected an element" in fails(
        *link.split(), "--tx-antenna", "3gpp,left"
    )
    assert "Known: patch, 3gpp" in fails(*link.split(), "--rx-antenna", "dish")
    assert "absent.msi: no such file" in fails(*link.split(), "--rx-antenna", "absent.msi")
    assert "which count with --csi" in fails(*link.split()[:-2], "--rx-antenna", "3gpp")


SCENE = """<scene version="2.1.0">
<bsdf type="itu-radio-material" id="m"><string name="type" value="concrete"/></bsdf>
<shape type="rectangle" id="ground"><transform name="to_world"><scale value="50"/></transform><ref id="m"/></shape>
</scene>"""


@pytest.fixture
def scene_file(tmp_path):
    """Level ground, in a file whose name does not say what it is."""
    (tmp_path / "ground.dat").write_text(SCENE)
    return tmp_path / "ground.dat"


def test_links_in_a_scene(scene_file, tmp_path, capsys):
    """A direct path and one from the mirror image below the ground, to each of two receivers; CSI of both."""
    ends = "--tx -3,0,2 --rx 3,0,2 --rx 3,4,3"
    main(f"trace {scene_file} {ends} --csi 16x1MHz --json --out {tmp_path}/out".split())
    printed = json.loads(capsys.readouterr().out)
    assert printed["plan"] == "ground" and printed["rx_m"] == [[3, 0, 2], [3, 4, 3]]
    assert printed["states"] == [["los", "los"]]
    paths = Paths.read_parquet(tmp_path / "out" / "paths.parquet")
    far = np.hypot(6, 4)
    expected = [6, np.hypot(6, 4), np.hypot(far, 1), np.hypot(far, 5)]
    assert sorted(paths.delay_s * 299792458) == pytest.approx(sorted(expected))
    with np.load(tmp_path / "out" / "csi_tx1.npz") as csi:
        assert csi["response"].shape[0] == 2 and csi["response"].shape[-1] == 16
    assert {"rays_tx1.png", "csi_tx1.png"} <= {one.name for one in (tmp_path / "out").iterdir()}


def test_a_channel_along_a_trajectory_in_a_scene(scene_file, tmp_path):
    """Places without a height are at --height: the direct path along the ground has the distance, from 5 m to 4 m."""
    poses = np.column_stack([np.linspace(5, 4, 3), np.zeros(3), np.zeros(3)])
    write_tum(tmp_path / "trajectory.tum", np.arange(3.0), poses)
    words = f"--tx 0,0 --along {tmp_path}/trajectory.tum --rate 1 --height 1 --out {tmp_path}/out"
    main(f"trace {scene_file} {words}".split())
    channel = np.load(tmp_path / "out" / "channel_tx1.npz")
    np.testing.assert_allclose(channel["delay_s"][:, 0] * 299792458, [5, 4.5, 4])
    np.testing.assert_allclose(channel["delay_s"][0, 1] * 299792458, np.hypot(5, 2))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--storey 0", "--storey is 0, which is for floor plans, and this is a Mitsuba scene"),
        ("--material brick", "--material is brick"),
        ("--resolution 0.1", "--resolution is 0.1"),
        ("--floor-ceiling", "--floor-ceiling is True"),
        ("--people 2", "--people is 2, which is for floor plans"),
    ],
)
def test_what_a_scene_has_no_use_for_is_rejected(words, message, scene_file, fails):
    assert message in fails("trace", scene_file, "--tx", "0,0,2", "--rx", "1,1,1", *words.split())


def test_trace_rejects_a_crowd_in_a_scene(scene_file, tmp_path, fails):
    (crowd := tmp_path / "crowd.csv").write_text("time,id,x,y\n0,ann,1,1\n")
    message = fails("trace", scene_file, "--tx", "0,0,2", "--rx", "1,1,1", "--mover", crowd)
    assert f"--mover is {crowd}, which is for floor plans" in message


def test_a_scene_needs_receivers_and_must_be_one(scene_file, tmp_path, fails):
    assert "a Mitsuba scene needs receivers" in fails("trace", scene_file, "--tx", "0,0,2")
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    ends = ("--tx", "0,0,2", "--rx", "1,1,1")
    assert "it begins with <mujoco>, expected <scene>" in fails("trace", tmp_path / "robot.xml", *ends)


def test_links_to_several_receivers_of_a_plan(plan_file, tmp_path, capsys, fails):
    """As those traced one by one; a grid has one receiver whose rays are drawn."""
    command = ["trace", str(plan_file), "--tx", "1,1", "--rx", "2,1", "--rx", "4,0.4"]
    main([*command, "--json", "--out", str(tmp_path / "out")])
    assert json.loads(capsys.readouterr().out)["states"] == [["los", "first_order"]]
    main([*command, "--json", "--threshold-dbm", "100", "--no-plots", "--out", str(tmp_path / "weak")])
    assert json.loads(capsys.readouterr().out)["states"] == [["outage", "outage"]]
    assert not list((tmp_path / "weak").glob("*.png"))
    assert "rx is given 2 times with grid" in fails(*command, "--grid", "1")


HOUSE = """<scene version="2.1.0">
<bsdf type="itu-radio-material" id="m"><string name="type" value="concrete"/></bsdf>
<bsdf type="itu-radio-material" id="wall"><string name="type" value="metal"/></bsdf>
<shape type="rectangle" id="ground"><transform name="to_world"><scale value="5"/></transform><ref id="m"/></shape>
<shape type="cube" id="house"><transform name="to_world"><translate x="2" z="1"/></transform><ref id="wall"/></shape>
</scene>"""


def test_grid_over_a_scene(tmp_path, capsys):
    """The coverage of the scene in all formats; the same command again traces nothing, another material is rejected."""
    (tmp_path / "house.xml").write_text(HOUSE)
    out = tmp_path / "out"
    command = f"trace {tmp_path}/house.xml --tx -3,0,1 --tx 4,3,2 --grid 1 --height 1 --workers 1 --out {out}"
    main([*command.split(), "--json"])
    result = json.loads(capsys.readouterr().out)
    assert result["plan"] == "house" and result["links"] == 200
    assert result["cells"]["in_body"] == 2 * 4 and sum(result["cells"].values()) == 200
    paths = Paths.read_parquet(out / "paths.parquet")
    site = radio_site(tmp_path / "house.xml", RadioConfig(height_m=1.0))
    coverage = site.coverage(np.array([[-3.0, 0, 1], [4, 3, 2]]), 1.0)
    with np.load(out / "coverage.npz") as file:
        for name, values in coverage.to_arrays().items():
            np.testing.assert_array_equal(file[name], values, err_msg=name)
    table = pq.read_table(out / "coverage.parquet")
    assert table.num_rows == 200
    np.testing.assert_array_equal(table["power_dbm"].to_numpy(), coverage.power_dbm.ravel())
    assert paths.link_state()[0].tolist() == (coverage.category[0].ravel() % 4).tolist()
    assert {"coverage.png", "power_tx1.png", "state_tx2.png", "house_Tx_2.csv"} <= {
        file.name for file in out.iterdir()
    }
    with np.load(out / "deepmimo_scenarios/house/power_t000_tx001_r001.npz") as file:
        assert np.isfinite(file["power"]).sum(axis=1).tolist() == paths.count()[1].tolist()
    main([*command.split(), "--no-plots", "--bandwidth-mhz", "20"])
    assert "0 traced" in capsys.readouterr().out
    with np.load(out / "coverage.npz") as file:
        assert file["noise_dbm"] == pytest.approx(-174 + 10 * np.log10(20e6) + 6)


def test_grids_over_other_scenes_are_not_mixed(tmp_path, fails):
    """Another material is another scene, and another box another grid."""
    (tmp_path / "house.xml").write_text(HOUSE)
    command = (
        f"trace {tmp_path}/house.xml --tx -3,0,1 --grid 2 --no-plots --workers 1 --out {tmp_path}/out".split()
    )
    main(command)
    assert "building_sha256" in fails(*command, "--scene-material", "wall=glass")
    assert "receivers" in fails(*command, "--bounds", "-5,-5,0,5")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--grid 0.001", "10 x 10 m, more than 1000000 places. Take wider cells, such as 0.02 m"),
        (
            "--grid 1 --bounds -1e4,-1e4,1e4,1e4",
            "grid is 1 m, which makes 400000000 receivers on 20000 x 20000 m",
        ),
        ("--grid nan", "grid is nan"),
        ("--grid -1", "grid is -1.0"),
        ("--grid 1 --bounds 20,20,30,30", "scene, which reaches from [-5.0, -5.0] to [5.0, 5.0] m"),
        ("--grid 1 --tx-array 8y4", "tx_array is '8y4', expected rows x columns"),
        ("--grid 1 --rx-array 0x4", "rx_array is '0x4', expected rows x columns"),
        ("--grid 1 --tx-array 2x2:dish", "Known: patch, 3gpp"),
        (
            "--grid 1 --tx-array 2x2:3gpp --tx-antenna patch",
            "expected elements in one of them. Give --tx-array 2x2.",
        ),
        ("--rx 1,1,1 --bounds 0,0,1,1", "bounds is given without a grid"),
        ("--rx 1,1,1 --tx-array 2x2", "which count with --csi or --grid only"),
    ],
)
def test_maps_and_arrays_that_cannot_be_are_rejected(words, message, tmp_path, fails):
    (tmp_path / "house.xml").write_text(HOUSE)
    assert message in fails(
        "trace", tmp_path / "house.xml", "--tx", "-3,0,1", *words.split(), "--out", tmp_path / "o"
    )


def test_frequency_responses_of_arrays(scene_file, tmp_path, fails):
    """In line of sight alone: the response of single antennas times the outer product of steering vectors.

    The receiver is at (3, 4, 3), the transmitter faces +y: its elements lie along -x and z, the receiver's along y, z.
    """
    ends = f"trace {scene_file} --tx 0,0,2 --rx 3,4,3 --max-reflections 0 --no-diffraction --csi 4x1MHz"
    responses = {}
    for name, words in {
        "single": "--tx-antenna 3gpp,90",
        "arrays": "--tx-array 3x4@0.6:3gpp,90 --rx-array 1x2",
        "both": "--tx-array 3x4@0.6:3gpp,90 --rx-array 1x2 --polarisation both",
    }.items():
        main([*ends.split(), *words.split(), "--out", str(tmp_path / name)])
        with np.load(tmp_path / name / "csi_tx1.npz") as file:
            responses[name] = file["response"][0]
            ports = file["tx_port_wl"], file["rx_port_wl"]
        assert (tmp_path / name / "csi_tx1.png").exists()
    direction = np.array([3.0, 4, 1]) / np.linalg.norm([3, 4, 1])
    across, up = np.meshgrid(0.6 * (np.arange(4) - 1.5), 0.6 * (np.arange(3) - 1), indexing="ij")
    sent = np.exp(2j * np.pi * (across.ravel() * -direction[0] + up.ravel() * direction[2]))
    received = np.exp(2j * np.pi * np.array([-0.25, 0.25]) * -direction[1])
    expected = received[:, None, None] * sent[:, None] * responses["single"]
    assert responses["single"].shape == (1, 1, 4) and responses["arrays"].shape == (2, 12, 4)
    np.testing.assert_allclose(responses["arrays"], expected, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_allclose(responses["both"][:2, :12], expected, atol=1e-5 * np.abs(expected).max())
    assert (ports[0].shape, ports[1].shape) == ((24, 3), (4, 3))


PAINTED = """<scene version="3.0.0"><bsdf type="diffuse" id="paint"/><bsdf type="radio-material" id="own">
<float name="relative_permittivity" value="4"/><float name="thickness" value="0.02"/></bsdf>
<shape type="cube" id="box"><ref id="paint"/></shape>
<shape type="rectangle" id="floor"><transform name="to_world"><scale value="9"/></transform><ref id="own"/></shape>
</scene>"""


def test_trace_inspects_a_scene(tmp_path, capsys):
    """Glass at 5 GHz: 6.31 and 0.0036 5^1.3394 S/m, 0.1 m as in Sionna RT."""
    path = tmp_path / "scene.xml"
    path.write_text(PAINTED)
    words = f"trace {path} --inspect --radio.frequency-ghz 5 --scene-material paint=glass".replace(
        "radio.", ""
    ).split()
    main([*words, "--json"])
    result = json.loads(capsys.readouterr().out)
    assert result["shapes"] == [
        {"shape": "box", "triangles": 12, "material": "paint"},
        {"shape": "floor", "triangles": 2, "material": "own"},
    ]
    paint, own = result["materials"]["paint"], result["materials"]["own"]
    assert (paint["relative_permittivity"], paint["conductivity_spm"]) == pytest.approx(
        (6.31, 0.0036 * 5**1.3394)
    )
    assert paint["thickness_m"] == 0.1
    assert (own["relative_permittivity"], own["conductivity_spm"], own["thickness_m"]) == (4, 0, 0.02)
    main(words)
    assert "6.31" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--tx 0,0,5 --rx 3,0,5", "--scene-material paint=concrete"),
        ("--inspect --scene-material glass", "expected NAME=MATERIAL"),
        ("--inspect --scene-material paint=glas", "Did you mean 'glass'"),
        ("--inspect --scene-material wall=glass", "no material 'wall' in it, expected one of paint, own"),
        ("--scene-material paint=glass --rx 3,0,5", "tx is missing"),
    ],
)
def test_trace_rejects_materials_that_a_scene_lacks(tmp_path, fails, words, reason):
    path = tmp_path / "scene.xml"
    path.write_text(PAINTED)
    assert reason in fails("trace", str(path), *words.split())


def test_trace_inspects_no_floor_plan(plan_file, fails):
    assert "is a floor plan, but scene_material or inspect" in fails("trace", str(plan_file), "--inspect")
