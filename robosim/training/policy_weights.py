"""Weights of small policies as tensors, from checkpoints, and as files; durations of calls for cards."""

from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from safetensors.numpy import save
from torch import Tensor

from robosim.support.files import write_json, write_whole
from slam.learning.restoring import check_weights
from slam.support.weights import Weights


def as_tensors(weights: Weights) -> dict[str, Tensor]:
    """Copies with gradients."""
    return {name: torch.from_numpy(value.copy()).requires_grad_() for name, value in weights.items()}


def as_arrays(weights: Mapping[str, Tensor]) -> dict[str, np.ndarray]:
    """Copies without gradients."""
    return {name: value.detach().numpy().copy() for name, value in weights.items()}


def restore_weights(weights: Mapping[str, Tensor], stored: Mapping[str, Tensor]) -> None:
    """Overwrite weights by those of a checkpoint.

    Raises:
        ValueError: If the stored ones have implausible values, or other names or shapes.
    """
    check_weights(stored)
    if {name: value.shape for name, value in weights.items()} != {k: v.shape for k, v in stored.items()}:
        raise ValueError("its weights have other names or shapes")
    with torch.no_grad():
        for name, value in weights.items():
            value.copy_(stored[name])


def count_parameters(weights: Weights) -> int:
    """Number of all weights."""
    return sum(int(np.size(value)) for value in weights.values())


def write_policy(out: Path, name: str, weights: Weights, card: dict[str, Any]) -> None:
    """Write NAME.safetensors, and the card as NAME.json."""
    write_whole(out / f"{name}.safetensors", save(dict(weights)))
    write_json(out / f"{name}.json", card)


def median_call_ms(call: Callable[[], object], n_calls: int) -> float:
    """Median duration of calls, after as many to warm up."""
    seconds = []
    for _ in range(2 * n_calls):
        begin = perf_counter()
        call()
        seconds.append(perf_counter() - begin)
    return round(1e3 * float(np.median(seconds[n_calls:])), 3)
