"""The network of the learned mapper: a small U-Net on the patch ahead.

From the channels of `slam.networks.features` to two logits for each cell: that an obstacle stands in it, seen or not,
and that it is seen. Four scales, 0.05 to 0.4 m a cell; the coarse ones know the room's shape, the fine ones where
exactly the wall is. Skip connections are added rather than stacked, which halves the work at the fine scales.

Reference: Ronneberger et al., U-Net, MICCAI 2015; Ramakrishnan et al., Occupancy anticipation, ECCV 2020.
"""

import itertools
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from slam.networks.features import N_CHANNELS
from slam.support.checks import check_numbers

#: Index of each logit.
OBSTACLE, SEEN = 0, 1
#: Scales that a patch of 64 cells can have, and channels of one.
MOST_SCALES, WIDEST = 7, 512


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Size of the network."""

    widths: tuple[int, ...] = (16, 32, 64, 96)
    """Channels at each scale, finest first; each scale halves the resolution."""
    inputs: int = N_CHANNELS
    """Channels of the input."""

    def __post_init__(self) -> None:
        check_numbers(self, widths=(1, 4096, "channels"), inputs=(1, 1024, "channels"))
        if not 1 <= len(self.widths) <= 7:
            raise ValueError(f"widths is {self.widths}, expected one to seven numbers of channels.")


class MapNetwork(nn.Module):
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


def parameters(network: nn.Module) -> int:
    """Count of trained numbers."""
    return sum(p.numel() for p in network.parameters())


def mirrored(patches: Tensor) -> Tensor:
    """Patches as they would be with left and right exchanged, the place channels apart."""
    return torch.flip(patches, dims=[-2])
