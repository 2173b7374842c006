"""Learned counterpart of scan matching: a network compares the scan with the map and estimates the pose.

The network was trained with poses predicted around ground truth with a known spread, so its output is a posterior that
includes that prior. The prior is replaced by the covariance that odometry predicts:

    Lambda = (L L^T - S^-1) + P^-1,    Lambda d = L L^T mu,

with mu and L from the network, S the spread in training, P the covariance of the prediction. Exact if both are normal;
negative eigenvalues are set to zero.
Errors of neighbouring frames are correlated, since they are compared with the same map: `trust` reduces their weight.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from robosim.support.checks import Range, checked
from slam.mapping.occupancy import OccupancyGrid
from slam.matching.scan_matching import Match
from slam.networks.features import Features
from slam.networks.pose_network import INPUTS, SPREAD, UNIT, PoseNetwork
from slam.poses import Covariance, Pose, compose, moved_ahead
from slam.sensing.egocentric import cut_ahead
from slam.sensing.projection import Scan


@dataclass(frozen=True, kw_only=True)
@checked
class LearnedMatchConfig:
    """How far the network is trusted."""

    trust: Annotated[float, Range(1e-6, 1)] = 0.1
    """Part of the information of the network that counts."""
    known: Annotated[float, Range(0, 1)] = 0.05
    """Share of the patch that must be known; with less the prediction stands."""


class LearnedMatcher:
    """Finds poses by a trained network."""

    def __init__(self, network: PoseNetwork, config: LearnedMatchConfig = LearnedMatchConfig()) -> None:
        """Take a trained network."""
        self._network, self.config = network, config
        self._features = Features()

    def match(self, scan: Scan, occupancy: OccupancyGrid, predicted: Pose, covariance: Covariance) -> Match:
        """The pose between what odometry predicts and what frame and map say."""
        unmatched = Match(pose=predicted.copy(), information=np.zeros((3, 3)), paired=np.zeros(0, bool))
        eye = moved_ahead(predicted, scan.ahead_m)
        belief = cut_ahead(occupancy.probability, occupancy.frame, eye)
        if np.mean(belief != 0.5) < self.config.known:
            return unmatched
        patches = np.empty((1, INPUTS, *belief.shape), np.float32)
        # The first four channels are the scan, the fifth is the belief.
        patches[0] = self._features.of_scan(scan, belief)[:INPUTS]
        offset_mean, root = (value[0] for value in self._network(patches))
        inner = np.diag(1 / np.array(UNIT))
        posterior = inner @ root @ root.T @ inner
        likelihood = _positive(posterior - np.diag(1 / np.array(SPREAD) ** 2)) * self.config.trust
        c, s = math.cos(predicted[2]), math.sin(predicted[2])
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        prior = np.linalg.inv(turn.T @ covariance @ turn)
        pull = self.config.trust * posterior @ (offset_mean * UNIT)
        offset = np.linalg.solve(likelihood + prior, pull)
        information = turn @ likelihood @ turn.T
        pose = moved_ahead(compose(eye, offset), -scan.ahead_m)
        return Match(pose=pose, information=information, paired=np.zeros(0, bool))


def _positive(matrix: Covariance) -> Covariance:
    """The nearest matrix without negative eigenvalues."""
    scale = np.diag(UNIT)  # metres and radians weigh alike
    values, vectors = np.linalg.eigh(scale @ matrix @ scale)
    back = np.linalg.inv(scale)
    return back @ (vectors * np.maximum(values, 0)) @ vectors.T @ back
