"""Optimisers put back into a state that was kept."""

from collections.abc import Mapping
from typing import Any

import torch


def restore_optimiser(optimiser: torch.optim.Optimizer, kept: Mapping[str, Any]) -> None:
    """Put an optimiser into a state that was kept.

    Raises:
        ValueError: If the state is of other options or of weights of other shapes, which would show at a step only.
    """
    options = [_options(group) for group in optimiser.param_groups]
    optimiser.load_state_dict(dict(kept))
    if [_options(group) for group in optimiser.param_groups] != options:
        raise ValueError("its optimiser has other options")
    weights = [weight for group in optimiser.param_groups for weight in group["params"]]
    for weight in weights:
        for name, value in optimiser.state.get(weight, {}).items():
            if not isinstance(value, torch.Tensor) or value.shape not in (weight.shape, torch.Size([])):
                raise ValueError(f"{name} of its optimiser fits no weights")


def _options(group: Mapping[str, Any]) -> dict[str, Any]:
    """What does not change in the course of a training."""
    return {name: value for name, value in group.items() if name not in ("params", "lr", "initial_lr")}
