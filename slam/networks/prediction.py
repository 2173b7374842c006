"""Prediction of a trained mapper for one frame."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from slam.grid import GridFrame
from slam.networks.features import Features
from slam.networks.map_network import OBSTACLE, SEEN, MapNetwork
from slam.sensing.egocentric import AHEAD
from slam.sensing.projection import Scan


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Logits for the patch ahead: their logistic function is the probability."""

    obstacle: Float32[np.ndarray, "ny nx"]
    """An obstacle stands in the cell, seen or not."""
    seen: Float32[np.ndarray, "ny nx"]
    """The camera sees the cell."""


class MapPredictor:
    """A trained network, ready to be asked."""

    def __init__(self, network: MapNetwork, patch: GridFrame = AHEAD) -> None:
        """Take a network."""
        self.features = Features(patch=patch)
        self._network = network

    def predict(self, scan: Scan, belief: Float32[np.ndarray, "ny nx"]) -> Prediction:
        """Logits for one frame."""
        logits = self._network(self.features.of_scan(scan, belief)[None])[0]
        return Prediction(obstacle=logits[OBSTACLE], seen=logits[SEEN])
