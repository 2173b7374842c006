"""Learned choice among frontiers by a small network.

The features of each frontier are its hand-made rating, the cost of the path to it, the area visible from it and its
surroundings. The network sees each frontier together with the mean over all, so that neither their order nor their
number matters, and adds a learned correction to the hand-made rating. Untrained, the correction is zero. The network
has some thousand weights, runs in NumPy and is trained in PyTorch.

Reference: Zaheer et al., Deep Sets, NeurIPS 2017; residual policies: Silver et al., arXiv:1812.06298.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from robosim.support.weights import Weights, read_weights
from slam.exploration.frontiers import Frontier
from slam.planning.cost_map import Box

#: Features of each frontier, in this order.
FEATURES = (
    "rating",
    "decisions",
    "area",
    "length",
    "current",
    "ahead",
    "distance",
    "detour",
    "other_area_near",
    "unseen_around",
    "walls_around",
    "outward",
    "explored",
    "offers",
)
HIDDEN = 32
#: Decisions of the hand-made rating that make an untrained choice e times less likely.
TEMPERATURE = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Offer:
    """A frontier with its cost and rating."""

    frontier: Frontier
    """Where it is."""
    decisions: float
    """Turns and steps to it."""
    area_m2: float
    """Unseen area visible from it, if unknown cells were open [m^2]."""
    current: bool
    """Whether it is the current goal."""
    rating: float
    """The hand-made rating [decisions]; less is better."""


def describe(offers: Sequence[Offer], box: Box, view_m: float) -> Float32[np.ndarray, "n k"]:
    """Features of each offer, in the order of `FEATURES`, of magnitude about 1."""
    places = np.array([offer.frontier.goal_xy for offer in offers])
    area = np.array([offer.area_m2 for offer in offers])
    explored_m2 = np.count_nonzero(box.explored) * box.frame.resolution_m**2
    middle = (
        box.frame.to_points(np.argwhere(box.explored).mean(axis=0)[::-1]) if explored_m2 else box.pose[:2]
    )
    gap = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    rows = []
    for k, offer in enumerate(offers):
        ahead = places[k] - box.pose[:2]
        distance = math.hypot(*ahead)
        x, y = places[k]
        rows_, columns, _ = box.frame.window(
            (x - view_m / 2, y - view_m / 2), (x + view_m / 2, y + view_m / 2)
        )
        rows.append(
            (
                offer.rating / 10,
                offer.decisions / 50,
                area[k] / 5,
                min(offer.frontier.length_m, 6.0) / 3,
                float(offer.current),
                math.cos(math.atan2(ahead[1], ahead[0]) - box.pose[2]),
                distance / 10,
                offer.frontier.cost_m / (distance + 0.5) / 3,
                (area[gap[k] < view_m].sum() - area[k]) / 10,
                1.0 - float(box.explored[rows_, columns].mean()),
                float(box.obstacle[rows_, columns].mean()) * 5,
                math.hypot(*(places[k] - middle)) / math.sqrt(explored_m2 + 1.0),
                explored_m2 / 100,
                len(offers) / 10,
            )
        )
    return np.array(rows, np.float32)


def evaluate(weights: Mapping[str, Any], features: Any, there: Any, xp: Any = np) -> tuple[Any, Any]:
    """Log-odds of each offer, and the value of the whole situation.

    Returns:
        (..., n), -1e9 at padding, and (...).
    """
    count = there.sum(-2)[..., None, :]
    embedding = xp.tanh(features @ weights["own.weight"] + weights["own.bias"])
    mean = (embedding * there).sum(-2)[..., None, :] / count
    both = xp.tanh(embedding @ weights["both.own"] + mean @ weights["both.mean"] + weights["both.bias"])
    added = (both @ weights["added.weight"])[..., 0]
    logits = added - features[..., 0] * weights["prior"]
    pooled = (both * there).sum(-2) / count[..., 0, :]
    value = (pooled @ weights["value.weight"])[..., 0] + weights["value.bias"]
    return logits + (there[..., 0] - 1) * 1e9, value


def initial_weights(rng: np.random.Generator) -> dict[str, Float32[np.ndarray, "..."]]:
    """Weights that choose by the hand-made rating."""
    k = len(FEATURES)

    def drawn(rows: int, columns: int) -> Float32[np.ndarray, "r c"]:
        return (rng.standard_normal((rows, columns)) / math.sqrt(rows)).astype(np.float32)

    return {
        "prior": np.array(10 / TEMPERATURE, np.float32),
        "own.weight": drawn(k, HIDDEN),
        "own.bias": np.zeros(HIDDEN, np.float32),
        "both.own": drawn(HIDDEN, HIDDEN),
        "both.mean": drawn(HIDDEN, HIDDEN),
        "both.bias": np.zeros(HIDDEN, np.float32),
        "added.weight": np.zeros((HIDDEN, 1), np.float32),
        "value.weight": np.zeros((HIDDEN, 1), np.float32),
        "value.bias": np.array(0.0, np.float32),
    }


class Chooser:
    """Chooses the offer that the network rates best."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights

    def __call__(self, features: Float32[np.ndarray, "n k"]) -> int:
        """Index of the best offer."""
        logits, _ = evaluate(self.weights, features, np.ones((len(features), 1), np.float32))
        return int(np.argmax(logits))


def load_chooser(path: Path) -> Chooser:
    """A trained choice from its weights.

    Raises:
        ValueError: If the file is missing, damaged, or of something else.
    """
    return Chooser(read_weights(path, initial_weights(np.random.default_rng(0)), "explorer"))
