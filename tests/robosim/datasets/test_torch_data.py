"""Data sets for PyTorch: every example is what the files say, in their order, whatever loads them."""

import json
import shutil
from dataclasses import replace
from itertools import zip_longest
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from rich.console import Console
from torch.utils.data import DataLoader

from robosim import FrameDataset, LinkDataset
from robosim.datasets import torch_data
from robosim.datasets.collect import CollectConfig, collect
from robosim.datasets.link_units import LinkSetConfig
from robosim.datasets.links import make_dataset
from tests.plans import room, two_rooms
from wireless.formats.link_records import read_links
from wireless.linkstate.data import LinkTable


@pytest.fixture(scope="module")
def links(tmp_path_factory):
    """Two buildings, two transmitters in each, receivers a metre apart."""
    folder = tmp_path_factory.mktemp("links")
    plans = [replace(two_rooms(0.8), name="b"), replace(room(4.0, 3.0), name="a")]
    make_dataset(plans, LinkSetConfig(tx_per_plan=2, grid_m=1.0), folder)
    return folder


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames")
    return collect(CollectConfig(homes=2, steps=5), folder, workers=1, console=Console(quiet=True))


def rows_of(batches):
    """Links of batches one by one, as (building, position, position of the transmitter)."""
    keys = ("building", "position", "tx_position")
    return [
        (int(building), *position.tolist(), *tx_position.tolist())
        for batch in batches
        for building, position, tx_position in zip(*(batch[key] for key in keys), strict=True)
    ]


def test_links_are_those_of_the_files(links):
    """Row by row: estimated paths with their mask, sorted by SNR, and the true state; no NaN; batches of the size."""
    data = LinkDataset(links, batch_size=7)
    assert data.columns == ("aoa", "aod", "snr", "delay") and data.buildings == ("a", "b")
    batches = list(data)
    assert len(batches) == len(data) == -(-data.links // 7)
    assert [len(batch["state"]) for batch in batches[:-1]] == [7] * (len(data) - 1)
    column = {name: torch.cat([batch[name] for batch in batches]) for name in batches[0]}
    assert torch.isfinite(column["paths"]).all() and column["paths"].shape == (data.links, 5, 4)
    row = 0
    for name in ("b", "a"):
        for tx in (1, 2):
            records = read_links(links / "links" / f"{name}_Tx_{tx}.parquet")
            for i in range(len(records.state)):
                link, count = {key: c[row] for key, c in column.items()}, int(records.estimates.count[i])
                assert int(link["state"]) == records.state[i]
                assert data.buildings[int(link["building"])] == name
                assert link["mask"].tolist() == [True] * count + [False] * (5 - count)
                assert not link["paths"][count:].any()
                np.testing.assert_allclose(
                    link["paths"][:count, 0], records.estimates.aoa_rad[i, :count], rtol=1e-6
                )
                np.testing.assert_allclose(
                    link["paths"][:count, 2], records.estimates.snr_db[i, :count], rtol=1e-6
                )
                np.testing.assert_allclose(link["position"], records.rx_position[i, :2], rtol=1e-6)
                row += 1
    assert row == data.links


def test_links_of_some_buildings_can_be_held_out(links):
    """Parts by building are apart, and make up the whole; an unknown one is named."""
    whole, a, b = LinkDataset(links), LinkDataset(links, buildings=["a"]), LinkDataset(links, buildings=["b"])
    assert a.links + b.links == whole.links and 0 < a.links < whole.links
    assert {building for building, *_ in rows_of(a)} == {0}
    with pytest.raises(ValueError, match=r"buildings has c, which .* has not\. It has a, b"):
        LinkDataset(links, buildings=["c"])
    with pytest.raises(ValueError, match="batch_size is 0, expected"):
        LinkDataset(links, batch_size=0)


@pytest.mark.parametrize("batch_size", [1, 3, 5])
@pytest.mark.parametrize("buffer", [1, 6, 1000])
def test_links_are_shuffled_by_seed_and_epoch(links, batch_size, buffer):
    """All links once, in an order that seed and epoch change; only the last batch is smaller."""
    data = LinkDataset(links, batch_size=batch_size, seed=4, buffer=buffer)
    in_order, first = rows_of(LinkDataset(links)), rows_of(data)
    assert sorted(first) == sorted(in_order) and first != in_order
    assert rows_of(data) == first
    data.epoch = 1
    second = rows_of(data)
    assert sorted(second) == sorted(in_order) and second != first
    assert rows_of(LinkDataset(links, batch_size=batch_size, seed=5, buffer=buffer)) not in (first, second)
    sizes = [len(batch["state"]) for batch in data]
    assert sizes[:-1] == [batch_size] * (len(data) - 1) and 1 <= sizes[-1] <= batch_size


def batches_of(data, worker, workers, monkeypatch):
    """Batches that one of several workers of a loader gives."""
    info = SimpleNamespace(id=worker, num_workers=workers)
    with monkeypatch.context() as patch:
        patch.setattr(torch_data, "get_worker_info", lambda: info)
        return list(data)


@pytest.mark.parametrize("seed", [None, 7])
def test_links_come_in_one_order_with_any_number_of_workers(links, seed, monkeypatch):
    """From a real loader, and as one takes turns with others; also where that number does not divide the streams."""
    data = LinkDataset(links, batch_size=3, seed=seed, buffer=6)
    loader = DataLoader(data, batch_size=None, num_workers=2)
    assert len(loader) == len(data) and rows_of(loader) == rows_of(data)
    for workers in (3, 5, 24):
        each = [batches_of(data, worker, workers, monkeypatch) for worker in range(workers)]
        turns = [batch for turn in zip_longest(*each) for batch in turn if batch is not None]
        assert rows_of(turns) == rows_of(data)


def test_links_are_read_when_they_are_needed(links, monkeypatch):
    """Each row is read once, by three workers too; before the first batch no more than a buffer."""
    reads, read = [], LinkTable.read

    def counted(table, rows):
        reads.append((table.file.name, rows))
        return read(table, rows)

    data = LinkDataset(links, batch_size=2, seed=1, buffer=4)
    monkeypatch.setattr(LinkTable, "read", counted)
    batches = iter(data)
    next(batches)
    assert sum(len(rows) for _, rows in reads) == 4
    list(batches)
    assert sum(len(rows) for _, rows in reads) == data.links
    reads.clear()
    for worker in range(3):
        batches_of(data, worker, 3, monkeypatch)
    assert sum(len(rows) for _, rows in reads) == data.links


def test_tables_that_differ_from_their_manifest_are_named(links, tmp_path):
    """A table of another building, and one of fewer rows than listed."""
    folder = shutil.copytree(links, tmp_path / "links")
    shutil.copy(folder / "links" / "a_Tx_1.parquet", folder / "links" / "b_Tx_1.parquet")
    with pytest.raises(ValueError, match=r"b_Tx_1\.parquet.*(rows|links of 'a')"):
        list(LinkDataset(folder))
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["units"][0]["rows"] = 0
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match=r"manifest\.json.*rows of links/b_Tx_1\.parquet is 0"):
        LinkDataset(folder)


