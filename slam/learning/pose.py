"""The network of the learned pose in PyTorch, and its training on pairs of a map and the frame after it.

The pose at which the frame was taken is known in the map's patch. A predicted pose is drawn around it, normally
distributed, and the patch is cut there: the network estimates the offset. The spread of the draw is the network's
prior, which `slam.mapping.learned_matching` removes. Half of all pairs are mirrored. A run takes minutes, so it has no
checkpoints.

`slam.networks.pose_network` runs the trained network, with weights of the same names and shapes; a test compares both.
Reference: Russell and Reale, Multivariate uncertainty in deep learning, 2021 (the loss).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import torch
from jaxtyping import Float, Int8
from torch import Tensor, nn

from robosim.support.checks import Range, checked
from robosim.support.torch_training import weights_of
from slam.networks.pose_network import (
    INPUTS,
    LIMIT,
    N_OUTPUTS,
    SPREAD,
    UNIT,
    PoseNetwork,
    PoseNetworkConfig,
)
from slam.poses import compose
from slam.sensing.egocentric import AHEAD, cut_ahead


class PoseModule(nn.Module):
    """Offset of the true pose from the predicted one, and the root of its information matrix."""

    def __init__(self, config: PoseNetworkConfig = PoseNetworkConfig()) -> None:
        super().__init__()
        self.config = config
        layers: list[nn.Module] = []
        before = INPUTS
        for width in config.widths:
            layers += [nn.Conv2d(before, width, 3, stride=2, padding=1), nn.ReLU(inplace=True)]
            before = width
        self.look = nn.Sequential(*layers, nn.Flatten())
        self.head = nn.Sequential(
            nn.Linear(config.flat, config.hidden), nn.ReLU(inplace=True), nn.Linear(config.hidden, N_OUTPUTS)
        )

    def network(self) -> PoseNetwork:
        """The network with the weights as they are, for use."""
        return PoseNetwork(weights_of(self), self.config)

    def forward(
        self, patches: Float[Tensor, "b 5 64 64"]
    ) -> tuple[Float[Tensor, "b 3"], Float[Tensor, "b 3 3"]]:
        """Offset x, y, yaw in `UNIT`s, axes of the robot at the predicted pose; and L, with information L L^T."""
        output = self.head(self.look(patches))
        rows, columns = torch.tril_indices(3, 3, offset=-1)
        root = torch.diag_embed(torch.exp(output[:, 3:6].clamp(-LIMIT, LIMIT)))
        root[:, rows, columns] = output[:, 6:]
        return output[:, :3], root


def surprise(
    offset: Float[Tensor, "b 3"], root: Float[Tensor, "b 3 3"], true: Float[Tensor, "b 3"]
) -> Float[Tensor, ""]:
    """Mean negative log-likelihood of true offsets, less its constant: least for the true mean and covariance."""
    whitened = torch.einsum("bji,bj->bi", root, true - offset)
    log_det = torch.log(torch.diagonal(root, dim1=1, dim2=2)).sum(dim=1)
    return (0.5 * (whitened**2).sum(dim=1) - log_det).mean()


@dataclass(frozen=True, kw_only=True)
@checked
class PoseRecipe:
    """How the pose is learnt."""

    network: PoseNetworkConfig = field(default_factory=PoseNetworkConfig)
    """Size of the network."""
    steps: Annotated[int, Range(1, 10_000_000, "batches")] = 5000
    """Batches to learn from."""
    batch: Annotated[int, Range(1, 100_000, "pairs")] = 48
    """Pairs of a batch."""
    rate: Annotated[float, Range(1e-8, 1)] = 1.5e-3
    """Highest learning rate."""
    decay: Annotated[float, Range(0, 10)] = 1e-4
    """Weight decay (AdamW)."""
    seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    """Seed of the first weights, of the order of pairs and of predicted poses."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Frames, each with the map as it was before."""

    scan: Int8[np.ndarray, "n 4 64 64"]
    """The first four channels of `slam.networks.features`, times 127."""
    belief: Int8[np.ndarray, "n 64 64"]
    """Map ahead of the previous pose: 127 for an obstacle, -127 for floor, 0 for unknown."""
    displacement: Float[np.ndarray, "n 3"]
    """True displacement from there to the frame: x, y [m], yaw [rad]."""

    def __len__(self) -> int:
        return len(self.displacement)


