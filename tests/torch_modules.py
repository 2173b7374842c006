"""Networks in use, as the modules that PyTorch trains."""

import torch

from slam.learning.map_module import MapModule
from slam.learning.pose import PoseModule


def module_of(network):
    """The module of a `MapNetwork` or `PoseNetwork`, with its weights."""
    module = (MapModule if type(network).__name__ == "MapNetwork" else PoseModule)(network.config)
    module.load_state_dict({name: torch.tensor(array) for name, array in network.weights.items()})
    return module.eval()