def test_frames_are_those_of_the_files(shards):
    """Home by home, row by row; millimetres become metres, bytes probabilities, bits truth values."""
    data = FrameDataset(shards[0].parent)
    assert len(data) == 10 and data.shards == shards
    for i in (0, 4, 5, 9, -1):
        frame = data[i]
        home, row = divmod(i % 10, 5)
        with open(shards[home], "rb") as file, np.load(file) as stored:
            np.testing.assert_allclose(frame["depth"][0], stored["depth"][row] / 1000, rtol=1e-6)
            np.testing.assert_array_equal(frame["rgb"].permute(1, 2, 0), stored["rgb"][row])
            assert int(frame["action"]) == stored["action"][row] and int(frame["home"]) == home
            np.testing.assert_array_equal(frame["pose"], stored["pose"][row])
            np.testing.assert_allclose(frame["belief"][0], stored["belief"][row] / 255, rtol=1e-6)
            np.testing.assert_array_equal(np.packbits(frame["truth"].numpy(), axis=-1), stored["truth"][row])
    with pytest.raises(IndexError, match="frame 10 of 10"):
        data[10]


def test_a_loader_gives_frames_the_same_each_time(shards):
    """In order without shuffling; with one seed in one order; however few homes are cached."""
    few, all_of_them = FrameDataset(shards, cached_homes=1), FrameDataset(shards, keys=("depth", "action"))
    (batch,) = DataLoader(all_of_them, batch_size=10)
    assert set(batch) == {"depth", "action", "home"}
    assert batch["home"].tolist() == [0] * 5 + [1] * 5
    seen = []
    for data in (few, all_of_them):
        order = torch.Generator().manual_seed(3)
        (mixed,) = DataLoader(data, batch_size=10, shuffle=True, generator=order)
        seen.append(mixed["depth"])
    assert torch.equal(*seen) and not torch.equal(seen[0], batch["depth"])


def test_missing_frames_are_reported(tmp_path, shards):
    """An empty folder, a damaged file and an unknown key: one line with the name."""
    with pytest.raises(ValueError, match=r"no home-\*\.npz\. Collect some"):
        FrameDataset(tmp_path)
    with pytest.raises(ValueError, match="keys has colour, expected some of depth, rgb"):
        FrameDataset(shards, keys=["colour"])
    (tmp_path / "home-00000.npz").write_bytes(shards[0].read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"home-00000\.npz"):
        FrameDataset(tmp_path)
