"""The neural mapper: its answers averaged into a map that lies where the robot is, whatever the camera does."""

import numpy as np
import pytest
import torch

from slam.actions import Action
from slam.learning.map_module import MapModule
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.mapping.neural import FusionConfig, NeuralMapper
from slam.networks.map_network import MapNetwork, NetworkConfig
from slam.poses import to_map
from tests.slam.rooms import Room

POSE = np.array([0.3, -0.2, 0.6])


def saying(obstacle: float, seen: float) -> MapNetwork:
    """A network that always says the same log-odds."""
    module = MapModule(NetworkConfig(widths=(4,)))
    with torch.no_grad():
        module.last.weight.zero_()
        module.last.bias.copy_(torch.tensor([obstacle, seen]))
    return module.network()


def mapper(obstacle: float, seen: float, **config) -> NeuralMapper:
    made = NeuralMapper(saying(obstacle, seen), config=MapperConfig(**config))
    made.reset(POSE)
    return made


def ahead(estimate, low_x=0.4, high_x=3.1, half_y=1.5) -> np.ndarray:
    """Whether each cell of the map lies well inside of the patch ahead of the pose."""
    centres = estimate.frame.centres(np.ones(estimate.frame.shape, bool)) - estimate.pose[:2]
    c, s = np.cos(estimate.pose[2]), np.sin(estimate.pose[2])
    x, y = centres @ (c, s), centres @ (-s, c)
    return ((x > low_x) & (x < high_x) & (np.abs(y) < half_y)).reshape(estimate.frame.shape)


def test_an_answer_in_view_becomes_the_map():
    """Log-odds 2 in view: probability 1 / (1 + exp(-2)) in all cells ahead, in both maps; behind, the classical map."""
    got = mapper(2.0, 4.0).update(Room().depth(POSE))
    inside = ahead(got)
    expected = 1 / (1 + np.exp(-2))
    np.testing.assert_allclose(got.obstacle_probability[inside], expected, atol=1e-6)
    np.testing.assert_allclose(got.anticipated_probability[inside], expected, atol=1e-6)
    classical = ClassicalMapper()
    classical.reset(POSE)
    plain = classical.update(Room().depth(POSE))
    far = ~ahead(got, -0.2, 3.4, 1.8)
    assert (got.obstacle_probability[far] == plain.obstacle_probability[far]).all()
    assert (got.pose == plain.pose).all()


def test_a_guess_is_anticipated_only():
    """The same answer out of view: the observed map stays the classical one, the anticipated map takes it."""
    made = mapper(2.0, -4.0)
    got = made.update(Room().depth(POSE))
    inside = ahead(got)
    plain = made.classical.estimate().obstacle_probability
    assert (got.obstacle_probability[inside] == plain[inside]).all()
    np.testing.assert_allclose(got.anticipated_probability[inside], 1 / (1 + np.exp(-2)), atol=1e-6)


def test_answers_are_averaged():
    """First 2, then -1 with weight 0.5: log-odds 0.5. A wrong wall clears, where a maximum would keep it."""
    made = NeuralMapper(saying(2.0, 4.0), fusion=FusionConfig(in_view=0.5))
    made.reset(POSE)
    made.update(Room().depth(POSE))
    made._predictor._network = saying(-1.0, 4.0)
    got = made.update(Room().depth(POSE))
    np.testing.assert_allclose(got.obstacle_probability[ahead(got)], 1 / (1 + np.exp(-0.5)), atol=1e-5)
    for _ in range(10):
        got = made.update(Room().depth(POSE))
    np.testing.assert_allclose(got.obstacle_probability[ahead(got)], 1 / (1 + np.exp(1.0)), atol=1e-2)


def test_what_was_seen_is_not_given_up_for_a_guess():
    """In view first, out of view later: the map keeps what was seen."""
    made = mapper(-3.0, 4.0)
    before = made.update(Room().depth(POSE)).anticipated_probability.copy()
    made._predictor._network = saying(3.0, -4.0)
    after = made.update(Room().depth(POSE))
    inside = ahead(after)
    np.testing.assert_allclose(after.anticipated_probability[inside], before[inside], atol=1e-6)


def test_answers_lie_where_the_robot_looks():
    """A network that passes the map's belief on: obstacles of both maps are in the same cells, seen from a turned pose.

    Resampling to the patch and back blurs: nine in ten obstacles ahead have a classical one within a cell, and back.
    """
    from scipy.ndimage import binary_dilation

    from slam.networks.features import BELIEF

    def echo(x):
        return np.concatenate([8 * x[:, BELIEF : BELIEF + 1], np.full_like(x[:, :1], 4.0)], axis=1)

    made = NeuralMapper(saying(0.0, 0.0))
    made._predictor._network = echo
    made.reset(POSE)
    for _ in range(4):
        got = made.update(Room().depth(POSE))
    inside = ahead(got)
    plain = made.classical.estimate().obstacle
    predicted = got.obstacle & inside
    assert predicted.sum() > 40
    assert (predicted & binary_dilation(plain, np.ones((3, 3)))).sum() > 0.9 * predicted.sum()
    assert (plain & inside & binary_dilation(predicted, np.ones((3, 3)))).sum() > 0.9 * (plain & inside).sum()


def test_nothing_stands_where_the_robot_stands():
    """Even if the network says so everywhere."""
    made = mapper(5.0, 4.0)
    got = made.update(Room().depth(POSE))
    iy, ix = got.frame.index(POSE[:2])
    assert got.obstacle_probability[iy, ix] < 0.5 and got.anticipated_probability[iy, ix] < 0.5


def test_the_map_grows_without_moving():
    """A drive of 7 m out of the first map: what was entered at the start is still at its place in `map`."""
    hall = Room(low_xy=(-3.0, -2.0), high_xy=(14.0, 2.0))
    made = mapper(2.0, 4.0)
    made.reset(np.zeros(3))
    made._predictor._network = saying(2.0, 4.0)
    made.update(hall.depth(np.zeros(3)))
    first = made.frame
    spot = to_map(np.zeros(3), np.array([[1.5, 1.2]]))
    made._predictor._network = saying(-2.0, -4.0)
    pose = np.zeros(3)
    for _ in range(28):
        pose[0] += 0.25
        got = made.update(hall.depth(pose), Action.FORWARD, np.array([0.25, 0.0, 0.0]))
    assert got.frame.shape != first.shape
    iy, ix = got.frame.index(spot)
    assert got.anticipated_probability[iy[0], ix[0]] == pytest.approx(1 / (1 + np.exp(-2)), abs=1e-5)


@pytest.mark.parametrize("wild", [0.0, np.nan, np.inf])
def test_blind_for_a_hundred_frames(wild):
    """No NaN, and no growth of the map."""
    made = NeuralMapper(MapModule().network())
    made.reset(POSE)
    for _ in range(100):
        got = made.update(np.full((64, 64), wild, np.float32), Action.LEFT, np.array([0, 0, 0.17]))
    assert np.isfinite(got.anticipated_probability).all() and np.isfinite(got.obstacle_probability).all()
    assert got.frame.shape == (320, 320)
    with pytest.raises(ValueError, match="read-only"):
        got.anticipated_probability[0, 0] = 1
