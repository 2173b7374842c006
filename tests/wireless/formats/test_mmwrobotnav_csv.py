"""CSV files of traced paths, read back by the names of their columns."""

import csv

import numpy as np
import pytest

from wireless import LinkState, Tracer
from wireless.formats.mmwrobotnav_csv import traced_csv

TX = np.array([[4.0, 3.1, 1.2], [1.0, 1.4, 1.5]])
RX = np.array([[5.0, 0.9, 1.5], [2.6, 1.3, 1.5], [1.5, 3.2, 2.0]])  # the second is sealed off
CELL, SHAPE = np.array([[0, 4], [1, 2], [3, 1]]), (4, 6)


@pytest.fixture(scope="module")
def paths(extruded, ring):
    outline = ring((0, 0), (6, 0), (6, 4), (0, 4))
    return Tracer(extruded(np.concatenate([outline, ring((2, 1), (3, 1), (3, 2), (2, 2))]))).trace(TX, RX)


def read(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_a_row_is_a_receiver_and_its_paths(paths, tmp_path):
    """Powers [dBm], times [s], angles [degrees, from the zenith], losses [dB]: all of them, strongest first."""
    (tmp_path / "a.csv").write_bytes(traced_csv(paths, 1, CELL, SHAPE, tx_power_dbm=23.0))
    rows = read(tmp_path / "a.csv")
    assert len(rows) == 3
    for rx, row in enumerate(rows):
        mine = paths.between(1, rx)
        assert int(row["npaths"]) == len(mine)
        for i in range(25):
            written = [row[f"{i + 1}_{name}"] for name in ("srcvdpower", "arrival_time", "path_loss")]
            angles = [row[f"{i + 1}_{name}"] for name in ("aoa_az", "aoa_el", "aod_az", "aod_el")]
            if i >= len(mine):
                assert written + angles == [""] * 7
                continue
            power, delay, loss = map(float, written)
            assert power == pytest.approx(23 + mine.power_db[i], abs=1e-6)
            assert loss == pytest.approx(23 - power, abs=1e-6)
            assert delay == pytest.approx(mine.delay_s[i], rel=1e-8)
            expected = [
                mine.aoa_az[i],
                np.pi / 2 - mine.aoa_el[i],
                mine.aod_az[i],
                np.pi / 2 - mine.aod_el[i],
            ]
            assert [float(a) for a in angles] == pytest.approx(np.degrees(expected), abs=1e-6)


def test_columns_stand_in_the_published_order(paths, tmp_path):
    (tmp_path / "a.csv").write_bytes(traced_csv(paths, 0, CELL, SHAPE))
    names = (tmp_path / "a.csv").read_text().splitlines()[0].split(",")
    assert names[1:9] == [
        "rx_pos_ind_row", "rx_pos_ind_column", "rx_pos_x", "rx_pos_y", "npaths", "los", "link_state", "1st_NLOS",
    ]  # fmt: skip
    assert names[9:16] == [
        "1_srcvdpower", "1_arrival_time", "1_aoa_az", "1_aoa_el", "1_aod_az", "1_aod_el", "1_path_loss",
    ]  # fmt: skip
    assert len(names) == 9 + 25 * 7


def test_places_count_from_the_top_left_and_lines_from_the_lower_left(paths, tmp_path):
    """Row 0 of four is row 4 of the file; line_index is row times columns plus column, from the bottom."""
    (tmp_path / "a.csv").write_bytes(traced_csv(paths, 0, CELL, SHAPE))
    rows = read(tmp_path / "a.csv")
    assert [(row["rx_pos_ind_row"], row["rx_pos_ind_column"]) for row in rows] == [
        ("4", "5"),
        ("3", "3"),
        ("1", "2"),
    ]
    assert [row["line_index"] for row in rows] == ["4", "8", "19"]
    assert [(float(row["rx_pos_x"]), float(row["rx_pos_y"])) for row in rows] == [tuple(p) for p in RX[:, :2]]


def test_states_follow_the_threshold(paths, tmp_path):
    """At a threshold above all paths every link is in outage, and still has its paths."""
    state = paths.link_state()[1]
    assert set(state) == {LinkState.OUTAGE, LinkState.FIRST_ORDER, LinkState.LOS}
    (tmp_path / "a.csv").write_bytes(traced_csv(paths, 1, CELL, SHAPE))
    (tmp_path / "b.csv").write_bytes(traced_csv(paths, 1, CELL, SHAPE, threshold_db=0.0))
    rows, none = read(tmp_path / "a.csv"), read(tmp_path / "b.csv")
    assert [int(row["link_state"]) for row in rows] == list(state)
    assert [row["los"] for row in rows] == ["1" if s == LinkState.LOS else "0" for s in state]
    assert [row["1st_NLOS"] for row in rows] == ["1" if s == LinkState.FIRST_ORDER else "0" for s in state]
    assert {row["link_state"] for row in none} == {"0"}
    assert [row["npaths"] for row in none] == [row["npaths"] for row in rows]
