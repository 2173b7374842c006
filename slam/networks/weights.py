"""Weights of convolutions: their shapes, and normalisation merged into them."""

import numpy as np
from jaxtyping import Float32

from robosim.support.weights import Weights

#: Added to variances by batch normalisation; PyTorch's default.
_EPSILON = 1e-5


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
