"""Training of the learned search on segments: imitation of a guide, and proximal policy optimisation.

Robots walk side by side through segments of some steps. Each segment is used for some passes, a few robots at a time,
from the memory at its beginning: gradients go back through the whole segment and no further. A search that ends within
a segment is followed by another with an empty memory. The loss of a step is

    advice * cross entropy with the guide's action
    + clipped surrogate of the policy's advantage     (only if the policy itself drove)
    + value * squared error of the discounted reward - entropy * entropy of the policy

with generalised advantages, cut off at arrivals but not at time limits.

Reference: Schulman et al., Proximal policy optimization algorithms, arXiv:1707.06347, and Generalized advantage
estimation, ICLR 2016; Schmitt et al., Kickstarting deep reinforcement learning, arXiv:1803.03835.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from torch import Tensor

from slam.learning.ppo import PpoConfig, descend, surrogate


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """Steps of robots side by side."""

    inputs: Float32[np.ndarray, "steps robots inputs"]
    """Inputs of the network."""
    begins: Bool[np.ndarray, "steps robots"]
    """Whether a search begins with the step, with an empty memory."""
    counts: Bool[np.ndarray, "steps robots"]
    """Whether the step belongs to a search, rather than to the pause between two."""
    advised: Int[np.ndarray, "steps robots"]
    """Action of the guide."""
    taken: Int[np.ndarray, "steps robots"]
    """Action taken."""
    log_odds: Float[np.ndarray, "steps robots"]
    """Logarithm of its probability by the policy."""
    reward: Float[np.ndarray, "steps robots"]
    arrived: Bool[np.ndarray, "steps robots"]
    """Whether the step ended the search at the target."""
    late: Bool[np.ndarray, "steps robots"]
    """Whether the step was the last within the time limit."""
    value: Float[np.ndarray, "later robots"]
    """Expected discounted reward before each step, and after the last."""
    memory: Float32[np.ndarray, "robots hidden"]
    """Memory of the policy before the first step."""


def advantages(
    segment: Segment, config: PpoConfig
) -> tuple[Float[np.ndarray, "steps robots"], Float[np.ndarray, "steps robots"]]:
    """Advantage and discounted reward of each step."""
    reward = segment.reward
    advantage, after = np.zeros_like(reward), np.zeros(reward.shape[1])
    for t in reversed(range(len(reward))):
        continues = ~(segment.arrived[t] | segment.late[t])
        error = reward[t] + config.discount * segment.value[t + 1] * ~segment.arrived[t] - segment.value[t]
        # The step before a pause is the last of its search.
        after = np.where(segment.counts[t], error + config.discount * config.trace * continues * after, 0.0)
        advantage[t] = after
    return advantage, advantage + segment.value[:-1]


def forward(
    weights: Mapping[str, Tensor],
    inputs: Float[Tensor, "steps robots inputs"],
    begins: Bool[Tensor, "steps robots"],
    memory: Float[Tensor, "robots hidden"],
) -> tuple[Float[Tensor, "steps robots 3"], Float[Tensor, "steps robots"]]:
    """`SearchNetwork` over a segment: scores of actions and values."""
    w = weights
    encoded = torch.relu(inputs @ w["encoder.weight"] + w["encoder.bias"])
    memories = []
    for new, begin in zip(encoded @ w["memory.input_weight"] + w["memory.input_bias"], begins, strict=True):
        memory = memory * ~begin[:, None]
        old = memory @ w["memory.own_weight"] + w["memory.own_bias"]
        new_r, new_z, new_n = new.chunk(3, dim=-1)
        old_r, old_z, old_n = old.chunk(3, dim=-1)
        keep = torch.sigmoid(new_z + old_z)
        fresh = torch.tanh(new_n + torch.sigmoid(new_r + old_r) * old_n)
        memory = (1 - keep) * fresh + keep * memory
        memories.append(memory)
    after = torch.stack(memories)
    scores = after @ w["action.weight"] + w["action.bias"]
    return scores, (after @ w["value.weight"] + w["value.bias"])[..., 0]


def learn(
    weights: Mapping[str, Tensor],
    optimiser: torch.optim.Optimizer,
    segment: Segment,
    config: PpoConfig,
    *,
    advice: float,
    has_surrogate: bool,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Improve the weights by one segment; a batch of the configuration counts robots.

    `advice` is the weight of the cross entropy with the guide's actions; `has_surrogate` adds the surrogate, for
    which the policy must have driven all the time.

    Returns:
        Means over the segment: `advice` (cross entropy), `value` (squared error), `entropy`, `agreed` (share of the
        guide's actions that are the most likely ones).
    """
    advantage, returns = advantages(segment, config)
    counted = advantage[segment.counts]
    advantage = (advantage - counted.mean()) / (counted.std() + 1e-6)
    robots, columns = segment.inputs.shape[1], dict[str, list[float]]()
    for _ in range(config.passes):
        for group in np.array_split(rng.permutation(robots), max(1, round(robots / config.batch))):
            loss, means = _loss(
                weights,
                segment,
                advantage,
                returns,
                group,
                config,
                advice=advice,
                has_surrogate=has_surrogate,
            )
            descend(loss, weights, optimiser)
            for name, value in means.items():
                columns.setdefault(name, []).append(value)
    return {name: float(np.mean(values)) for name, values in columns.items()}


def _loss(
    weights: Mapping[str, Tensor],
    segment: Segment,
    advantage: np.ndarray,
    returns: np.ndarray,
    group: np.ndarray,
    config: PpoConfig,
    *,
    advice: float,
    has_surrogate: bool,
) -> tuple[Tensor, dict[str, float]]:
    """The loss of some robots' steps, and its parts."""

    def of(array: np.ndarray, kind: Any = None) -> Tensor:
        return torch.as_tensor(array[:, group], dtype=kind)

    memory = torch.from_numpy(segment.memory[group])
    scores, value = forward(weights, of(segment.inputs), of(segment.begins), memory)
    counts = of(segment.counts)
    log_odds = torch.log_softmax(scores, dim=-1)[counts]
    advised, taken = of(segment.advised)[counts], of(segment.taken)[counts]
    imitation = -log_odds.gather(1, advised[:, None]).mean()
    error = (value[counts] - of(returns, torch.float32)[counts]).square().mean()
    entropy = -(log_odds.exp() * log_odds).sum(dim=-1).mean()
    loss = advice * imitation + config.value * error - config.entropy * entropy
    if has_surrogate:
        before, gain = of(segment.log_odds, torch.float32)[counts], of(advantage, torch.float32)[counts]
        ratio = torch.exp(log_odds.gather(1, taken[:, None])[:, 0] - before)
        loss = loss - surrogate(ratio, gain, config.clip)
    agreed = (log_odds.argmax(dim=-1) == advised).float().mean()
    means = {"advice": imitation, "value": error, "entropy": entropy, "agreed": agreed}
    return loss, {name: float(mean.detach()) for name, mean in means.items()}
