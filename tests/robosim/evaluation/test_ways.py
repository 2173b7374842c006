"""The picture of a task: both ways where they were driven, walls as they are, and what led them."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from robosim.evaluation.episode_file import Episode, Head
from robosim.evaluation.ways import GOAL_COLOURS, ways_figure
from robosim.policies.reason import ARRIVAL, EXPLORE, GoalKind
from tests import kept
from wireless.paths import LinkState

RING = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [0.0, 3.0]])


def _episode(policy, steps, *, arrived=True, rings=(RING,)) -> Episode:
    row = kept.row("pair", 0, policy, (5.0, 2.0), steps=steps, arrived=arrived)
    way = np.column_stack([np.linspace(1.0, 5.0, steps + 1), np.full(steps + 1, 1.5), np.zeros(steps + 1)])
    links = np.tile([float(LinkState.LOS), float(LinkState.HIGHER_ORDER), 20.0, 0.1], (steps, 1))
    return Episode(
        head=Head(row, {}, ""),
        poses=way.astype(np.float32),
        estimates=way.astype(np.float32),
        goals=way[:-1, :2].astype(np.float32),
        reasons=[EXPLORE] * (steps // 2) + [ARRIVAL] * (steps - steps // 2),
        decisions=np.ones(steps, np.float32),
        coverage=np.ones(steps + 1, np.float32),
        links=links.astype(np.float32),
        built=np.ones((4, 4), np.uint8),
        built_frame=np.array([0.0, 0.0, 1.0]),
        rings=list(rings),
    )


@pytest.mark.parametrize("rings", [(RING,), ()])
def test_both_ways_are_on_one_map(rings):
    one, other = _episode("fused", 60, rings=rings), _episode("snr", 25, arrived=False, rings=rings)
    figure = ways_figure([one, other])
    plan, below = figure.axes
    drawn = {line.get_label(): line.get_xydata() for line in plan.lines}
    np.testing.assert_allclose(drawn["fused: arrives at 60"], one.poses[:, :2])
    np.testing.assert_allclose(drawn["snr: out of steps at 25"], other.poses[:, :2])
    assert [text.get_text() for text in plan.texts if text.get_text().isdigit()] == ["50"], (
        "of 60 and 25 decisions"
    )
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("true walls" in names) == bool(rings)
    assert names[-5:] == [
        "link state as told:",
        "higher-order NLOS",
        "goal:",
        "arrival followed",
        "map's edge",
    ]
    lengths = [image.get_array().shape[1] for image in below.images]
    assert lengths == [60, 60, 25, 25]
    plt.close(figure)


def test_kinds_of_goals_are_told_apart():
    """A colour for each kind, all different."""
    assert set(GOAL_COLOURS) == set(GoalKind)
    assert len(set(GOAL_COLOURS.values())) == len(GoalKind)
