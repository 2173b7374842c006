"""Proximal policy optimisation of the choice among frontiers.

A choice lasts as many decisions as the robot goes on with it, so time is discounted by decision and not by choice (a
semi-Markov process): a choice that earns r and lasts n decisions is worth r + g^n V(next), and advantages are
generalised over choices likewise. The clipped surrogate is climbed for some passes over the walks, then they are thrown
away.

Reference: Schulman et al., Proximal policy optimization algorithms, arXiv:1707.06347, and Generalized advantage
estimation, ICLR 2016; Sutton, Precup and Singh, Between MDPs and semi-MDPs, Artificial Intelligence 112, 1999.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor

from robosim.support.checks import Range, checked
from slam.exploration.choosing import FEATURES, evaluate

#: Length to which gradients are cut.
LONGEST = 0.5


@dataclass(frozen=True, kw_only=True)
@checked
class PpoConfig:
    """How a policy is improved by proximal policy optimisation."""

    discount: Annotated[float, Range(0, 1)] = 0.99
    """Weight of a reward one decision later; 0.99 looks 100 decisions ahead."""
    trace: Annotated[float, Range(0, 1)] = 0.9
    """Weight of the next decision's error in the advantage of this one (lambda)."""
    clip: Annotated[float, Range(1e-6, 10)] = 0.2
    """Distance of the ratio of probabilities from 1 beyond which the objective is clipped."""
    passes: Annotated[int, Range(1, 10_000)] = 8
    """Passes over the collected data."""
    batch: Annotated[int, Range(1, 1_000_000)] = 256
    """Choices, or robots, of a gradient step."""
    rate: Annotated[float, Range(1e-8, 1)] = 2e-3
    """Learning rate (Adam)."""
    entropy: Annotated[float, Range(0, 100)] = 0.001
    """Weight of the entropy of the policy."""
    value: Annotated[float, Range(0, 100)] = 0.5
    """Weight of the squared error of the value."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Walk:
    """Choices of one walk, and their results."""

    features: list[Float32[np.ndarray, "_ k"]]
    """Features of the frontiers at each choice."""
    taken: Int[np.ndarray, " n"]
    """Index of the chosen frontier."""
    log_odds: Float[np.ndarray, " n"]
    """Logarithm of the probability of that choice."""
    value: Float[np.ndarray, " n"]
    """Value that was expected at each choice."""
    at: Int[np.ndarray, " n"]
    """Decisions made before each choice."""
    coverage: Float[np.ndarray, " m"]
    """Part of the floor seen before each decision, and after the last."""
    ended: bool
    """Whether nothing was left to see, rather than time was over."""


def advantages(walk: Walk, config: PpoConfig) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """By how much each choice was better than expected, and what it was worth in the end.

    The reward of a decision is the part of the floor that it shows for the first time.
    """
    n, last = len(walk.taken), len(walk.coverage) - 1
    times = np.append(walk.at, last)
    gain = np.diff(walk.coverage)
    # After the last choice nothing is expected if all was seen; else about what was expected at it.
    after = 0.0 if walk.ended or not n else float(walk.value[-1])
    advantage, ahead = np.zeros(n), 0.0
    for k in range(n - 1, -1, -1):
        lasts = times[k + 1] - times[k]
        reward = gain[times[k] : times[k + 1]] @ config.discount ** np.arange(lasts)
        discount = config.discount**lasts
        error = reward + discount * (walk.value[k + 1] if k + 1 < n else after) - walk.value[k]
        ahead = error + discount * config.trace * ahead
        advantage[k] = ahead
    return advantage, advantage + walk.value


def improve(
    weights: dict[str, Tensor],
    optimiser: torch.optim.Optimizer,
    walks: Sequence[Walk],
    config: PpoConfig,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Climb the surrogate; returns the last entropy, share of clipped ratios, and error of the value (means)."""
    data = _together(walks, config)
    n = len(data["taken"])
    losses: list[list[float]] = []
    for _ in range(config.passes):
        losses = []
        for batch in np.array_split(rng.permutation(n), max(1, round(n / config.batch))):
            loss, numbers = _loss(weights, {key: value[batch] for key, value in data.items()}, config)
            descend(loss, weights, optimiser)
            losses.append(numbers)
    return dict(zip(("entropy", "clipped", "value_error"), np.mean(losses, axis=0).tolist(), strict=True))


def surrogate(ratio: Float[Tensor, " n"], advantage: Float[Tensor, " n"], clip: float) -> Tensor:
    """The clipped surrogate, more is better: mean advantage of what was done, by how much likelier it has become."""
    within = ratio.clamp(1 - clip, 1 + clip)
    return torch.minimum(ratio * advantage, within * advantage).mean()


def descend(loss: Tensor, weights: Mapping[str, Tensor], optimiser: torch.optim.Optimizer) -> None:
    """Take a step of an optimiser, with the gradient clipped to length `LONGEST`."""
    optimiser.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(list(weights.values()), LONGEST)
    optimiser.step()


def _together(walks: Sequence[Walk], config: PpoConfig) -> dict[str, Tensor]:
    """All choices of some walks in tensors, padded to the most offers of any."""
    n_max = max(len(features) for walk in walks for features in walk.features)
    n = sum(len(walk.taken) for walk in walks)
    features, there = np.zeros((n, n_max, len(FEATURES)), np.float32), np.zeros((n, n_max, 1), np.float32)
    for k, offered in enumerate(offered for walk in walks for offered in walk.features):
        features[k, : len(offered)], there[k, : len(offered)] = offered, 1.0
    advantage, returns = (
        np.concatenate(parts) for parts in zip(*(advantages(walk, config) for walk in walks), strict=True)
    )
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    arrays: dict[str, Any] = {
        "features": features,
        "there": there,
        "taken": np.concatenate([walk.taken for walk in walks]).astype(np.int64),
        "log_odds": np.concatenate([walk.log_odds for walk in walks]).astype(np.float32),
        "advantage": advantage.astype(np.float32),
        "returns": returns.astype(np.float32),
    }
    return {key: torch.from_numpy(value) for key, value in arrays.items()}


def _loss(
    weights: dict[str, Tensor], data: dict[str, Tensor], config: PpoConfig
) -> tuple[Tensor, list[float]]:
    """The clipped surrogate with the error of the value and the worth of undecidedness; less is better."""
    logits, value = evaluate(weights, data["features"], data["there"], torch)
    log_all = torch.log_softmax(logits, dim=-1)
    log_taken = log_all.gather(-1, data["taken"][:, None])[:, 0]
    ratio = torch.exp(log_taken - data["log_odds"])
    gain = surrogate(ratio, data["advantage"], config.clip)
    entropy = -(log_all.exp() * log_all).sum(-1).mean()
    error = ((value - data["returns"]) ** 2).mean()
    loss = config.value * error - gain - config.entropy * entropy
    clipped = ((ratio - 1).abs() > config.clip).float().mean()
    return loss, [entropy.item(), clipped.item(), error.item()]
