"""Training of the learned mapper on frames with ground truth.

Frames are stored as features in eighths of a percent (int8), so that a hundred thousand of them need some gigabytes.
Half of the frames of a batch are mirrored, since buildings have no handedness; some lose the map's belief, so that the
network also learns places where it has never been. Learning rate: linear warm-up, then a cosine to zero over the number
of steps, so the length of a run is fixed at its start; an interrupted run continues from its checkpoint to the same
result. Convolutions are trained in bfloat16, twice as fast where the processor supports it, and used in float32.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int8
from torch import Tensor

from robosim.support.checks import Range, checked
from robosim.support.torch_training import Store, check_weights, restore_network, restore_optimiser
from slam.learning.map_module import MapModule, loss
from slam.networks.features import BELIEF, PLACE_LEFT
from slam.networks.map_network import OBSTACLE, MapNetwork, NetworkConfig
from slam.networks.scores import PatchScores


@dataclass(frozen=True, kw_only=True)
@checked
class Recipe:
    """How a mapper is trained."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Size of the network."""
    steps: Annotated[int, Range(1, 10_000_000, "batches")] = 4000
    """Batches to learn from."""
    batch: Annotated[int, Range(1, 100_000, "frames")] = 32
    """Frames of a batch."""
    rate: Annotated[float, Range(1e-8, 1)] = 3e-3
    """Highest learning rate."""
    decay: Annotated[float, Range(0, 10)] = 1e-2
    """Weight decay (AdamW)."""
    forget: Annotated[float, Range(0, 1)] = 0.25
    """Share of frames whose map is taken away."""
    every: Annotated[int, Range(1, 10_000_000, "steps")] = 250
    """Steps between validations and checkpoints."""
    seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    """Seed of the first weights and of the order of frames."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """Frames ready to learn from."""

    features: Int8[np.ndarray, "n 7 ny nx"]
    """Channels of `slam.networks.features` times 127."""
    obstacle: Bool[np.ndarray, "n ny nx"]
    """True obstacles."""
    seen: Bool[np.ndarray, "n ny nx"]
    """Cells that the camera sees."""
    matters: Bool[np.ndarray, "n ny nx"]
    """Cells that are scored where hidden."""

    def __len__(self) -> int:
        return len(self.features)


def coded(features: Float32[np.ndarray, "*batch"]) -> Int8[np.ndarray, "*batch"]:
    """Features as they are stored."""
    return np.rint(127 * features).astype(np.int8)


def train(
    frames: Frames,
    held_out: Frames,
    recipe: Recipe,
    checkpoint: Store,
    on_step: Callable[[int], None] = lambda step: None,
) -> tuple[MapNetwork, list[dict[str, float]]]:
    """Train a network, or go on training it.

    Returns:
        The network of least validation loss, ready for use, and the curve: one row a validation.

    Raises:
        ValueError: If there are no frames.
    """
    if not len(frames) or not len(held_out):
        raise ValueError(f"{len(frames)} frames to learn from and {len(held_out)} held out, expected some.")
    torch.manual_seed(recipe.seed)
    network = MapModule(recipe.network)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.AdamW(network.parameters(), lr=recipe.rate, weight_decay=recipe.decay)
    state: dict[str, Any] = {"step": 0, "curve": [], "best": None, "learnt": 0.0}

    def go_on(stored: dict[str, Any]) -> None:
        restore_network(network, stored["network"])
        restore_optimiser(optimiser, stored["optimiser"])
        state.update(_checked(stored["state"], recipe, network))

    checkpoint.restore(go_on)

    def keep() -> None:
        checkpoint.save(
            {"network": network.state_dict(), "optimiser": optimiser.state_dict(), "state": state}
        )

    while state["step"] < recipe.steps:
        step = state["step"]
        for group in optimiser.param_groups:
            group["lr"] = recipe.rate * _schedule(step, recipe.steps)
        rng = np.random.default_rng([recipe.seed, step])
        value = _learn(network, optimiser, *_batch(frames, recipe, rng))
        if not math.isfinite(value):
            raise ValueError(
                f"the loss is {value} after {step} steps, with rate = {recipe.rate}. Choose a smaller rate."
            )
        state["learnt"] += value
        state["step"] = step + 1
        if state["step"] % recipe.every == 0 or state["step"] == recipe.steps:
            since = (state["step"] - 1) % recipe.every + 1
            row = {"step": float(state["step"]), "train_loss": state["learnt"] / since}
            row |= validate(network, held_out)
            state["curve"].append(row)
            state["learnt"] = 0.0
            if state["best"] is None or row["loss"] <= min(r["loss"] for r in state["curve"]):
                state["best"] = {name: value.clone() for name, value in network.state_dict().items()}
            keep()
        try:
            on_step(state["step"])
        except BaseException:
            keep()
            raise
    network.load_state_dict(state["best"])
    return network.network(), state["curve"]


def _checked(state: dict[str, Any], recipe: Recipe, network: MapModule) -> dict[str, Any]:
    """How far a training had come, if a checkpoint says that."""
    step, curve, best, learnt = (state[key] for key in ("step", "curve", "best", "learnt"))
    good = isinstance(step, int) and 0 <= step <= recipe.steps and isinstance(learnt, float)
    good = good and isinstance(curve, list) and all(isinstance(row["loss"], float) for row in curve)
    good = good and bool(curve) == (best is not None) and (best is not None or step < recipe.steps)
    if best is not None:
        check_weights(best)
        shapes = {name: value.shape for name, value in network.state_dict().items()}
        good = good and {name: value.shape for name, value in best.items()} == shapes
    if not good:
        raise ValueError("it says of no training how far it had come")
    return state


def _schedule(step: int, steps: int) -> float:
    """Part of the highest learning rate at a step."""
    warm = max(1, min(200, steps // 10))
    return min((step + 1) / warm, 0.5 * (1 + math.cos(math.pi * step / steps)) + 1e-3)


def _batch(frames: Frames, recipe: Recipe, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Features, obstacles and seen cells of a random batch."""
    rows = rng.integers(len(frames), size=recipe.batch)
    features = frames.features[rows].astype(np.float32) / 127
    obstacle, seen = frames.obstacle[rows].astype(np.float32), frames.seen[rows].astype(np.float32)
    features[rng.random(recipe.batch) < recipe.forget, BELIEF] = 0
    mirror = rng.random(recipe.batch) < 0.5
    for array in (features, obstacle, seen):
        array[mirror] = array[mirror][..., ::-1, :]
    features[mirror, PLACE_LEFT] *= -1
    as_tensor = torch.from_numpy(features).contiguous(memory_format=torch.channels_last)
    return as_tensor, torch.from_numpy(obstacle), torch.from_numpy(seen)


