"""The learned pose: its loss, its training pairs, and how it combines with odometry."""

import math

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal

from slam.learning.pose import Pairs, PoseRecipe, batch_of, pose_scores, surprise, train_pose
from slam.mapping.learned_matching import LearnedMatchConfig, LearnedMatcher
from slam.mapping.occupancy import OccupancyGrid
from slam.networks.pose_network import SPREAD, UNIT, PoseNetwork, PoseNetworkConfig
from slam.poses import compose
from slam.sensing.egocentric import AHEAD, cut_ahead
from slam.sensing.projection import Scan

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_the_loss_is_the_density_of_a_normal():
    """Against SciPy's for ten random means and matrices, up to its constant: to 1e-5."""
    rng = np.random.default_rng(0)
    offset, true = rng.normal(size=(2, 10, 3))
    root = np.tril(rng.normal(size=(10, 3, 3)), -1) + np.apply_along_axis(
        np.diag, 1, np.exp(rng.normal(size=(10, 3)))
    )
    expected = [
        -multivariate_normal(offset[k], np.linalg.inv(root[k] @ root[k].T)).logpdf(true[k]) for k in range(10)
    ]
    got = surprise(*(torch.from_numpy(x) for x in (offset, root, true)))
    assert float(got) == pytest.approx(np.mean(expected) - 1.5 * math.log(2 * math.pi), abs=1e-5)


def _pairs(count: int, seed: int = 0) -> Pairs:
    """A corner of two walls seen as it is: where the map is cut off the true pose, both do not fit."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(AHEAD.shape)
    beliefs, scans, displacements = [], [], []
    for _ in range(count):
        wall = (np.abs(x - rng.integers(30, 50)) < 2) | (np.abs(y - rng.integers(15, 50)) < 2)
        belief = np.where(wall, 127, -127).astype(np.int8)
        step = rng.normal([0.1, 0, 0], [0.1, 0.05, 0.05])
        seen = cut_ahead(belief.astype(np.float32), AHEAD, step, beyond=0.0).astype(np.int8)
        beliefs.append(belief)
        scans.append(np.stack([seen] * 4))
        displacements.append(step)
    return Pairs(scan=np.array(scans), belief=np.array(beliefs), displacement=np.array(displacements))


def test_pairs_fit_once_the_offset_is_undone():
    """The map cut at the predicted pose, moved by the offset, is the scan again, but for two interpolations.

    Mean absolute difference away from the border below 0.12 of the full scale; with the sign of the offset turned it is
    twice that.
    """
    pairs = _pairs(40)
    patches, offsets = batch_of(pairs, np.arange(40), np.random.default_rng(1))
    off = {1: [], -1: []}
    for patch, offset in zip(patches.numpy(), offsets.numpy().astype(float) * UNIT, strict=True):
        for sign, gaps in off.items():
            again = cut_ahead(patch[4], AHEAD, sign * offset, beyond=0.0)
            gaps.append(np.abs(again - patch[0])[12:-12, 12:-12].mean())
    assert np.mean(off[1]) < 0.12
    assert np.mean(off[-1]) > 2 * np.mean(off[1])


def test_it_learns_the_offset():
    """300 batches of clean corners: less than 0.6 of the error in place is left, and half of that in heading."""
    size = PoseNetworkConfig(widths=(8, 16, 16, 32), hidden=32)
    recipe = PoseRecipe(network=size, steps=300, batch=32, rate=3e-3)
    network, curve = train_pose(_pairs(200), recipe)
    scores = pose_scores(network, _pairs(60, seed=1))
    assert curve[-1]["loss"] < curve[0]["loss"]
    assert scores["estimated_m"] < 0.6 * scores["predicted_m"]
    assert scores["estimated_deg"] < 0.5 * scores["predicted_deg"]
    assert 0.5 < scores["consistency"] < 2
    twice = [train_pose(_pairs(20), PoseRecipe(network=size, steps=5, batch=4))[0] for _ in range(2)]
    for a, b in zip(*(network.parameters() for network in twice), strict=True):
        assert torch.equal(a, b)


class _Says(PoseNetwork):
    """Answers with a given mean and information, whatever it is shown."""

    def __init__(self, mean: np.ndarray, information: np.ndarray) -> None:
        unit = np.diag(UNIT)
        self.answer = mean / UNIT, np.linalg.cholesky(unit @ information @ unit)

    def __call__(self, patches):
        return tuple(value[None] for value in self.answer)


def _match(network: PoseNetwork, predicted: np.ndarray, covariance: np.ndarray, trust: float = 1.0):
    occupancy = OccupancyGrid(AHEAD)
    occupancy.probability[:] = 0.2
    nothing = np.zeros(8, np.float32)
    left = np.linspace(1, -1, 8).astype(np.float32)
    far = np.full(8, np.inf, np.float32)
    scan = Scan(left=left, depth_m=far, clear_m=nothing, top_m=nothing, far_m=far)
    matcher = LearnedMatcher(network, LearnedMatchConfig(trust=trust))
    return matcher.match(scan, occupancy, predicted, covariance)


def test_network_and_odometry_combine_as_normals():
    """The network gives the posterior of a likelihood and its training prior; odometry has another, rotated prior.

    The result is the product of that prior and the likelihood in closed form: to 1e-5.
    """
    rng = np.random.default_rng(2)
    mixing = rng.normal(size=(3, 3)) * 30
    likelihood, seen = mixing @ mixing.T + 500 * np.eye(3), np.array([0.03, -0.02, 0.01])
    training = np.diag(1 / np.array(SPREAD) ** 2)
    mean = np.linalg.solve(likelihood + training, likelihood @ seen)
    covariance = np.diag([0.01, 0.02, 0.015]) ** 2
    predicted = np.array([0.4, 0.1, math.pi / 2])
    got = _match(_Says(mean, likelihood + training), predicted, covariance)
    prior = np.linalg.inv(TURN.T @ covariance @ TURN)
    offset = np.linalg.solve(likelihood + prior, likelihood @ seen)
    np.testing.assert_allclose(got.pose, compose(predicted, offset), atol=1e-5)
    np.testing.assert_allclose(got.information, TURN @ likelihood @ TURN.T, rtol=1e-4, atol=1)


def test_a_network_that_knows_nothing_leaves_the_prediction():
    """Its answer is the training prior: no information, and the predicted pose to 1e-9."""
    predicted = np.array([0.4, 0.1, 1.0])
    got = _match(_Says(np.zeros(3), np.diag(1 / np.array(SPREAD) ** 2)), predicted, np.diag([1e-4] * 3))
    np.testing.assert_allclose(got.pose, predicted, atol=1e-9)
    assert np.abs(got.information).max() < 1.0
