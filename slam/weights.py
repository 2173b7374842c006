"""Weights of small networks that run in NumPy, from files."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from safetensors import SafetensorError
from safetensors.numpy import load_file

Weights = Mapping[str, Float32[np.ndarray, "..."]]


def read_weights(path: Path, like: Weights, what: str) -> Weights:
    """Weights from a .safetensors file.

    Args:
        path: The file.
        like: Weights of the names and shapes expected.
        what: What they are of, as `robosim train` calls it.

    Raises:
        ValueError: If the file is missing, damaged, or of something else.
    """
    try:
        weights = load_file(path)
        if {name: w.shape for name, w in weights.items()} != {name: w.shape for name, w in like.items()}:
            raise ValueError("other names or shapes")
    except (OSError, SafetensorError, ValueError) as error:
        raise ValueError(
            f"{path} holds no weights of {what} ({error}). Train them anew with `robosim train {what}`."
        ) from error
    return weights
