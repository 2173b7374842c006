"""Grids of links traced piece by piece: the same as in one go, whatever happens in between."""

from dataclasses import fields
from functools import partial

import numpy as np
import pytest

from robosim.building.building import BuildingConfig
from robosim.datasets import trace
from robosim.datasets.trace import trace_grid
from robosim.radio.receivers import receiver_grid
from robosim.radio.scene import RadioConfig, RadioScene
from tests.plans import two_rooms
from wireless import Paths

pytestmark = pytest.mark.usefixtures("in_process")
CONFIG, GRID_M = RadioConfig(), 0.5
TX = np.array([[1.0, 1.4, 1.5], [4.0, 2.1, 1.2], [5.5, 0.6, 1.5]])


@pytest.fixture(autouse=True, scope="module")
def small_units():
    """Some units of receivers, the last one smaller, for each of three transmitters."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trace, "UNIT_RX", 16)
        yield


@pytest.fixture(scope="module")
def scene():
    return RadioScene(two_rooms(0.8), CONFIG)


@pytest.fixture(scope="module")
def rx(scene):
    return receiver_grid(scene.building, GRID_M, CONFIG.height_m).position


@pytest.fixture
def links(rx):
    return partial(trace_grid, two_rooms(0.8), CONFIG, TX, rx)


def same(a: Paths, b: Paths) -> bool:
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name == "point")
        for f in fields(Paths)
    )


def test_units_joined_are_the_paths_traced_at_once(links, scene, rx, tmp_path):
    """All columns bit for bit, in the same order, though no unit knew of the others' receivers."""
    assert len(rx) % 16
    path = links(tmp_path, workers=1)
    at_once = scene.tracer.trace(TX, rx)
    assert same(Paths.read_parquet(path), at_once)
    assert not (tmp_path / "units").exists()
    for i in range(3):
        assert same(Paths.read_parquet(path, i), at_once.select(at_once.tx == i))


def test_an_interrupted_run_goes_on_to_the_same_bytes(links, rx, tmp_path):
    """Stopped after any number of units, the second run traces only what is missing."""
    whole = links(tmp_path / "whole", workers=1).read_bytes()
    for stop_at in (1, 100, 3 * len(rx)):

        def stop(done, total, stop_at=stop_at):
            if done >= stop_at:
                raise KeyboardInterrupt

        folder = tmp_path / str(stop_at)
        with pytest.raises(KeyboardInterrupt):
            links(folder, workers=1, report=stop)
        reports = []
        path = links(folder, workers=1, report=lambda *done, reports=reports: reports.append(done))
        assert reports[0][0] >= stop_at
        assert reports[-1] == (3 * len(rx), 3 * len(rx))
        assert path.read_bytes() == whole


def test_a_finished_folder_is_not_traced_again(links, rx, tmp_path):
    path = links(tmp_path, workers=1)
    whole, reports = path.read_bytes(), []
    links(tmp_path, workers=1, report=lambda *done: reports.append(done))
    assert reports == [(3 * len(rx), 3 * len(rx))]
    assert path.read_bytes() == whole


def test_a_digest_changes_with_the_building(scene):
    """A door that is narrower, another material: each has its own digest."""
    others = [
        RadioScene(two_rooms(0.6), CONFIG),
        RadioScene(two_rooms(0.8), RadioConfig(building=BuildingConfig(wall_material="concrete"))),
    ]
    assert len({scene.digest, *(other.digest for other in others)}) == 3
    assert RadioScene(two_rooms(0.8), CONFIG).digest == scene.digest
