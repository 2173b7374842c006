"""Two commits compared: ratios of made times, and commits that do not exist."""

import numpy as np
import pytest

from tests.benchmarks import compare


def test_ratio_covers_a_slowdown_but_not_one(monkeypatch, tmp_path) -> None:
    """10 % more time, with noise of 1 % in each commit."""
    rng = np.random.default_rng(1)

    def run(tree):
        return {"trace": (1.1 if tree == compare.ROOT else 1.0) * (1 + rng.normal(0, 0.01))}

    monkeypatch.setattr(compare, "run", run)
    row = compare.main("HEAD", options=compare.Options(out=tmp_path)).rows[0]
    low, high = row["spread"]
    assert 1.0 < low < 1.1 < high < 1.2 and low <= row["value"] <= high


def test_main_runs_both_commits_in_turns(monkeypatch, tmp_path) -> None:
    """The first turn, which compiles, does not count; the order alternates."""
    calls: list[str] = []

    def run(tree):
        calls.append("here" if tree == compare.ROOT else "there")
        return {"trace": 2.0 if tree == compare.ROOT else 1.0 if len(calls) > 2 else 50.0}

    monkeypatch.setattr(compare, "run", run)
    results = compare.main("HEAD", turns=3, options=compare.Options(out=tmp_path))
    assert results.rows[0]["value"] == 2.0
    assert calls == ["there", "here", "here", "there"] * 2


def test_checkout_rejects_an_unknown_commit(tmp_path) -> None:
    with pytest.raises(ValueError, match="ref is 'no-such-commit'"):
        compare.checkout("no-such-commit", tmp_path / "other")
