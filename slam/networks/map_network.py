"""The network of the learned mapper: a small U-Net on the patch ahead.

From the channels of `slam.networks.features` to two logits for each cell: that an obstacle stands in it, seen or not,
and that it is seen. Four scales, 0.05 to 0.4 m per cell: coarse ones for the room's shape, fine ones for the
exact place of walls. Skip connections are added rather than stacked, which halves the work at the fine scales.
This module runs the network; `slam.learning.map_module` trains it.

Reference: Ronneberger et al., U-Net, MICCAI 2015; Ramakrishnan et al., Occupancy anticipation, ECCV 2020.
"""

import itertools
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float32

from robosim.support.checks import Range, checked
from robosim.support.weights import Weights, check_weights, trained_numbers
from slam.networks.features import N_CHANNELS, Features
from slam.networks.onnx_graph import OnnxGraph, OnnxRunner
from slam.networks.weights import convolution_shapes, merged
from slam.sensing.projection import Scan

#: Index of each logit.
OBSTACLE, SEEN = 0, 1


@dataclass(frozen=True, kw_only=True)
@checked
class NetworkConfig:
    """Size of the network."""

    widths: Annotated[tuple[int, ...], Range(1, 4096, "channels")] = (16, 32, 64, 96)
    """Channels at each scale, finest first; each scale halves the resolution."""
    inputs: Annotated[int, Range(1, 1024, "channels")] = N_CHANNELS
    """Channels of the input."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.widths) <= 7:
            raise ValueError(f"widths is {self.widths}, expected one to seven numbers of channels.")


class MapNetwork:
    """Logits of obstacle and seen for each cell of a patch, by trained weights."""

    def __init__(self, weights: Weights, config: NetworkConfig = NetworkConfig()) -> None:
        """Make a network ready; ValueError if they do not fit each other, or a weight is no number."""
        check_weights(weights, map_shapes(config))
        self.weights, self.config = dict(weights), config
        self._run = OnnxRunner(_model(weights, config))

    @property
    def parameters(self) -> int:
        """Count of trained numbers."""
        return trained_numbers(self.weights)

    def __call__(self, features: Float32[np.ndarray, "b c h w"]) -> Float32[np.ndarray, "b 2 h w"]:
        """Logits; height and width must be multiples of the coarsest cell."""
        return self._run(features=features)


def map_shapes(config: NetworkConfig) -> dict[str, tuple[int, ...]]:
    """Shape of each weight."""
    first, pairs = config.widths[0], list(itertools.pairwise(config.widths))
    shapes = convolution_shapes("first.0", config.inputs, first, normalised=True)
    shapes |= convolution_shapes("first.1", first, first, normalised=True)
    for i, (fine, coarse) in enumerate(pairs):
        shapes |= convolution_shapes(f"down.{i}.0", fine, coarse, normalised=True)
        shapes |= convolution_shapes(f"down.{i}.1", coarse, coarse, normalised=True)
        shapes |= convolution_shapes(f"narrow.{i}", coarse, fine, 1)
        shapes |= convolution_shapes(f"up.{i}", fine, fine, normalised=True)
    return shapes | convolution_shapes("last", first, 2, 1)


def _model(weights: Weights, config: NetworkConfig) -> bytes:
    graph = OnnxGraph()

    def layer(name: str, x: str, stride: int = 1) -> str:
        kernel, bias = (graph.weight(array) for array in merged(weights, name))
        x = graph.node("Conv", x, kernel, bias, pads=(1, 1, 1, 1), strides=(stride, stride))
        return graph.node("Relu", x)

    def mix(name: str, x: str) -> str:
        kernel, bias = (graph.weight(weights[f"{name}.{kind}"]) for kind in ("weight", "bias"))
        return graph.node("Conv", x, kernel, bias)

    twice = graph.weight(np.array([1, 1, 2, 2], np.float32))
    x = layer("first.1", layer("first.0", "features"))
    scales = [x]
    for i in range(len(config.widths) - 1):
        x = layer(f"down.{i}.1", layer(f"down.{i}.0", x, stride=2))
        scales.append(x)
    x = scales.pop()
    for i in reversed(range(len(config.widths) - 1)):
        x = graph.node(
            "Resize", mix(f"narrow.{i}", x), "", twice,
            mode="nearest", coordinate_transformation_mode="asymmetric", nearest_mode="floor",
        )  # fmt: skip
        x = layer(f"up.{i}", graph.node("Add", x, scales.pop()))
    return graph.model({"features": ("b", config.inputs, "h", "w")}, mix("last", x))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Logits for the patch ahead: their logistic function is the probability."""

    obstacle: Float32[np.ndarray, "ny nx"]
    """An obstacle stands in the cell, seen or not."""
    seen: Float32[np.ndarray, "ny nx"]
    """The camera sees the cell."""


class MapPredictor:
    """A trained network, ready to be asked."""

    def __init__(self, network: MapNetwork) -> None:
        """Take a network."""
        self.features = Features()
        self._network = network

    def predict(self, scan: Scan, belief: Float32[np.ndarray, "ny nx"]) -> Prediction:
        """Logits for one frame."""
        logits = self._network(self.features.of_scan(scan, belief)[None])[0]
        return Prediction(obstacle=logits[OBSTACLE], seen=logits[SEEN])
