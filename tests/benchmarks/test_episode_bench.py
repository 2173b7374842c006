"""The benchmark of whole episodes: what is varied, and how settings are compared."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from robosim.episode import EpisodeConfig
from robosim.plans.files import write_ros
from tests.benchmarks import episode
from tests.benchmarks.episode import DEFAULT, compare, run, table, variations
from tests.plans import two_rooms


def _leaves(value, name=""):
    if not isinstance(value, dict):
        return {name: value}
    return {k: v for key, item in value.items() for k, v in _leaves(item, f"{name}.{key}").items()}


def test_each_setting_changes_one_thing():
    """So that what a row differs in has one reason."""
    base = EpisodeConfig(goal="fused", max_steps=7)
    usual, changed = _leaves(asdict(base)), []
    for setting, config in variations(base).items():
        own = _leaves(asdict(config))
        different = [name for name in own if own[name] != usual[name]]
        assert len(different) == (setting != DEFAULT), setting
        changed += different
    assert {name.split(".")[-1] for name in changed} == {
        "camera",
        "physics",
        "mapper",
        "engine",
        "tolerance_m",
    }


def _told(steps, ms, arrived=True):
    return {"arrived": arrived, "steps": steps, "all_ms": ms, "stages_ms": {"radio": ms / 2, "rest": ms / 2}}


def test_arrival_times_are_compared_task_by_task():
    """50 and 200 steps against 100 and 100: half and twice cancel, though the sums are 250 against 200."""
    usual, other = compare(
        {
            DEFAULT: [_told(100, 10.0), _told(100, 30.0)],
            "x": [_told(50, 5.0), _told(200, 20.0, arrived=False)],
        }
    )
    assert usual.relative_steps == (1, 1, 1)
    assert other.relative_steps == pytest.approx((1.0, 0.5, 2.0))
    assert (other.arrived, other.episodes) == (1, 2)
    assert usual.decisions_per_s == pytest.approx(np.mean([100, 1000 / 30]))
    assert other.relative_speed == pytest.approx(np.median([2.0, 1.5]))
    cells = {str(column.header): list(column.cells)[1] for column in table([usual, other]).columns}
    assert (cells["setting"], cells["arrived"], cells["speed"], cells["steps"]) == (
        "x",
        "1 of 2",
        "1.75",
        "125",
    )
    assert (cells["relative steps"], cells["rest"]) == ("1.00 [0.50, 2.00]", "6.2")
    assert other.stages_ms["radio"] == pytest.approx(6.25)


def test_all_settings_are_run_once_and_kept(tmp_path, monkeypatch):
    """Six decisions of the oracle in two rooms; a second call runs nothing and comes to the same table."""
    write_ros(two_rooms(0.8), tmp_path / "pair.yaml")
    options = dict(goal="oracle", targets=1, seed=3, max_steps=6, console=Console(quiet=True))
    first = run([str(tmp_path / "pair.yaml")], out=tmp_path / "out", **options)
    rows = json.loads((tmp_path / "out" / "episode.json").read_text())["rows"]
    assert [row["setting"] for row in rows] == list(variations(EpisodeConfig()))
    assert all(row["episodes"] == 1 and row["decisions_per_s"] > 0 for row in rows)
    assert first.row_count == len(rows)
    with Image.open(tmp_path / "out" / "episode.png") as picture:
        assert min(picture.size) > 300
    monkeypatch.setattr(episode, "run_job", None)
    run([str(tmp_path / "pair.yaml")], out=tmp_path / "out", **options)
    assert json.loads((tmp_path / "out" / "episode.json").read_text())["rows"] == rows
