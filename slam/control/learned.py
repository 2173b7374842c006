"""Learned local policy: a small network, trained to imitate the deterministic controller, chooses actions.

Its inputs are the free space around the robot, points along the path, the downhill direction and the last action, in
the robot's frame. It replaces the search over turns and runs; the behaviour at the end of the path, after bumps and
when stuck is that of the deterministic controller. The network runs in NumPy.

Reference: the local policy of Chaplot et al., Learning to Explore using Active Neural SLAM, ICLR 2020, which sees the
picture in place of the map; Ross, Gordon and Bagnell, A reduction of imitation learning to no-regret online learning,
AISTATS 2011.
"""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from slam.actions import PUBLISHED, Action
from slam.control.controller import ControlConfig, Controller
from slam.planning.clearance import LIMIT_M
from slam.planning.planner import Plan
from slam.robot import Robot
from slam.support.weights import Weights, read_weights

#: Free space is sampled at these distances [m] in this many directions around the robot.
_DISTANCES_M, _DIRECTIONS = (0.12, 0.25, 0.4, 0.6, 0.9), 24
#: Distances along the path of the points that the network receives [m].
_ALONG_M = (0.15, 0.3, 0.6, 1.0, 1.8)
HIDDEN = 96
INPUTS = len(_DISTANCES_M) * _DIRECTIONS + 1 + 2 * len(_ALONG_M) + 3 + len(PUBLISHED) + 1


def initial_weights(rng: np.random.Generator) -> dict[str, Float32[np.ndarray, "..."]]:
    """Random weights."""
    sizes = (INPUTS, HIDDEN, HIDDEN, len(PUBLISHED))
    weights: dict[str, Float32[np.ndarray, ...]] = {}
    for k, (rows, columns) in enumerate(pairwise(sizes)):
        drawn = rng.standard_normal((rows, columns)) * math.sqrt(2 / rows)
        weights[f"{k}.weight"] = drawn.astype(np.float32)
        weights[f"{k}.bias"] = np.zeros(columns, np.float32)
    return weights


class LearnedController(Controller):
    """Follows the path by a network."""

    def __init__(
        self, weights: Weights, robot: Robot = Robot(), config: ControlConfig = ControlConfig()
    ) -> None:
        self.weights = weights
        super().__init__(robot, config)

    def _best(self, pose: Float[np.ndarray, "3"], plan: Plan) -> Action:
        return Action(int(np.argmax(self.scores(self.senses(pose, plan)))))

    def senses(self, pose: Float[np.ndarray, "3"], plan: Plan) -> Float32[np.ndarray, " n"]:
        """Inputs of the network, of magnitude about 1."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        turned = np.array([[c, s], [-s, c]])
        room = plan.clearance.at(np.vstack([pose[:2], pose[:2] + _AROUND @ turned])) / LIMIT_M
        along = (_points_along(plan.path, _ALONG_M) - pose[:2]) @ turned.T / np.array(_ALONG_M)[:, None]
        cost_m, downhill = plan.field.at_and_downhill(pose[:2])
        off = float(downhill) - pose[2]
        left = min(float(cost_m), 2.0) / 2
        bumped = any(math.hypot(pose[0] - x, pose[1] - y) < 0.15 for x, y, _, _ in self._bumps)
        last = np.zeros(len(PUBLISHED))
        if self._last in PUBLISHED:
            last[self._last] = 1.0
        parts = (room, along.ravel(), (math.cos(off), math.sin(off), left), last, (float(bumped),))
        return np.concatenate(parts).astype(np.float32)

    def scores(self, senses: Float32[np.ndarray, "*batch n"]) -> Float32[np.ndarray, "*batch 3"]:
        """Log-odds of each action, up to a constant."""
        h, w = senses, self.weights
        for k in range(2):
            h = np.maximum(h @ w[f"{k}.weight"] + w[f"{k}.bias"], 0)
        return np.asarray(h @ w["2.weight"] + w["2.bias"])


def _around() -> Float[np.ndarray, "n 2"]:
    """Points at which free space is sampled, x ahead and y left [m]."""
    angle = np.arange(_DIRECTIONS) * (2 * math.pi / _DIRECTIONS)
    directions = np.column_stack([np.cos(angle), np.sin(angle)])
    return (np.array(_DISTANCES_M)[:, None, None] * directions).reshape(-1, 2)


_AROUND = _around()


def _points_along(path: Float[np.ndarray, "n 2"], distances_m: tuple[float, ...]) -> Float[np.ndarray, "k 2"]:
    """Points at distances along a path, its end for those beyond."""
    arc_length = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    return np.column_stack([np.interp(distances_m, arc_length, path[:, axis]) for axis in (0, 1)])


def load_steering(path: Path, robot: Robot = Robot()) -> LearnedController:
    """A controller with the weights of a trained local policy.

    Raises:
        ValueError: If the file is missing, damaged, or of something else.
    """
    return LearnedController(read_weights(path, initial_weights(np.random.default_rng(0)), "steering"), robot)
