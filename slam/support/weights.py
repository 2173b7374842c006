"""Weights of small networks that run in NumPy, from files."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from safetensors.numpy import load

from slam.support.reading import reading

Weights = Mapping[str, Float32[np.ndarray, "..."]]


def read_weights(path: Path, like: Weights, what: str) -> Weights:
    """Weights from a .safetensors file.

    Args:
        path: The file.
        like: Weights of the names, shapes and kinds expected.
        what: What they are of, as `robosim train` calls it.

    Raises:
        FileError: If the file is missing, damaged, or of something else.
    """
    with reading(path, f"weights of {what}", f"Train them anew with `robosim train {what}`.") as file:
        weights: Weights = load(file.read())
        if {k: (w.shape, w.dtype) for k, w in weights.items()} != {
            k: (w.shape, w.dtype) for k, w in like.items()
        }:
            raise ValueError("other names, shapes or kinds of numbers")
        if wrong := [name for name, values in weights.items() if not np.isfinite(values).all()]:
            raise ValueError(f"{wrong[0]} has values that are no numbers")
        return weights
