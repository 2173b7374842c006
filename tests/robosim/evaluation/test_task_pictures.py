"""The picture of a task: both trajectories, walls, and kinds of goals."""

import matplotlib.pyplot as plt
import numpy as np

from robosim.evaluation.task_picture import GOAL_COLOURS, trajectories_figure
from robosim.policies.reason import ARRIVAL, EXPLORE, GoalKind
from tests import stored_episodes
from tests.steps import write_episode
from wireless.paths import LinkState

RING = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [0.0, 3.0]])


def _episode(folder, policy, steps, *, arrived=True):
    row = stored_episodes.row("pair", 0, policy, (5.0, 2.0), steps=steps, arrived=arrived)
    poses = np.column_stack([np.linspace(1.0, 5.0, steps + 1), np.full(steps + 1, 1.5), np.zeros(steps + 1)])
    return write_episode(
        folder / f"{policy}.npz", row, poses, state=LinkState.LOS, estimated_state=LinkState.HIGHER_ORDER,
        reasons=[EXPLORE] * (steps // 2) + [ARRIVAL] * (steps - steps // 2), rings=[RING],
    )  # fmt: skip


def test_both_trajectories_are_on_one_map(tmp_path):
    one, other = _episode(tmp_path, "fused", 60), _episode(tmp_path, "snr", 25, arrived=False)
    figure = trajectories_figure([one, other])
    plan, below = figure.axes
    drawn = {line.get_label(): line.get_xydata() for line in plan.lines}
    np.testing.assert_allclose(drawn["fused: arrives at 60"], one.poses[:, :2])
    np.testing.assert_allclose(drawn["snr: out of steps at 25"], other.poses[:, :2])
    assert [text.get_text() for text in plan.texts if text.get_text().isdigit()] == ["50"], (
        "of 60 and 25 decisions"
    )
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "true walls" in names
    assert names[-5:] == [
        "estimated link state:",
        "higher-order NLOS",
        "goal:",
        "arrival followed",
        "map's edge",
    ]
    lengths = [image.get_array().shape[1] for image in below.images]
    assert lengths == [60, 60, 25, 25]
    plt.close(figure)


def test_kinds_of_goals_have_different_colours():
    """A colour for each kind, all different."""
    assert set(GOAL_COLOURS) == set(GoalKind)
    assert len(set(GOAL_COLOURS.values())) == len(GoalKind)
