"""Training of a network on links with known states, reproducible for a seed however often it is interrupted.

Cross entropy with smoothed labels, AdamW, a warm-up and a cosine down to nothing, gradients clipped; the result
are weights averaged exponentially over the steps. All randomness of an epoch comes from the seed and
the epoch's number, and PyTorch runs in one thread, so that a run resumed from the checkpoint of an epoch gives
the same weights, bit for bit, as one that was never stopped.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
import torch
from jaxtyping import Float32, Integer
from torch import Tensor, nn

from robosim.support.checks import Range, checked
from robosim.support.torch_training import Store, restore_network, restore_optimiser, torch_threads
from wireless.linkstate.epoch import Epoch
from wireless.linkstate.forward import WIDEST
from wireless.linkstate.learning.networks import RelationNetwork
from wireless.linkstate.tokens import COLUMNS, PEAK, SNR, is_path

#: Gradients longer than this are shortened to it.
_CLIP = 1.0


@dataclass(frozen=True, kw_only=True)
@checked
class Recipe:
    """How a network is trained."""

    inputs: tuple[str, ...] = ("aoa", "aod", "snr", "peak")
    """Columns of tokens that it uses."""
    epochs: Annotated[int, Range(1, 100_000)] = 7
    """Passes over the links."""
    batch: Annotated[int, Range(1, 1_000_000, "links")] = 1024
    """Links in a step."""
    learning_rate: Annotated[float, Range(1e-8, 1)] = 3e-3
    """Largest step of AdamW, after the warm-up."""
    weight_decay: Annotated[float, Range(0, 10)] = 0.1
    """Pull of the weights to zero."""
    label_smoothing: Annotated[float, Range(0, 0.999)] = 0.05
    """Share of each label spread over all states."""
    jitter_deg: Annotated[float, Range(0, 180, "degrees")] = 1.0
    """Standard deviation of noise added to angles in training."""
    shift_db: Annotated[float, Range(0, 200, "dB")] = 0.0
    """Standard deviation of noise added to all SNRs of a link in training."""
    averaging: Annotated[float, Range(0, 0.99999)] = 0.995
    """Share of the averaged weights that a step keeps; 0 for no averaging."""
    width: Annotated[int, Range(2, WIDEST, "units")] = 64
    """Units of the states of paths."""
    dropout: Annotated[float, Range(0, 0.999)] = 0.1
    """Share of units dropped in the head."""
    seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    """Seed of the first weights, the order of the links, and dropout."""

    def __post_init__(self) -> None:
        if unknown := [name for name in self.inputs if name not in COLUMNS]:
            raise ValueError(f"inputs have {unknown[0]!r}, expected some of {', '.join(COLUMNS)}.")
        if not {"aoa", "snr"} <= set(self.inputs):
            raise ValueError(f"inputs are {', '.join(self.inputs)}, expected aoa and snr among them.")

    @property
    def options(self) -> dict[str, Any]:
        """Return the arguments of the network in addition to its inputs."""
        return {"width": self.width, "dropout": self.dropout}


def train(
    tokens: Float32[np.ndarray, "n 5 5"],
    state: Integer[np.ndarray, " n"],
    recipe: Recipe,
    *,
    watch: tuple[Float32[np.ndarray, "m 5 5"], Integer[np.ndarray, " m"]] | None = None,
    checkpoint: Store | None = None,
    report: Callable[[Epoch], None] | None = None,
) -> tuple[nn.Module, list[Epoch]]:
    """Train a network; links without paths are left out.

    Returns:
        The network with averaged weights, in evaluation mode, and all epochs.

    Raises:
        ValueError: If no link has a path, or the checkpoint is of another recipe or other links.
    """
    reached = is_path(tokens).any(1)
    if not reached.any():
        raise ValueError(
            f"none of {len(tokens)} links has an estimated path: there is nothing to learn from."
        )
    x, y = torch.from_numpy(tokens[reached]), torch.from_numpy(state[reached].astype(np.int64))
    with torch_threads(), torch.random.fork_rng(devices=[]):
        run = _Run(x, y, recipe)
        if checkpoint:
            checkpoint.restore(run.restore)
        while len(run.epochs) < recipe.epochs:
            run.step_epoch(watch)
            if checkpoint:
                checkpoint.save(run.state())
            if report:
                report(run.epochs[-1])
        return run.averaged.eval(), run.epochs


class _Run:
    """State that changes while training."""

    def __init__(self, x: Tensor, y: Tensor, recipe: Recipe) -> None:
        self.x, self.y, self.recipe = x, y, recipe
        torch.manual_seed(recipe.seed)
        self.network = RelationNetwork(recipe.inputs, **recipe.options)
        self.averaged = RelationNetwork(recipe.inputs, **recipe.options)
        self.averaged.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay
        )
        self.states = torch.unique(y)
        self.epochs: list[Epoch] = []
        self.steps = math.ceil(len(x) / recipe.batch)

    def step_epoch(self, watch: tuple[np.ndarray, np.ndarray] | None) -> None:
        """Pass once over all links."""
        number = len(self.epochs)
        torch.manual_seed((self.recipe.seed * 1_000_003 + number + 1) % 2**63)
        self.network.train()
        total = 0.0
        for i, rows in enumerate(torch.randperm(len(self.x)).split(self.recipe.batch)):
            step = number * self.steps + i
            for group in self.optimiser.param_groups:
                group["lr"] = self.recipe.learning_rate * _rate(step / (self.recipe.epochs * self.steps))
            logits = self.network(self._disturbed(self.x[rows]))[:, self.states]
            loss = nn.functional.cross_entropy(
                logits,
                torch.searchsorted(self.states, self.y[rows]),
                label_smoothing=self.recipe.label_smoothing,
            )
            self.optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.network.parameters(), _CLIP)
            self.optimiser.step()
            self._average(step)
            total += loss.item() * len(rows)
        accuracy, watched_loss = self._score(*watch) if watch and len(watch[1]) else (None, None)
        self.epochs.append(
            Epoch(epoch=number + 1, loss=total / len(self.x), accuracy=accuracy, watched_loss=watched_loss)
        )

    def _disturbed(self, tokens: Tensor) -> Tensor:
        """Tokens with the recipe's noise: (n, 5, 5)."""
        if self.recipe.jitter_deg:
            noise = math.radians(self.recipe.jitter_deg) * torch.randn(*tokens.shape[:2], 2)
            tokens = torch.cat([tokens[..., :2] + noise, tokens[..., 2:]], -1)
        if self.recipe.shift_db:
            noise = self.recipe.shift_db * torch.randn(len(tokens), 1, 1)
            tokens = torch.cat([tokens[..., :SNR], tokens[..., SNR:PEAK] + noise, tokens[..., PEAK:]], -1)
        return tokens

    @torch.no_grad()
    def _average(self, step: int) -> None:
        """Move the averaged weights towards the present ones, faster at first."""
        keep = min(self.recipe.averaging, (1 + step) / (10 + step))
        for name, value in self.network.state_dict().items():
            mean = self.averaged.state_dict()[name]
            if value.is_floating_point():
                mean.lerp_(value, 1 - keep)
            else:
                mean.copy_(value)

    @torch.no_grad()
    def _score(self, tokens: np.ndarray, state: np.ndarray) -> tuple[float, float]:
        """Accuracy and cross entropy of the averaged weights; links without paths do not count."""
        reached = is_path(tokens).any(1)
        x, y = torch.from_numpy(tokens[reached]), torch.from_numpy(state[reached].astype(np.int64))
        self.averaged.eval()
        logits = torch.cat([self.averaged(block)[:, self.states] for block in x.split(4096)])
        right = self.states[logits.argmax(1)] == y
        known = torch.isin(y, self.states)
        loss = nn.functional.cross_entropy(logits[known], torch.searchsorted(self.states, y[known]))
        return right.double().mean().item(), loss.item()

    def state(self) -> dict[str, Any]:
        """Everything."""
        return {
            "for": self._signature(),
            "network": self.network.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "epochs": [asdict(epoch) for epoch in self.epochs],
        }

    def restore(self, stored: dict[str, Any]) -> None:
        """Go on from a state."""
        signature = stored.get("for", {})
        if differing := [name for name, value in self._signature().items() if signature.get(name) != value]:
            name = differing[0]
            raise ValueError(
                f"checkpoint of another training: {name} {signature.get(name)} there, "
                f"{self._signature()[name]} now. Choose another folder."
            )
        restore_network(self.network, stored["network"])
        restore_network(self.averaged, stored["averaged"])
        restore_optimiser(self.optimiser, stored["optimiser"])
        self.epochs = [Epoch(**epoch) for epoch in stored["epochs"]]
        if [epoch.epoch for epoch in self.epochs] != list(range(1, len(self.epochs) + 1)):
            raise ValueError("its epochs are not those of a training")

    def _signature(self) -> dict[str, Any]:
        """Return the configuration that a checkpoint belongs to."""
        recipe = {
            k: list(v) if isinstance(v, Sequence) and not isinstance(v, str) else v
            for k, v in asdict(self.recipe).items()
        }
        sums = [
            float(torch.nan_to_num(self.x).double().sum()),
            int((self.y * torch.arange(len(self.y))).sum()),
        ]
        return {**recipe, "links": len(self.x), "sums": sums}


def _rate(done: float) -> float:
    """Share of the learning rate: up over the first 15 % of the steps, then down to 0."""
    warm_up = 0.15
    if done < warm_up:
        return 0.04 + 0.96 * (1 - math.cos(math.pi * done / warm_up)) / 2
    return (1 + math.cos(math.pi * (done - warm_up) / (1 - warm_up))) / 2
