"""Weights of small policies, as tensors and as files, and checkpoints of trainings; durations of calls for cards."""

import io
import os
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any, BinaryIO

import numpy as np
import torch
from safetensors.numpy import save
from torch import Tensor

from robosim.support.files import write_json, write_whole
from robosim.support.reading import reading
from robosim.support.torch_training import check_weights
from robosim.support.weights import Weights


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


class Checkpoint:
    """Checkpoint file, written whole at every save."""

    def __init__(self, path: Path) -> None:
        """Say where."""
        self.path = Path(path)

    def restore(self, put: Callable[[dict[str, Any]], None]) -> None:
        """Give the last saved state, if there is one, to `put`; errors of `put` count as damage of the file.

        Raises:
            FileError: If the file is damaged, or its state is rejected.
        """
        if os.path.lexists(self.path):
            with reading(self.path, "the checkpoint of a training", "Delete it to start again.") as file:
                put(_whole(file))

    def save(self, state: dict[str, Any]) -> None:
        """Store a state: tensors, numbers, texts, and lists and dictionaries of these."""
        buffer = io.BytesIO()
        torch.save(state, buffer)
        write_whole(self.path, buffer.getvalue())


def _whole(file: BinaryIO) -> dict[str, Any]:
    """Content of a file of `torch.save`, with checked sums; no code in it is run."""
    with zipfile.ZipFile(file) as archive:
        if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
            raise ValueError("it is not packed by PyTorch")
        # PyTorch itself does not compare the check sums.
        if (damaged := archive.testzip()) is not None:
            raise ValueError(f"the check sum of {damaged} is wrong")
    file.seek(0)
    state = torch.load(file, weights_only=True)
    if not isinstance(state, dict):
        raise ValueError(f"a {type(state).__name__}, expected names and values")
    return state
