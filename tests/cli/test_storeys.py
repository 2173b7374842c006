"""`robosim trace` and `robosim dataset` over a building of two storeys."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from robosim.cli import main
from robosim.plans.files import write_ros
from tests.plans import room
from wireless.paths import Paths

FAST = ["--max-reflections", "1", "--no-diffraction"]


@pytest.fixture
def house(tmp_path):
    """Two rooms of 4 x 3 m2 over each other, and a stairwell."""
    write_ros(room(), tmp_path / "room.yaml")
    file = tmp_path / "house.yaml"
    file.write_text(
        "storeys:\n- {plan: room.yaml, openings: [[[1, 1], [2, 1], [2, 2.5], [1, 2.5]]]}\n- plan: room.yaml\n"
    )
    return file


def test_link_between_storeys_is_drawn(house, tmp_path):
    """One storey up through the stairwell: the direct path is there, and a picture of both storeys."""
    out = tmp_path / "link"
    main(["trace", str(house), "--tx", "1.5,1.7", "--rx", "1.4,1.8,4.3", *FAST, "--out", str(out)])
    paths = Paths.read_parquet(out / "paths.parquet")
    assert paths.order[0] == 0 and paths.tx_position[0, 2] == 1.5 and paths.rx_position[0, 2] == 4.3
    assert (out / "rays_tx1.png").stat().st_size > 10_000


def test_receivers_of_one_storey(house, tmp_path):
    """`--storey 1` lays the grid on the upper floor; heights count from the lowest one."""
    out = tmp_path / "grid"
    command = ["trace", str(house), "--tx", "1.5,1.7,1.5", "--storey", "1", "--grid", "0.5", "--no-plots"]
    main([*command, *FAST, "--workers", "1", "--out", str(out)])
    paths = Paths.read_parquet(out / "paths.parquet")
    assert (paths.rx_position[:, 2] == 2.8 + 1.5).all() and len(paths.rx_position) == 48
    seen = paths.count()[0] > 0
    assert 0 < seen.sum() < len(seen)  # the slab hides the others


def test_trace_has_people_on_the_storey_of_the_receivers(house, tmp_path, capsys):
    words = ["--tx", "1.5,1.7", "--rx", "3,1", "--storey", "1", "--people", "2", *FAST]
    main(["trace", str(house), *words, "--json", "--out", str(tmp_path / "link")])
    feet = np.array(json.loads(capsys.readouterr().out)["bodies"]["position"])
    assert feet[:, 2].tolist() == [2.8, 2.8] and (feet[:, :2] > 0).all() and (feet[:, :2] < [4, 3]).all()


def test_data_set_has_links_between_all_storeys(house, tmp_path):
    """A table for each transmitter and each storey of receivers; transmitters stand on the storeys in turn."""
    out = tmp_path / "links"
    command = [
        "dataset",
        str(house),
        "--tx-per-plan",
        "3",
        "--grid",
        "1.0",
        "--workers",
        "1",
        "--estimator",
        "pca",
    ]
    main([*command, *FAST, "--out", str(out)])
    files = sorted((out / "links").iterdir())
    assert [one.stem for one in files] == [f"house_storey_{s}_Tx_{k}" for s in (0, 1) for k in (1, 2, 3)]
    heights = set()
    for one in files:
        table = pq.read_table(one)
        tx, rx = (np.unique(table[name].to_numpy()) for name in ("tx_z_m", "rx_z_m"))
        heights.add((one.stem, *np.round(tx, 9), *np.round(rx, 9)))
    assert heights == {
        (f"house_storey_{s}_Tx_{k}", (1.5, 4.3, 1.5)[k - 1], (1.5, 4.3)[s]) for s in (0, 1) for k in (1, 2, 3)
    }


def test_places_and_storeys_that_are_none_are_rejected(house, capsys):
    for options, message in (
        (["--tx", "1,1,2.6", "--rx", "1,2"], "is 2.6 m, expected 0 to 2.5, 2.8 to 5.3 m, between"),
        (["--tx", "9,1", "--rx", "1,2"], "outside of the free space of house_storey_0"),
        (["--tx", "1,1", "--rx", "1,2", "--storey", "2"], "storey is 2, expected 0, the lowest, to 1"),
        (["--tx", "1,1", "--rx", "1,2", "--resolution", "0.1"], "--resolution is for single floor plans"),
    ):
        with pytest.raises(SystemExit):
            main(["trace", str(house), *options])
        assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    "words",
    [["--rx", "1,2"], ["--rx", "1,2,1"], ["--grid", "1"], ["--storey", "1", "--grid", "1", "--height", "3"]],
)
def test_trace_rejects_a_height_above_the_ceiling_of_a_storey(words, house, fails):
    """At 1.45 m the upper storey begins: terminals of 1.5 m would be there, without a word."""
    text = house.read_text().replace(
        "plan: room.yaml, openings", "plan: room.yaml, height: 1.2, slab: 0.25, openings"
    )
    house.write_text(text)
    said = fails("trace", house, "--tx", "1,1", *words, *FAST)
    number, high, height = (1, "2.5", "3") if "3" in words else (0, "1.2", "1.5")
    assert (
        f"{house}: height of terminals (--height) is {height} m, expected 0 to {high} m, that of storey {number}"
        in said
    )
    assert f"Give --height {float(high) / 2:g}, or places with heights of their own" in said


def test_trace_takes_heights_of_their_own_below_a_low_ceiling(house, tmp_path):
    house.write_text("storeys:\n- {plan: room.yaml, height: 1.2}\n- plan: room.yaml\n")
    main(["trace", str(house), "--tx", "1,1,1", "--rx", "2,2,0.5", *FAST, "--out", str(tmp_path / "out")])
    assert len(Paths.read_parquet(tmp_path / "out" / "paths.parquet"))


def test_dataset_rejects_a_height_above_the_ceiling_of_any_storey(house, fails):
    house.write_text("storeys:\n- plan: room.yaml\n- {plan: room.yaml, height: 1.2}\n")
    assert (
        f"{house}: height of terminals (--height) is 1.5 m, expected 0 to 1.2 m, that of storey 1"
        in fails("dataset", house, "--tx-per-plan", "1", "--grid", "1", "--workers", "1")
    )
