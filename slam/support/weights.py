"""Weights of small networks that run in NumPy, from files."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from safetensors.numpy import load

from robosim.support.reading import reading

Weights = Mapping[str, Float32[np.ndarray, "..."]]
#: Largest magnitude of a weight. Trained weights are of order one; damaged ones overflow float32.
LARGEST = 1e6


def check_values(weights: Mapping[str, np.ndarray]) -> None:
    """Check that trained numbers are plausible.

    Raises:
        ValueError: If one is NaN, infinite or above `LARGEST`, or a variance is negative.
    """
    for name, values in weights.items():
        if values.dtype.kind == "f" and not (np.abs(values) <= LARGEST).all():
            raise ValueError(f"{name} has values that are NaN, infinite or above {LARGEST:,.0f}")
        if name.endswith("running_var") and (values < 0).any():
            raise ValueError(f"{name} has negative variances")


def read_weights(path: Path, like: Weights, what: str) -> Weights:
    """Weights from a .safetensors file.

    Raises:
        FileError: If the file is missing, damaged, or of something else.
    """
    with reading(path, f"weights of {what}", f"Train them again with `robosim train {what}`.") as file:
        weights: Weights = load(file.read())
        if {k: (w.shape, w.dtype) for k, w in weights.items()} != {
            k: (w.shape, w.dtype) for k, w in like.items()
        }:
            raise ValueError("other names, shapes or kinds of numbers")
        check_values(weights)
        return weights
