"""Checkpoints of short trainings that were interrupted, and the trainings that go on from them."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import torch

from robosim.training.explorer import ExplorerRecipe
from robosim.training.policy_weights import Checkpoint
from robosim.training.search import SearchRecipe
from robosim.training.search import Training as SearchTraining
from slam.exploration.choosing import initial_weights
from slam.learning.mapper import Frames
from slam.learning.mapper import Recipe as MapperRecipe
from slam.learning.mapper import train as train_mapper
from slam.networks.map_network import NetworkConfig
from wireless.linkstate.epoch import Epoch
from wireless.linkstate.learning.training import Recipe as LinkStateRecipe
from wireless.linkstate.learning.training import train as train_classifier

MAPPER_RECIPE = MapperRecipe(network=NetworkConfig(widths=(4, 8)), steps=4, batch=2, every=2)
SEARCH_RECIPE = SearchRecipe(epochs=2)
EXPLORER_RECIPE = ExplorerRecipe(rounds=2, homes=1, decisions=4, held_out=1)
LINK_RECIPE = LinkStateRecipe(inputs=("aoa", "aod", "snr"), epochs=2, batch=8, width=4)


def teach_mapper(checkpoint: Checkpoint, on_step: Callable[[int], None] = lambda step: None) -> None:
    """A short training, or the rest of it."""
    rng = np.random.default_rng(5)
    shape = (4, 64, 64)
    frames = Frames(
        features=rng.integers(0, 127, (4, 7, 64, 64), dtype=np.int8),
        obstacle=rng.random(shape) < 0.2,
        seen=rng.random(shape) < 0.5,
        matters=np.ones(shape, bool),
    )
    train_mapper(frames, frames, MAPPER_RECIPE, checkpoint, on_step)


def teach_classifier(checkpoint: Checkpoint, report: Callable[[Epoch], None] = lambda epoch: None) -> None:
    """A short training, or the rest of it."""
    rng = np.random.default_rng(5)
    tokens = rng.normal(size=(16, 5, 5)).astype(np.float32)
    train_classifier(tokens, rng.integers(1, 4, 16), LINK_RECIPE, checkpoint=checkpoint, report=report)


class _InterruptedError(Exception):
    """A training is ended in the middle."""


def _interrupt(number: Any) -> None:
    if number == 2 or isinstance(number, Epoch):
        raise _InterruptedError


def checkpoints(folder: Path) -> None:
    """Trainings that were interrupted."""
    home = folder / "checkpoints"
    home.mkdir(parents=True, exist_ok=True)
    with suppress(_InterruptedError):
        teach_mapper(Checkpoint(home / "mapper.pt"), _interrupt)
    with suppress(_InterruptedError):
        teach_classifier(Checkpoint(home / "link-state.pt"), _interrupt)
    first = initial_weights(np.random.default_rng(0))
    tensors = {name: torch.from_numpy(value.copy()).requires_grad_() for name, value in first.items()}
    adam = torch.optim.Adam(tensors.values(), lr=EXPLORER_RECIPE.ppo.rate)
    sum(value.sum() for value in tensors.values()).backward()
    adam.step()
    best = {name: value.detach() for name, value in tensors.items()}
    state = {"round": 1, "curve": [{"round": 0}, {"round": 1, "coverage": 0.5}], "best": best, "score": 0.4}
    Checkpoint(home / "explorer.pt").save({"weights": best, "optimiser": adam.state_dict(), "state": state})
    training = SearchTraining(SEARCH_RECIPE, home)
    training.epoch, training.curve = 1, [{"epoch": 1.0, "arrived": 0.5}]
    Checkpoint(home / "search.pt").save(training.state())
