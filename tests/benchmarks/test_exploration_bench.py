"""The scores of explorers, on curves and episodes whose scores are known."""

import json

import numpy as np
import pytest
from rich.console import Console

from tests.benchmarks import exploration
from tests.benchmarks.exploration import (
    DECISIONS,
    ExplorationSettings,
    area_under,
    gain_over,
    held,
    run,
    table,
)


def test_the_area_under_a_ramp_that_ends_half_way_is_three_quarters():
    """From 0 to 1 over 500 decisions, then held: 0.25 + 0.5, exactly; left at zero after the end it were 0.25."""
    curve = held(np.arange(501) / 500)
    assert len(curve) == DECISIONS + 1
    assert area_under(curve) == pytest.approx(0.75, abs=1e-12)


def test_a_curve_longer_than_the_score_is_cut():
    """What is seen after decision 1000 does not count."""
    assert held(np.append(np.zeros(DECISIONS + 1), np.ones(50))).max() == 0.0


def test_the_gain_is_paired_by_plan():
    """Twice the other's score on every plan: +100 % with no width at all, though the plans differ by a factor of 9."""
    other = np.array([0.1, 0.5, 0.9])
    assert gain_over(2 * other, other) == pytest.approx((1.0, 1.0, 1.0))
    more, low, high = gain_over(np.array([0.5, 0.7, 0.3]), np.array([0.5, 0.4, 0.6]))
    assert more == pytest.approx(0.0)
    assert low < -0.2 and high > 0.2


def test_the_table_says_by_how_much_the_first_is_exceeded():
    """Constant coverage of 0.8 against 0.5: area as such, +60 %. Three bumps in twice 25 m are 6 in 100 m."""
    rows = [
        {
            "explorer": name,
            "plan": plan,
            "coverage": held(np.array([seen])),
            "collisions": 1 if plan == "a" else 2,
            "path_length_m": 25.0,
            "decisions_per_s": 9,
        }
        for name, seen in (("nearest", 0.5), ("gain", 0.8))
        for plan in "ab"
    ]
    grid = table(rows)
    cells = [list(column.cells) for column in grid.columns]
    assert cells[0] == ["nearest", "gain"]
    assert cells[6] == ["0.5000", "0.8000"]
    assert cells[7][1].startswith("+60.0")
    assert cells[8] == ["6.0", "6.0"]


def test_a_run_writes_its_files_and_reads_kept_episodes(tmp_path, monkeypatch, in_process):
    """40 decisions, to be quick. A kept episode is not run again: a mark set in its file shows in the result."""
    monkeypatch.setattr(exploration, "DECISIONS", 40)
    monkeypatch.setattr(exploration, "MILESTONES", (10, 20, 40))
    settings = ExplorationSettings(mapper="classical", noise=0.0, physics="kinematic")
    options = {"explorers": ("nearest",), "workers": 1}
    rows = []
    for _ in range(2):
        run(["cottage"], settings, **options, out=tmp_path, console=Console(quiet=True))
        rows.append(json.loads((tmp_path / "exploration.json").read_text())["episodes"][0])
        kept = tmp_path / "episodes" / "cottage-nearest.json"
        row = json.loads(kept.read_text())
        kept.write_text(json.dumps({**row, "collisions": 77}))
    assert rows[1]["collisions"] == 77
    assert rows[0]["collisions"] != 77
    assert len(row["coverage"]) == 41
    assert {p.name for p in tmp_path.glob("*.png")} == {
        "exploration.png",
        "best.png",
        "median.png",
        "worst.png",
    }
