"""Figures of the search: what they find in the episodes, and what they show of it."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from PIL import Image

from robosim.episode import EpisodeConfig
from robosim.evaluation.scores import score
from robosim.evaluation.suite import Suite, SuiteTask, write_suite
from robosim.plans.files import write_ros
from robosim.support.files import write_json
from tests import kept
from tests.benchmarks.search_figures import (
    PUBLISHED_RATES,
    _arrival,
    _rows,
    draw_search,
    find_example,
    longest_stay,
)
from tests.plans import two_rooms
from wireless.paths import LinkState

TARGET = (5.0, 2.0)


def _episode(folder, task, policy, steps, *, arrives=True, state=LinkState.HIGHER_ORDER, waits=0):
    """A robot that goes straight to the target, after a number of decisions at its start."""
    row = kept.row("pair", task, policy, TARGET, steps=steps, arrived=arrives)
    way = np.linspace([1.0, 0.6], TARGET, steps + 1 - waits)
    poses = np.column_stack([np.vstack([way[:1].repeat(waits, axis=0), way]), np.zeros(steps + 1)])
    links = np.column_stack([np.full(steps, state), *np.zeros((3, steps))])
    path = folder / "episodes" / "pair" / f"{task:03d}-{policy}-0.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    head = {"row": row, "timing": {"wall": 1.0}, "made_by": ""}
    uses_radio = policy != "oracle"
    np.savez(path, head=np.array(json.dumps(head)), poses=poses, estimates=poses, goals=poses[:, :2],
             coverage=np.ones(steps + 1), links=links if uses_radio else links[:0],
             built=np.zeros((0, 0), np.uint8), built_frame=np.zeros(3))  # fmt: skip


@pytest.fixture
def results(tmp_path):
    """Four tasks: a start in sight where snr waits longest, two of higher order, one that snr does better."""
    file = tmp_path / "plans" / "pair.yaml"
    write_ros(two_rooms(0.8), file)
    tasks = tuple(SuiteTask(plan="pair", number=i, start=(1.0, 0.6, 0.0), target=TARGET) for i in range(4))
    folder = tmp_path / "results"
    write_suite(Suite(plans={"pair": file}, tasks=tasks), folder / "suite.yaml")
    write_json(
        folder / "settings.json", {"command": "evaluate", "settings": {"episode": asdict(EpisodeConfig())}}
    )
    for task in range(4):
        _episode(folder, task, "oracle", 20 + task)
    _episode(folder, 0, "snr", 90, state=LinkState.LOS, waits=70)
    _episode(folder, 1, "snr", 60, waits=10)
    _episode(folder, 2, "snr", 80, arrives=False, waits=40)
    _episode(folder, 3, "snr", 95, waits=60)
    for task, steps in enumerate([30, 30, 30, 99]):
        _episode(folder, task, "los-or-first", steps)
    return folder


def test_the_longest_stay_is_the_one_planted():
    """Ten decisions on, 25 to and fro within half a metre, ten on: it begins where the robot comes to the place."""
    to_and_fro = 2.0 + 0.2 * (np.arange(25) % 2)
    x = np.concatenate([np.arange(0, 2, 0.2), to_and_fro, np.arange(2.8, 4.8, 0.2)])
    first, stayed = longest_stay(np.column_stack([x, 0 * x]), 0.5)
    assert 8 <= first <= 10
    assert 25 <= stayed <= 27
    assert longest_stay(np.zeros((1, 2)), 0.5) == (0, 0)


def test_the_example_starts_in_higher_order_and_is_done_sooner_by_the_other(results):
    """Not task 0, which starts in sight, nor 3, which following does sooner: of 1 and 2 the longer stay."""
    example = find_example(results, score(_rows(results)), "snr", "los-or-first")
    assert example.stuck.head.row["task"] == example.better.head.row["task"] == 2
    assert example.stuck.head.row["policy"] == "snr"
    assert 40 <= example.stay[1] <= 60


def test_published_rates_stand_over_the_bars_of_their_policies(results):
    """Two policies with published rates in three classes: six diamonds, each within its policy's bar."""
    axes = _arrival(score(_rows(results))).axes[0]
    x, y = axes.lines[-1].get_data()
    assert sorted(y) == sorted(PUBLISHED_RATES["snr"] + PUBLISHED_RATES["los-or-first"])
    bars = {policy.get_label(): policy.patches for policy in axes.containers if hasattr(policy, "patches")}
    for policy, places in (("snr", x[:3]), ("los-or-first", x[3:])):
        for place, bar in zip(places, bars[policy], strict=False):
            assert bar.get_x() < place < bar.get_x() + bar.get_width()


def test_all_figures_are_drawn_and_shown(results, tmp_path):
    page, notes = draw_search(results, tmp_path / "figures")
    shown = page.read_text()
    for name in ("search_arrival", "search_times", "search_example"):
        assert f'src="{name}.png"' in shown
        with Image.open(tmp_path / "figures" / f"{name}.png") as picture:
            assert min(picture.size) > 300
    assert notes == ["12 episodes of 4 tasks in 1 plan."]


def test_without_an_example_the_others_are_drawn_and_it_is_said(results, tmp_path):
    for task in (1, 2):
        (results / "episodes" / "pair" / f"{task:03d}-los-or-first-0.npz").unlink()
    page, notes = draw_search(results, tmp_path / "figures")
    assert "No example" in notes[1]
    assert "search_times" in page.read_text()
    assert "search_example" not in page.read_text()


def test_a_folder_without_episodes_is_told(tmp_path):
    with pytest.raises(ValueError, match=r"no episodes\. Expected a folder of `robosim evaluate`"):
        draw_search(tmp_path, tmp_path)
