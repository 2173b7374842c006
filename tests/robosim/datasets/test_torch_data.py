"""Data sets for PyTorch: every example is what the files say, in their order, whatever loads them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console
from torch.utils.data import DataLoader

from robosim import FrameDataset, LinkDataset
from robosim.datasets.collect import CollectConfig, collect
from robosim.datasets.link_units import LinkSetConfig
from robosim.datasets.links import make_dataset
from tests.plans import room, two_rooms
from wireless.formats.link_records import read_links


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


def test_links_are_those_of_the_files(links):
    """Row by row: estimated paths with their mask, sorted by SNR, and the true state."""
    data = LinkDataset(links)
    assert data.columns == ("aoa", "aod", "snr", "delay") and data.buildings == ("a", "b")
    row = 0
    for name in ("b", "a"):
        for tx in (1, 2):
            records = read_links(links / "links" / f"{name}_Tx_{tx}.parquet")
            for i in range(len(records.state)):
                link, count = data[row], int(records.estimates.count[i])
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
    assert row == len(data)


def test_links_of_some_buildings_can_be_held_out(links):
    """Parts by building are apart, and make up the whole; an unknown one is named."""
    whole, a, b = LinkDataset(links), LinkDataset(links, buildings=["a"]), LinkDataset(links, buildings=["b"])
    assert len(a) + len(b) == len(whole) and 0 < len(a) < len(whole)
    assert {int(link["building"]) for link in a} == {0}
    with pytest.raises(ValueError, match=r"buildings has c, which .* has not\. It has a, b"):
        LinkDataset(links, buildings=["c"])


def test_a_loader_gives_links_in_batches(links):
    """Stacked along a new first axis, in order, all of them, no NaN."""
    data = LinkDataset(links)
    batches = list(DataLoader(data, batch_size=7))
    assert batches[0]["paths"].shape == (7, 5, 4) and batches[0]["mask"].dtype == torch.bool
    assert torch.isfinite(torch.cat([batch["paths"] for batch in batches])).all()
    states = torch.cat([batch["state"] for batch in batches])
    assert states.tolist() == [int(link["state"]) for link in data]


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
