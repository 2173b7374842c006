"""Networks in use, as the modules that PyTorch trains."""

import torch

from slam.learning.map_module import MapModule


def module_of(network):
    """The module of a `MapNetwork`, with its weights."""
    module = MapModule(network.config)
    module.load_state_dict({name: torch.tensor(array) for name, array in network.weights.items()})
    return module.eval()
