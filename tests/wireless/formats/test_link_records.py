"""Tables of links and CSV files of estimates: what is written is what is read."""

import gc

import numpy as np
import pyarrow.parquet as pq
import pytest

from wireless import PathEstimates, Rays, Tracer
from wireless.formats.link_records import COLUMNS, link_table, read_links, read_rays, write_links
from wireless.formats.mmwrobotnav_csv import estimated_csv
from wireless.formats.mmwrobotnav_measurements import read_measurements
from wireless.paths import Interaction

TX = np.array([[4.0, 3.1, 1.2], [1.0, 1.4, 1.5]])
RX = np.array([[5.0, 0.9, 1.5], [2.6, 1.3, 1.5], [1.5, 3.2, 2.0]])  # the second is sealed off
CELL, SHAPE = np.array([[0, 4], [1, 2], [3, 1]]), (4, 6)


@pytest.fixture(scope="module")
def paths(extruded, ring):
    outline = ring((0, 0), (6, 0), (6, 4), (0, 4))
    return Tracer(extruded(np.concatenate([outline, ring((2, 1), (3, 1), (3, 2), (2, 2))]))).trace(TX, RX)


@pytest.fixture
def estimates():
    """Two, no and five paths."""
    count = np.array([2, 0, 5])
    rng = np.random.default_rng(0)
    there = np.arange(5) < count[:, None]
    draw = [np.where(there, rng.uniform(-3, 3, (3, 5)), 0.0) for _ in range(3)]
    snr = np.where(there, -np.sort(-rng.uniform(-20, 60, (3, 5)), axis=1), -np.inf)
    return PathEstimates(aoa_rad=draw[0], aod_rad=draw[1], snr_db=snr, delay_s=1e-9 * draw[2], count=count)


def test_a_table_gives_back_links_estimates_and_paths(paths, estimates, tmp_path):
    """To single precision; places without an estimate hold NaN in the file."""
    write_links(
        tmp_path / "a.parquet",
        [link_table(paths, 1, estimates, CELL, plan="ring", rx_heading_rad=np.arange(3.0))],
    )
    table = pq.read_table(tmp_path / "a.parquet")
    assert table.column_names == list(COLUMNS)
    assert table["tx"].to_pylist() == [2, 2, 2]
    assert table["link"].to_pylist() == [3, 4, 5]
    assert np.isnan(table["snr_db_3"].to_numpy()).tolist() == [True, True, False]
    links = read_links(tmp_path / "a.parquet")
    assert (links.plan, links.number) == ("ring", 2)
    assert links.tx_position.tolist() == TX[1].tolist()
    assert links.rx_position.tolist() == RX.tolist()
    assert links.rx_cell.tolist() == CELL.tolist()
    assert links.rx_heading.tolist() == [0, 1, 2]
    gc.collect()
    read_links(tmp_path / "a.parquet")
    assert gc.collect() == 0  # a reader of thousands of tables would hold their metadata for a while
    assert links.state.tolist() == paths.link_state()[1].tolist()
    assert links.n_paths.tolist() == paths.count()[1].tolist()
    for name, value in vars(estimates).items():
        np.testing.assert_allclose(getattr(links.estimates, name), value, rtol=1e-6)
    rays, expected = read_rays(tmp_path / "a.parquet"), Rays.from_paths(paths)[3:]
    width = rays.gain.shape[1]
    for name, value in vars(expected).items():
        assert not np.any(value[:, width:])
        np.testing.assert_allclose(
            getattr(rays, name), value[:, :width], rtol=1e-5, atol=1e-7 * np.abs(value).max()
        )


def test_digits_are_the_kinds_from_the_transmitter_on(paths):
    """112 is two reflections, then a diffraction; line of sight is 0."""
    for digits, kinds in zip(paths.digits, paths.interaction, strict=True):
        assert "".join(str(k) for k in kinds if k != Interaction.NONE) == (str(digits) if digits else "")
    assert {0, 1, 2} <= set(paths.digits.tolist())


def test_the_reader_of_published_files_reads_ours(paths, estimates, tmp_path):
    """Angles, SNR, states, positions, and rows from the top; missing paths are zeros, as published."""
    folder = tmp_path / "ring"
    folder.mkdir()
    (folder / "ring_tx_pos.csv").write_text(",x,y,z\n0,4,3.1,1.2\n")
    state = paths.link_state()[0]
    content = estimated_csv(estimates, RX, state, CELL, SHAPE)
    (folder / "ring_Tx_1_beam_search.csv").write_bytes(content)
    read = read_measurements(tmp_path, "ring", 1)
    assert read.rx_cell.tolist() == [[4, 5], [3, 3], [1, 2]]
    assert read.rx_position.tolist() == RX[:, :2].tolist()
    assert read.state.tolist() == state.tolist()
    np.testing.assert_allclose(read.aoa_az, estimates.aoa_rad, atol=1e-8)
    np.testing.assert_allclose(read.aod_az, estimates.aod_rad, atol=1e-8)
    np.testing.assert_allclose(
        read.snr_db, np.where(np.isfinite(estimates.snr_db), estimates.snr_db, 0), atol=1e-6
    )
    assert not read.peak_fraction.any()


def test_other_files_are_named(tmp_path, paths):
    paths.write_parquet(tmp_path / "paths.parquet")
    for reader in (read_links, read_rays):
        with pytest.raises(
            ValueError, match=r"paths\.parquet: not readable as links of a data set .column \w+ is missing"
        ):
            reader(tmp_path / "paths.parquet")
