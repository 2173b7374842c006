"""The network of the learned mapper for training in PyTorch; `slam.networks.map_network` runs it.

Both networks have weights of the same names and shapes, and a test compares their outputs.
"""

import itertools

from jaxtyping import Float
from torch import Tensor, nn

from robosim.support.torch_training import weights_of
from slam.networks.map_network import OBSTACLE, SEEN, MapNetwork, NetworkConfig


class MapModule(nn.Module):
    """Logits of obstacle and seen for each cell of a patch."""

    def __init__(self, config: NetworkConfig = NetworkConfig()) -> None:
        super().__init__()
        self.config = config
        widths = config.widths
        self.first = nn.Sequential(_layer(config.inputs, widths[0]), _layer(widths[0], widths[0]))
        pairs = list(itertools.pairwise(widths))
        self.down = nn.ModuleList(nn.Sequential(_layer(a, b, stride=2), _layer(b, b)) for a, b in pairs)
        self.narrow = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairs)
        self.up = nn.ModuleList(_layer(a, a) for a, _ in pairs)
        self.last = nn.Conv2d(widths[0], 2, 1)

    def network(self) -> MapNetwork:
        """The network with the weights as they are, for use."""
        return MapNetwork(weights_of(self), self.config)

    def forward(self, features: Float[Tensor, "b c h w"]) -> Float[Tensor, "b 2 h w"]:
        """Logits; height and width must be multiples of the coarsest cell."""
        scales = [self.first(features)]
        for down in self.down:
            scales.append(down(scales[-1]))
        x = scales.pop()
        for narrow, up in zip(reversed(self.narrow), reversed(self.up), strict=True):
            x = nn.functional.interpolate(narrow(x), scale_factor=2.0, mode="nearest")
            x = up(x + scales.pop())
        return self.last(x)


def _layer(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


def loss(
    logits: Float[Tensor, "b 2 h w"], obstacle: Float[Tensor, "b h w"], seen: Float[Tensor, "b h w"]
) -> Float[Tensor, ""]:
    """Mean cross-entropy of both probabilities, a proper score: its least value is that of calibrated ones."""
    entropy = nn.functional.binary_cross_entropy_with_logits
    return entropy(logits[:, OBSTACLE], obstacle) + 0.3 * entropy(logits[:, SEEN], seen)
