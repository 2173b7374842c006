"""States of training that was interrupted, read back: whole, of the same training, and such as it can go on from."""

import zipfile
from collections.abc import Mapping
from typing import Any, BinaryIO

import torch


def load_checkpoint(file: BinaryIO) -> dict[str, Any]:
    """What `torch.save` wrote into a file; no code in it is run.

    Raises:
        ValueError: If its bytes are not those that were written.
        Exception: Whatever other damage makes the reader raise.
    """
    with zipfile.ZipFile(file) as archive:
        if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
            raise ValueError("it is packed in another way than PyTorch does")
        # PyTorch itself does not look at the check sums.
        if (damaged := archive.testzip()) is not None:
            raise ValueError(f"the check sum of {damaged} is wrong")
    file.seek(0)
    kept = torch.load(file, weights_only=True)
    if not isinstance(kept, dict):
        raise ValueError(f"a {type(kept).__name__}, expected names and values")
    return kept


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
