"""Reasons of goals, and decisions for paths."""

import numpy as np
import pytest

from robosim.policies.estimates import Estimates
from robosim.policies.goals import PolicyContext, make_policy
from robosim.policies.reason import GoalKind, decisions_along
from robosim.simulator import Observation
from slam.exploration.explorer import FrontierExplorer
from slam.grid import GridFrame, MapEstimate


@pytest.mark.parametrize(
    ("path", "yaw", "expected"),
    [
        ([[0, 0], [1, 0]], 0.0, 4.0),
        ([[0, 0], [1, 0]], np.pi / 2, 4.0 + 9.0),
        ([[0, 0], [1, 0], [1, 0], [1, -0.5]], 0.0, 6.0 + 9.0),
        ([[0, 0], [-1, 0]], 3.0, 4.0 + (np.pi - 3.0) / np.radians(10)),
        ([[2, 3]], 1.0, 0.0),
    ],
)
def test_a_path_takes_its_steps_and_turns(path, yaw, expected):
    """By hand: 0.25 m a step, 10 degrees a turn; turns take the shorter side."""
    assert decisions_along(np.array(path, float), yaw) == pytest.approx(expected)


def _knowledge(target=None):
    frame = GridFrame(origin_xy=(-3.0, -3.0), shape=(120, 120))
    explored = np.zeros(frame.shape, bool)
    explored[40:80, 40:80] = True
    map_ = MapEstimate(
        frame=frame,
        obstacle_probability=np.full(frame.shape, 0.1, np.float32),
        explored=explored,
        blocked=np.zeros(frame.shape, bool),
        pose=np.zeros(3),
    )
    sensed = Observation(np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0)), np.zeros(3), target=target)
    return sensed, Estimates(map_)


def test_policies_give_the_kind_of_their_goal():
    """The oracle knows, `explore` goes to the map's edge, `visual` changes its reason when it sees the target."""
    context = PolicyContext(explorer=FrontierExplorer(), target=np.array([1.0, 0.0]))
    oracle, explore, visual = (make_policy(name, context) for name in ("oracle", "explore", "visual"))
    for policy in (oracle, explore, visual):
        policy.goal(*_knowledge())
    assert [p.reason.kind for p in (oracle, explore, visual)] == [
        GoalKind.KNOWN, GoalKind.EXPLORE, GoalKind.EXPLORE,
    ]  # fmt: skip
    visual.goal(*_knowledge(target=np.array([1.0, 0.0])))
    assert visual.reason.kind is GoalKind.SEEN
