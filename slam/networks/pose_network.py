"""Network of the learned pose: estimates the error of a predicted pose from the map and the scan.

Its inputs are the patch of the map ahead of the predicted pose and, on the same cells, the frame's scan
(`slam.networks.features`). Its outputs are the offset that aligns both, and the information matrix of the offset: small
along a bare corridor, large across it. The matrix is the square of a triangular one, so that it is always positive.
This module runs the network; `slam.learning.pose` trains it.
Reference: Chaplot et al., Learning to Explore using Active Neural SLAM, ICLR 2020 (from patch to patch).
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, Float32

from robosim.support.checks import Range, checked
from robosim.support.weights import Weights, check_weights, trained_numbers
from slam.networks.onnx_graph import OnnxGraph, OnnxRunner
from slam.networks.weights import convolution_shapes

#: Channels: what the scan says (the first four of `slam.networks.features`), and the map's belief.
INPUTS = 5
#: Cells along a side of the patch.
SIDE = 64
#: Units of the network's outputs: x, y [m], yaw [rad].
UNIT = (0.05, 0.05, 0.04)
#: Standard deviation of predicted poses in training, the prior in the answers: x, y [m], yaw [rad].
SPREAD = UNIT
#: Number of outputs (offset, logarithms of the root's diagonal, entries below it), and bound of the logarithms.
N_OUTPUTS, LIMIT = 9, 4.0


@dataclass(frozen=True, kw_only=True)
@checked
class PoseNetworkConfig:
    """Size of the network."""

    widths: Annotated[tuple[int, ...], Range(1, 4096, "channels")] = (24, 32, 48, 64)
    """Channels at each scale; each halves the resolution of the patch."""
    hidden: Annotated[int, Range(1, 65_536, "units")] = 96
    """Width of the layer that sees the whole patch."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.widths) <= 6:
            raise ValueError(f"widths is {self.widths}, expected one to six numbers of channels.")

    @property
    def flat(self) -> int:
        """Numbers that the layer is shown which sees the whole patch."""
        return self.widths[-1] * (SIDE >> len(self.widths)) ** 2


class PoseNetwork:
    """Offset of the true pose from the predicted one, and the root of its information matrix, by trained weights."""

    def __init__(self, weights: Weights, config: PoseNetworkConfig = PoseNetworkConfig()) -> None:
        """Make a network ready; ValueError if they do not fit each other, or a weight is no number."""
        check_weights(weights, pose_shapes(config))
        self.weights, self.config = dict(weights), config
        self._run = OnnxRunner(_model(weights, config))

    @property
    def parameters(self) -> int:
        """Count of trained numbers."""
        return trained_numbers(self.weights)

    def __call__(
        self, patches: Float32[np.ndarray, "b 5 64 64"]
    ) -> tuple[Float[np.ndarray, "b 3"], Float[np.ndarray, "b 3 3"]]:
        """Offset x, y, yaw in `UNIT`s, axes of the robot at the predicted pose; and L, with information L L^T."""
        output = self._run(patches=patches).astype(float)
        root = np.zeros((len(output), 3, 3))
        root[:, range(3), range(3)] = np.exp(np.clip(output[:, 3:6], -LIMIT, LIMIT))
        root[:, (1, 2, 2), (0, 0, 1)] = output[:, 6:]
        return output[:, :3], root


def pose_shapes(config: PoseNetworkConfig) -> dict[str, tuple[int, ...]]:
    """Shape of each weight."""
    shapes: dict[str, tuple[int, ...]] = {}
    before = INPUTS
    for i, width in enumerate(config.widths):
        shapes |= convolution_shapes(f"look.{2 * i}", before, width)
        before = width
    return shapes | {
        "head.0.weight": (config.hidden, config.flat),
        "head.0.bias": (config.hidden,),
        "head.2.weight": (N_OUTPUTS, config.hidden),
        "head.2.bias": (N_OUTPUTS,),
    }


def _model(weights: Weights, config: PoseNetworkConfig) -> bytes:
    graph = OnnxGraph()

    def of(name: str) -> tuple[str, str]:
        return graph.weight(weights[f"{name}.weight"]), graph.weight(weights[f"{name}.bias"])

    x = "patches"
    for i in range(len(config.widths)):
        x = graph.node("Conv", x, *of(f"look.{2 * i}"), pads=(1, 1, 1, 1), strides=(2, 2))
        x = graph.node("Relu", x)
    x = graph.node("Flatten", x)
    x = graph.node("Relu", graph.node("Gemm", x, *of("head.0"), transB=1))
    x = graph.node("Gemm", x, *of("head.2"), transB=1)
    return graph.model({"patches": ("b", INPUTS, SIDE, SIDE)}, x)
