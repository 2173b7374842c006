"""`robosim dataset`: what it writes, that it goes on after a kill to the same bytes, and how it fails."""

import gc
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from robosim.cli import main
from robosim.datasets import link_units
from robosim.datasets.link_units import CHUNK_LINKS, LinkSetConfig, prepare_site
from robosim.datasets.links import make_dataset
from robosim.plans.files import read_plan
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from robosim.radio.scene import RadioScene
from tests.plans import room
from wireless import Tracer
from wireless.estimates import wrapped
from wireless.formats.link_records import COLUMNS, read_links, read_rays
from wireless.formats.mmwrobotnav_measurements import find_measurements, read_measurements
from wireless.paths import LinkState

#: Two buildings, the second a generated home, with two transmitters each.
OPTIONS = (
    "--generated 1 --seed 5 --tx-per-plan 2 --grid 0.8 --estimator pca --format mmwrobotnav --format deepmimo"
)


@pytest.fixture(scope="module")
def made(plan_file, tmp_path_factory):
    """A folder that two processes made without interruption."""
    out = tmp_path_factory.mktemp("made")
    main(f"dataset {plan_file} {OPTIONS} --workers 2 --out {out}".split())
    return out


def contents(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_manifest_lists_what_tables_hold(made):
    """Rows, states and columns of the manifest are those of the files; each unit has its own."""
    manifest = json.loads((made / "manifest.json").read_text())
    files = [unit["file"] for unit in manifest["units"]]
    assert sorted(files) == sorted(p.relative_to(made).as_posix() for p in made.glob("links/*"))
    assert files[:2] == ["links/two rooms_Tx_1.parquet", "links/two rooms_Tx_2.parquet"]
    assert {"numpy", "pyarrow", "python"} <= set(manifest["versions"])
    assert manifest["config"]["seed"] == 5
    assert len({plan["sha256"] for plan in manifest["plans"]}) == 2
    total = 0
    for unit in manifest["units"]:
        table = pq.read_table(made / unit["file"])
        assert table.column_names == list(COLUMNS) == list(manifest["columns"])
        assert unit["rows"] == len(table) >= 20
        counts = np.bincount(table["link_state"].to_numpy(), minlength=4)
        assert [unit["states"][one.name.lower()] for one in LinkState] == counts.tolist()
        assert set(table["tx"].to_pylist()) == {unit["tx"]}
        assert table.schema.field("snr_db_1").metadata[b"unit"] == b"dB"
        total += len(table)
    assert manifest["rows"] == total == sum(manifest["states"].values())


def test_links_are_those_of_the_tracer(made, plan_file):
    """Traced again from the positions in the file: the same paths and states; lists are as long as they say."""
    links = read_links(made / "links" / "two rooms_Tx_2.parquet")
    rays = read_rays(made / "links" / "two rooms_Tx_2.parquet")
    scene = RadioScene(read_plan(plan_file), _config())
    paths = scene.tracer.trace(links.tx_position[None], links.rx_position)
    assert paths.count()[0].tolist() == links.n_paths.tolist()
    assert paths.link_state()[0].tolist() == links.state.tolist()
    assert np.sum(np.abs(rays.gain) > 0, axis=1).tolist() == links.n_paths.tolist()
    np.testing.assert_allclose(
        np.abs(rays.gain[:, 0][links.n_paths > 0]) ** 2, paths.strongest().power, rtol=1e-5
    )
    sight = links.state == LinkState.LOS
    off = np.abs(wrapped(links.estimates.aoa_rad[:, 0] - rays.aoa_az[:, 0]))[sight]
    assert sight.sum() > 10
    assert np.mean(off < np.deg2rad(5)) > 0.9


def _config():
    from robosim.datasets.link_units import LinkSetConfig

    return LinkSetConfig().radio


def test_arrays_turn_and_azimuths_stay(plan_file, tmp_path):
    """Random headings fill the turn; arrivals in sight still are those of the scene, 90 % within 5 degrees."""
    main(
        f"dataset {plan_file} --tx-per-plan 1 --grid 0.6 --estimator pca --headings random --out {tmp_path}".split()
    )
    path = tmp_path / "links" / "two rooms_Tx_1.parquet"
    links, rays = read_links(path), read_rays(path)
    assert np.abs(np.exp(1j * links.rx_heading).mean()) < 0.3
    sight = links.state == LinkState.LOS
    off = np.abs(wrapped(links.estimates.aoa_rad[:, 0] - rays.aoa_az[:, 0]))[sight]
    assert sight.sum() > 10
    assert np.mean(off < np.deg2rad(5)) > 0.9


def test_people_weaken_estimates_and_leave_states(plan_file, tmp_path):
    """True paths and states are those of the building; one line of sight in twenty loses 6 dB, none gains 3 dB."""
    command = f"dataset {plan_file} --tx-per-plan 1 --grid 0.3 --estimator pca"
    for people in (0, 3):
        main(f"{command} --people {people} --out {tmp_path / str(people)}".split())
    without, among = (
        read_links(tmp_path / str(people) / "links" / "two rooms_Tx_1.parquet") for people in (0, 3)
    )
    np.testing.assert_array_equal(without.state, among.state)
    np.testing.assert_array_equal(without.n_paths, among.n_paths)
    sight = without.state == LinkState.LOS
    loss_db = (without.estimates.snr_db - among.estimates.snr_db)[sight, 0]
    assert np.mean(loss_db > 6) > 0.05 and loss_db.min() > -3


def test_people_stand_on_the_storey_of_the_receiver(tmp_path):
    """Links from a transmitter on a storey to receivers there lose power on either storey."""
    house = StoreysPlan(name="house", storeys=(StoreyPlan(plan=room()), StoreyPlan(plan=room())))
    without, among = (
        LinkSetConfig(tx_per_plan=2, grid_m=0.4, estimator="pca", people=people) for people in (0, 8)
    )
    for config, out in ((without, tmp_path / "without"), (among, tmp_path / "among")):
        make_dataset([house], config, out)
    for storey, tx in ((0, 1), (1, 2)):
        file = f"links/house_storey_{storey}_Tx_{tx}.parquet"
        alone, crowded = (read_links(tmp_path / name / file) for name in ("without", "among"))
        loss_db = (alone.estimates.snr_db - crowded.estimates.snr_db)[:, 0]
        assert np.mean(loss_db > 3) > 0.1, f"storey {storey}"


def test_blocks_of_links_make_the_table_of_all_links(tmp_path, monkeypatch):
    """Traced in blocks: the same rows, a group for each block; any rows of them are read."""
    config = LinkSetConfig(tx_per_plan=2, grid_m=0.08, estimator="pca", headings="random", people=1)
    for name in ("whole", "blocks"):
        make_dataset([room()], config, tmp_path / name)
        monkeypatch.setattr(link_units, "_BLOCK_LINKS", CHUNK_LINKS)
    whole, blocks = (tmp_path / name / "links" / "room_Tx_2.parquet" for name in ("whole", "blocks"))
    rows = pq.read_metadata(blocks).num_rows
    assert pq.read_metadata(blocks).num_row_groups == -(-rows // CHUNK_LINKS) >= 3
    assert pq.read_metadata(whole).num_row_groups == 1
    expected, links = pq.read_table(whole), pq.read_table(blocks)
    for name, column in zip(COLUMNS, links.columns, strict=True):
        flat = [c.combine_chunks() for c in (expected[name], column)]
        if pa.types.is_list(column.type):
            assert flat[0].offsets.equals(flat[1].offsets), name
            flat = [c.flatten() for c in flat]
        np.testing.assert_array_equal(*(c.to_numpy(zero_copy_only=False) for c in flat), err_msg=name)
    for span in (range(0, 1), range(CHUNK_LINKS - 1, 2 * CHUNK_LINKS + 1), range(CHUNK_LINKS, rows)):
        links = read_links(blocks, span)
        np.testing.assert_array_equal(
            links.rx_position, read_links(whole).rx_position[span.start : span.stop]
        )
    with pytest.raises(ValueError, match=rf"room_Tx_2\.parquet.*it has {rows} rows, expected {rows + 1}"):
        read_links(blocks, range(rows, rows + 1))


def test_buildings_of_earlier_units_are_released(tmp_path):
    """At most two of five buildings stay in memory, those of the last two units, without a search for cycles."""
    rooms = [room(width_m=4.0 + n, name=f"room{n}") for n in range(5)]
    gc.collect()
    gc.disable()
    try:
        make_dataset(rooms, LinkSetConfig(tx_per_plan=1, grid_m=1.0, estimator="pca"), tmp_path)
        alive = sum(type(item) is Tracer for item in gc.get_objects())
    finally:
        gc.enable()
    prepare_site.cache_clear()
    gc.collect()
    assert alive - sum(type(item) is Tracer for item in gc.get_objects()) <= 2


def test_plans_of_one_content_have_files_of_their_names(tmp_path):
    """Also in additional formats, and the same links."""
    config = LinkSetConfig(tx_per_plan=1, grid_m=1.0, estimator="pca", formats=("mmwrobotnav",))
    make_dataset([room(name="a"), room(name="b")], config, tmp_path)
    for name in ("a", "b"):
        assert (tmp_path / "mmwrobotnav" / name / f"{name}_Tx_1.csv").is_file()
    states = [read_links(tmp_path / "links" / f"{name}_Tx_1.parquet").state for name in ("a", "b")]
    np.testing.assert_array_equal(*states)


def test_formats_hold_the_same_links(made):
    """MmwRobotNav's files, by the reader of the published ones, and DeepMIMO's agree with the tables."""
    found = find_measurements(made / "mmwrobotnav")
    assert found == [("home-5", 1), ("home-5", 2), ("two rooms", 1), ("two rooms", 2)]
    for name, number in found:
        links = read_links(made / "links" / f"{name}_Tx_{number}.parquet")
        read = read_measurements(made / "mmwrobotnav", name, number)
        np.testing.assert_allclose(read.tx_position, links.tx_position)
        np.testing.assert_allclose(read.rx_position, links.rx_position[:, :2])
        assert read.state.tolist() == links.state.tolist()
        np.testing.assert_allclose(read.aoa_az, links.estimates.aoa_rad, atol=1e-6)
        np.testing.assert_allclose(read.aod_az, links.estimates.aod_rad, atol=1e-6)
        np.testing.assert_allclose(read.snr_db, links.estimates.snr_db, atol=1e-4)
        traced = (made / "mmwrobotnav" / name / f"{name}_Tx_{number}.csv").read_text().splitlines()
        assert [int(row.split(",")[5]) for row in traced[1:]] == links.n_paths.tolist()
        scenario = made / "deepmimo_scenarios" / name.replace(" ", "_")
        with np.load(scenario / f"power_t000_tx{number - 1:03}_r001.npz") as file:
            assert np.isfinite(file["power"]).sum(axis=1).tolist() == links.n_paths.tolist()
        params = json.loads((scenario / "params.json").read_text())
        assert params["txrx_sets"]["txrx_set_0"]["num_points"] == 2


def test_a_killed_run_goes_on_to_the_same_bytes(made, plan_file, tmp_path, capsys):
    """Killed with some units done, then finished: every file of an uninterrupted run of two processes, no other."""
    command = f"dataset {plan_file} {OPTIONS} --workers 1 --out {tmp_path}".split()
    process = subprocess.Popen([sys.executable, "-m", "robosim", *command], stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 1200
    while not list(tmp_path.glob("links/*.parquet")) and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = list(tmp_path.glob("links/*.parquet"))
    assert 1 <= len(done) < 4
    assert not (tmp_path / "manifest.json").exists()
    stored = {path: path.stat().st_mtime_ns for path in done}
    (tmp_path / "links" / ".torn.partial-1.parquet").write_bytes(b"PAR1")
    capsys.readouterr()
    main(command)
    assert "resuming from there" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in done} == stored
    assert contents(tmp_path) == contents(made)


def test_the_same_command_again_makes_nothing(made, plan_file, capsys):
    before = contents(made)
    main(f"dataset {plan_file} {OPTIONS} --out {made}".split())
    assert "0 made" in capsys.readouterr().out
    assert contents(made) == before


def test_other_settings_are_rejected(made, plan_file, fails):
    command = f"dataset {plan_file} {OPTIONS} --out {made}"
    assert "seed 5 there, 6 now" in fails(*command.replace("--seed 5", "--seed 6").split())
    assert "estimator pca there, sage now" in fails(*command.replace(" pca", " sage").split())
    assert "max_reflections 3 there, 1 now" in fails(*command.split(), "--max-reflections", "1")


def test_another_command_leaves_the_folder_alone(made, plan_file, fails):
    """`robosim trace` once wrote its settings over those of the data set, which then could not go on."""
    before = contents(made)
    assert "holds the results of `robosim dataset`" in fails("trace", plan_file, "--tx", "1,1", "--out", made)
    assert contents(made) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("", "plans is empty and generated is 0: give floor plans"),
        ("--generated -1", "generated is -1"),
        ("nowhere.yaml", "no such file"),
        ("{plan} --tx-per-plan 0", "tx_per_plan is 0, expected a whole number from 1"),
        ("{plan} --grid 0", "grid_m is 0.0, expected 0.01 to 100 m"),
        ("{plan} --grid 50", "grid is 50 m, and no receiver fits"),
        ("{plan} --workers 0", "workers is 0"),
        ("{plan} --seed -1", "seed is -1"),
        ("{plan} --height 9", "height of terminals (--height) is 9 m, expected 0 to 2.5 m"),
        ("{plan} --max-reflections -1", "max_reflections is -1"),
        ("{plan} {plan}", "2 plans are called 'two rooms'"),
        ("{plan} --estimator music", "estimator is 'music'. Known: sage, pca"),
        ("{plan} --bandwidth-mhz 56000", "bandwidth_mhz is 56000 at a carrier of 28 GHz, expected less than"),
    ],
)
def test_mistakes_end_in_one_sentence(arguments, message, plan_file, tmp_path, fails):
    words = arguments.format(plan=plan_file).split()
    assert message in fails("dataset", *words, "--out", tmp_path / "out")
    assert not list(tmp_path.rglob("*.parquet"))


def test_ctrl_c_says_how_to_go_on(plan_file, tmp_path):
    """To the whole group of processes, as a terminal sends it, at any moment: one sentence, no traceback."""
    command = f"dataset {plan_file} --tx-per-plan 60 --grid 0.15 --estimator pca --out {tmp_path}".split()
    process = subprocess.Popen(
        [sys.executable, "-m", "robosim", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 1200
    while not (tmp_path / "settings.json").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.5)  # processes are starting
    os.killpg(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=1200)
    assert process.returncode == 130
    assert "Resume with the same command" in said
    assert complained == (
        "Stopping after the transmitters that are being worked on. Press Ctrl-C again to end at once.\n"
    )