def _learn(
    network: MapModule, optimiser: torch.optim.Optimizer, features: Tensor, obstacle: Tensor, seen: Tensor
) -> float:
    """Take an optimiser step; return the loss before it."""
    network.train()
    optimiser.zero_grad(set_to_none=True)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        logits = network(features)
    value = loss(logits.float(), obstacle, seen)
    value.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimiser.step()
    return float(value.detach())


@torch.no_grad()
def validate(network: MapModule, frames: Frames, at_once: int = 64) -> dict[str, float]:
    """Loss and scores over frames."""
    network.eval()
    scores, total = PatchScores(), 0.0
    for start in range(0, len(frames), at_once):
        batch = slice(start, start + at_once)
        features = torch.from_numpy(frames.features[batch].astype(np.float32) / 127)
        logits = network(features.contiguous(memory_format=torch.channels_last))
        obstacle = torch.from_numpy(frames.obstacle[batch].astype(np.float32))
        seen = torch.from_numpy(frames.seen[batch].astype(np.float32))
        total += float(loss(logits, obstacle, seen)) * len(features)
        predicted = torch.sigmoid(logits[:, OBSTACLE]).numpy()
        scores.add(predicted, frames.obstacle[batch], frames.seen[batch], frames.matters[batch])
    return {"loss": total / len(frames), **scores.result()}


def classical_scores(frames: Frames) -> dict[str, float]:
    """Scores of what the map believes, without a network: unknown is not an obstacle, and not floor."""
    scores = PatchScores()
    belief = (frames.features[:, BELIEF].astype(np.float32) / 127 + 1) / 2
    scores.add(belief, frames.obstacle, frames.seen, frames.matters)
    return scores.result()
