"""Task by task: who is compared with whom, and which tasks stand first."""

import math

import pytest

from robosim.evaluation.search_scores import compared, subject_of
from tests import stored_episodes


def _row(task, policy, steps, arrived=True):
    return stored_episodes.row("pair", task, policy, (5.0, 2.0), steps=steps, arrived=arrived)


@pytest.mark.parametrize(
    ("policies", "subject"),
    [
        (["oracle", "snr", "fused"], "fused"),
        (["oracle", "shortest", "los", "snr"], "los"),
        (["oracle", "mine:Straight"], "mine:Straight"),
        (["oracle"], "oracle"),
    ],
)
def test_who_is_looked_at(policies, subject):
    assert subject_of(policies) == subject


def test_failures_stand_first_then_what_was_lost_most():
    """By hand: a failure that los avoids, one that no policy avoids, then 3, 2, 1 and 0.5 times as many steps."""
    rows = []
    for task, (fused, snr, los) in enumerate(
        [(30, 30, 90), (100, 50, None), (None, None, None), (25, 50, 60), (None, None, 80), (90, 30, 31)]
    ):
        rows.append(_row(task, "oracle", 10))
        for policy, steps in (("fused", fused), ("snr", snr), ("los", los)):
            rows.append(_row(task, policy, steps or 1000, steps is not None))
    found = compared(rows)
    assert [one.task for one in found] == [4, 2, 5, 1, 0, 3]
    assert [one.loss for one in found if not math.isnan(one.loss)] == [math.inf, 3.0, 2.0, 1.0, 0.5]
    rivals = [rows[one.rival]["policy"] for one in found]
    assert rivals == ["los", "snr", "snr", "snr", "snr", "snr"], "never the oracle, which knows the target"
    assert all(len(one.episodes) == 4 for one in found)


def test_the_oracle_is_the_rival_if_no_other_policy_was_run():
    rows = [_row(0, "oracle", 20), _row(0, "snr", 30), _row(1, "oracle", 20)]
    one, other = compared(rows)
    assert (rows[one.rival]["policy"], one.loss) == ("oracle", 1.5)
    assert other.subject is None and math.isnan(other.loss)
