"""Trained weights as arrays: checks, and normalisation merged into convolutions."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float32

from slam.support.weights import check_values

Weights = Mapping[str, np.ndarray]
#: Added to variances by batch normalisation; PyTorch's default.
_EPSILON = 1e-5


def check_weights(weights: Weights, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Check that weights fit a network.

    Raises:
        ValueError: If names, shapes or types differ, a value is NaN, infinite or too large, or a variance is negative.
    """
    kinds = {name: np.int64 if name.endswith("num_batches_tracked") else np.float32 for name in shapes}
    if {k: (w.shape, w.dtype) for k, w in weights.items()} != {
        k: (shape, np.dtype(kinds[k])) for k, shape in shapes.items()
    }:
        raise ValueError("other names, shapes or kinds of numbers")
    check_values(weights)


def trained_numbers(weights: Weights) -> int:
    """Count of trained numbers: all but what batch normalisation counts by itself."""
    counted = ("running_mean", "running_var", "num_batches_tracked")
    return sum(array.size for name, array in weights.items() if not name.endswith(counted))


def convolution_shapes(
    name: str, inputs: int, outputs: int, side: int = 3, *, normalised: bool = False
) -> dict[str, tuple[int, ...]]:
    """Shapes of a convolution's weights: with a bias, or with batch normalisation after it instead."""
    if not normalised:
        return {f"{name}.weight": (outputs, inputs, side, side), f"{name}.bias": (outputs,)}
    of_norm = {f"{name}.1.{kind}": (outputs,) for kind in ("weight", "bias", "running_mean", "running_var")}
    return {
        f"{name}.0.weight": (outputs, inputs, side, side),
        **of_norm,
        f"{name}.1.num_batches_tracked": (),
    }


def merged(weights: Weights, name: str) -> tuple[Float32[np.ndarray, "o i h w"], Float32[np.ndarray, " o"]]:
    """Return weight and bias of a convolution merged with the normalisation after it.

    Reference: Ioffe and Szegedy, Batch normalization, ICML 2015, section 3.1.
    """
    gain, shift, mean, variance = (
        weights[f"{name}.1.{kind}"].astype(float)
        for kind in ("weight", "bias", "running_mean", "running_var")
    )
    scale = gain / np.sqrt(variance + _EPSILON)
    kernel = weights[f"{name}.0.weight"].astype(float) * scale[:, None, None, None]
    return kernel.astype(np.float32), (shift - mean * scale).astype(np.float32)
