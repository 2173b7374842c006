"""Asking a trained mapper about one frame."""

import copy
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from slam.grid import GridFrame
from slam.networks.features import Features
from slam.networks.map_network import OBSTACLE, SEEN, MapNetwork
from slam.sensing.egocentric import AHEAD
from slam.sensing.projection import Scan
from slam.support.threads import torch_threads


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """What is told of the patch ahead, as logits: their logistic function is the probability."""

    obstacle: Float32[np.ndarray, "ny nx"]
    """An obstacle stands in the cell, seen or not."""
    seen: Float32[np.ndarray, "ny nx"]
    """The camera sees the cell."""


class MapPredictor:
    """A trained network, ready to be asked."""

    def __init__(self, network: MapNetwork, patch: GridFrame = AHEAD) -> None:
        """Take a copy of a network, with normalisation merged into its convolutions.

        Args:
            network: A trained network.
            patch: The cells asked about; those that the network was trained on.
        """
        self.features = Features(patch=patch)
        self._network: nn.Module = copy.deepcopy(network).eval()
        _merge(self._network)
        self._network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def predict(self, scan: Scan, belief: Float32[np.ndarray, "ny nx"]) -> Prediction:
        """Logits for one frame.

        Args:
            scan: The frame's scan (`slam.sensing.projection`).
            belief: Obstacle probability of the map over the patch, 0.5 where unknown.
        """
        features = torch.from_numpy(self.features.of_scan(scan, belief))[None]
        with torch.inference_mode(), torch_threads(1):
            logits = self._network(features.contiguous(memory_format=torch.channels_last))[0].numpy()
        return Prediction(obstacle=logits[OBSTACLE], seen=logits[SEEN])


def _merge(module: nn.Module) -> None:
    """Make one of each convolution and the normalisation after it."""
    for name, child in module.named_children():
        parts = list(child) if isinstance(child, nn.Sequential) else []
        if len(parts) == 3 and isinstance(parts[0], nn.Conv2d) and isinstance(parts[1], nn.BatchNorm2d):
            setattr(module, name, nn.Sequential(fuse_conv_bn_eval(parts[0], parts[1]), parts[2]))
        else:
            _merge(child)