def train_pose(
    pairs: Pairs, recipe: PoseRecipe, on_step: Callable[[int], None] = lambda step: None
) -> tuple[PoseModule, list[dict[str, float]]]:
    """Train a network on one pair or more; returns it, ready for use, and the mean loss of every hundred steps."""
    if not len(pairs):
        raise ValueError("There are no pairs to learn from, expected some.")
    torch.manual_seed(recipe.seed)
    network = PoseModule(recipe.network)
    optimiser = torch.optim.AdamW(network.parameters(), lr=recipe.rate, weight_decay=recipe.decay)
    warm = max(1, min(100, recipe.steps // 10))
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser,
        lambda step: min((step + 1) / warm, 0.5 * (1 + math.cos(math.pi * step / recipe.steps)) + 1e-3),
    )
    curve, losses = [], []
    for step in range(recipe.steps):
        rng = np.random.default_rng([recipe.seed, step])
        rows = rng.integers(len(pairs), size=recipe.batch)
        patches, true = batch_of(pairs, rows, rng)
        optimiser.zero_grad(set_to_none=True)
        offset, root = network(patches)
        loss = surprise(offset, root, true)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        losses.append(float(loss.detach()))
        if len(losses) == 100 or step + 1 == recipe.steps:
            curve.append({"step": float(step + 1), "loss": float(np.mean(losses))})
            losses = []
        on_step(step + 1)
    return network.eval(), curve


def batch_of(
    pairs: Pairs, rows: np.ndarray, rng: np.random.Generator
) -> tuple[Float[Tensor, "b 5 64 64"], Float[Tensor, "b 3"]]:
    """Patches cut at poses drawn around the true ones, and the offsets from there to the truth in `UNIT`s."""
    offset = rng.normal(0, SPREAD, size=(len(rows), 3))
    patches = np.empty((len(rows), INPUTS, *AHEAD.shape), np.float32)
    patches[:, :4] = pairs.scan[rows] / np.float32(127)
    for k, row in enumerate(rows):
        predicted = compose(pairs.displacement[row], _inverse(offset[k]))
        belief = pairs.belief[row].astype(np.float32) / 127
        patches[k, 4] = cut_ahead(belief, AHEAD, predicted, beyond=0.0)
    mirror = rng.random(len(rows)) < 0.5
    patches[mirror] = patches[mirror][..., ::-1, :]
    offset[mirror, 1:] *= -1
    return torch.from_numpy(patches), torch.from_numpy((offset / UNIT).astype(np.float32))


def _inverse(displacement: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The displacement back."""
    x, y, yaw = displacement
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([-c * x - s * y, s * x - c * y, -yaw])


@torch.no_grad()
def pose_scores(network: PoseModule, pairs: Pairs, seed: int = 0, at_once: int = 64) -> dict[str, float]:
    """Errors of estimated offsets for pairs, and of the predicted poses.

    Returns:
        `loss`; medians and 95th percentiles of the errors in place [m] and yaw [deg], estimated and predicted; and
        `consistency`: mean of the squared error over what the information matrix expects, 1 if that is right.
    """
    losses, errors, offsets, squares = [], [], [], []
    for start in range(0, len(pairs), at_once):
        rows = np.arange(start, min(start + at_once, len(pairs)))
        patches, true = batch_of(pairs, rows, np.random.default_rng([seed, start]))
        estimated, root = network(patches)
        losses.append(float(surprise(estimated, root, true)) * len(rows))
        squares.append((torch.einsum("bji,bj->bi", root, true - estimated) ** 2).sum(dim=1).numpy() / 3)
        errors.append((true - estimated).numpy() * UNIT)
        offsets.append(true.numpy() * UNIT)
    out = {"loss": sum(losses) / len(pairs), "consistency": float(np.mean(np.concatenate(squares)))}
    for name, parts in (("estimated", errors), ("predicted", offsets)):
        off = np.concatenate(parts)
        for what, value in (("m", np.hypot(off[:, 0], off[:, 1])), ("deg", np.degrees(np.abs(off[:, 2])))):
            out[f"{name}_{what}"] = float(np.median(value))
            out[f"{name}_{what}_95"] = float(np.quantile(value, 0.95))
    return out
