"""Whether arrivals lead on: counted right in episodes made by hand."""

import numpy as np
import pytest

from robosim.building.building import BuildingConfig
from robosim.evaluation.suite import Suite
from robosim.plans.files import write_ros
from tests import stored_episodes
from tests.benchmarks.results import Results
from tests.benchmarks.search import EXPLORED, add_spl_ratios, progress
from tests.plans import room
from tests.steps import write_episode
from wireless.paths import LinkState

#: Decisions of each episode, and metres driven in each.
STEPS, STRIDE_M = 30, 0.05


@pytest.fixture
def counted(tmp_path):
    """Makes episodes in an empty room, where the route is the distance, and returns what is counted of them."""
    file = tmp_path / "hall.yaml"
    write_ros(room(8.0, 4.0), file)
    rows = []

    def add(policy, state, *, toward, ahead_m, snr_db=30.0):
        """Along y = 2 m, to the target at x = 7 m or away from it; a new goal every fifth decision."""
        x = 4.0 + toward * STRIDE_M * np.arange(STEPS + 1)
        poses = np.column_stack([x, np.full(STEPS + 1, 2.0), np.zeros(STEPS + 1)])
        goals = np.repeat(poses[:STEPS:5, :2] + (ahead_m, 0.0), 5, axis=0)
        row = stored_episodes.row("hall", len(rows), policy, (7.0, 2.0), steps=STEPS)
        path = tmp_path / "episodes" / "hall" / f"{len(rows):03d}-{policy}-0.npz"
        write_episode(path, row, poses, goals=goals, state=state, snr_db=snr_db)
        rows.append(row)

    def count():
        return progress(
            tmp_path, rows, Suite(plans={"hall": file}, tasks=()), BuildingConfig(), (0.1, 1.25, ())
        )

    return add, count


def test_progress_is_the_distance_driven_towards_the_target(counted):
    """Six goals; ten decisions later 0.5 m nearer, or farther, but the last has only five: 0.458 m on average."""
    add, count = counted
    add("los", LinkState.LOS, toward=1, ahead_m=0.6)
    add("snr", LinkState.HIGHER_ORDER, toward=-1, ahead_m=0.6)
    found = count()
    assert found["line of sight"] == pytest.approx([0.5] * 5 + [0.25], abs=0.02)
    assert found["higher order"] == pytest.approx([-0.5] * 5 + [-0.25], abs=0.02)


def test_only_what_was_followed_counts_and_exploring_is_listed(counted):
    """Goals at other places than 0.6 m ahead are the explorer's; weak paths are not followed."""
    add, count = counted
    add("snr", LinkState.FIRST_ORDER, toward=1, ahead_m=2.0)
    add("snr", LinkState.LOS, toward=1, ahead_m=0.6, snr_db=9.0)
    add("visual", LinkState.LOS, toward=1, ahead_m=0.6)
    assert count() == {}
    add("los-or-first", LinkState.HIGHER_ORDER, toward=1, ahead_m=2.0)
    found = count()
    assert set(found) == {EXPLORED}
    assert len(found[EXPLORED]) == STEPS


def test_add_spl_ratios_divides_means_of_common_tasks():
    """0.4 and 0.6 over 0.8 and 1.0 is 5/9; a task without `shortest` does not count."""
    rows = [
        {"policy": policy, "plan": "hall", "task": task, "difficulty": "easy", "spl": spl}
        for policy, scores in {"snr": (0.4, 0.6, 0.1), "shortest": (0.8, 1.0)}.items()
        for task, spl in enumerate(scores)
    ]
    results = Results()
    add_spl_ratios(rows, results)
    assert {row["name"] for row in results.rows} == {"all", "easy"}
    assert [row["value"] for row in results.rows] == pytest.approx([5 / 9] * 2)
    low, high = results.rows[0]["spread"]
    assert low == pytest.approx(0.5) and high == pytest.approx(0.6)
