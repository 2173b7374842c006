"""The learned local policy: its inputs are in the robot's frame, and its outputs are actions."""

import numpy as np
import pytest
from safetensors.numpy import save_file

from slam.actions import PUBLISHED
from slam.control.learned import INPUTS, LearnedController, initial_weights, load_steering
from slam.grid import GridFrame, MapEstimate
from slam.planning.planner import Planner


def corridor(pose):
    """A straight corridor 1 m wide along x, all known, from -3 to 3 m."""
    frame = GridFrame(origin_xy=(-3.0, -1.0), shape=(40, 120))
    probability = np.full(frame.shape, 0.1, np.float32)
    probability[:10] = probability[-10:] = 0.9
    return MapEstimate(
        frame=frame,
        obstacle_probability=probability,
        explored=np.ones(frame.shape, bool),
        blocked=np.zeros(frame.shape, bool),
        pose=np.array(pose, float),
    )


def controller():
    return LearnedController(initial_weights(np.random.default_rng(0)))


def senses(pose, goal):
    estimate = corridor(pose)
    return controller().senses(estimate.pose, Planner().plan(estimate, np.array(goal)))


def test_the_view_turns_with_the_robot():
    """In a symmetric corridor, a robot turned about with its goal behind it gets the same inputs.

    Cells are symmetric about the middle, so only rounding of the path over cells is left.
    """
    there, back = senses((0.0, 0.0, 0.0), (2.0, 0.0)), senses((0.0, 0.0, np.pi), (-2.0, 0.0))
    assert there.shape == (INPUTS,)
    np.testing.assert_allclose(there, back, atol=0.06)
    across = senses((0.0, 0.0, np.pi / 2), (2.0, 0.0))
    assert np.abs(across - there).max() > 0.5


def test_mirrored_inputs_are_mirrored():
    """A goal ahead on the left has y positive, on the right with y negative; x is ahead."""
    along = slice(121, 131)
    left = senses((0.0, 0.0, -0.6), (2.0, 0.0))[along].reshape(5, 2)
    right = senses((0.0, 0.0, 0.6), (2.0, 0.0))[along].reshape(5, 2)
    assert (left[:, 1] > 0.4).all() and (right[:, 1] < -0.4).all()
    np.testing.assert_allclose(left[:, 0], np.cos(0.6), atol=0.05)


@pytest.mark.parametrize("action", PUBLISHED)
def test_it_does_what_the_network_says(action):
    """Weights that answer one action alone, whatever the inputs, have it done; untrained parts add nothing."""
    weights = {name: np.zeros_like(w) for name, w in initial_weights(np.random.default_rng(0)).items()}
    weights["2.bias"][action] = 1.0
    estimate = corridor((0.0, 0.0, 0.3))
    plan = Planner().plan(estimate, np.array([2.0, 0.0]))
    assert LearnedController(weights).act(estimate.pose, plan) is action


def test_a_wrong_file_is_rejected(tmp_path):
    path = tmp_path / "steering.safetensors"
    save_file({"a": np.zeros(2, np.float32)}, path)
    with pytest.raises(
        ValueError, match=r"steering\.safetensors: not readable as weights .*`robosim train steering`"
    ):
        load_steering(path)
