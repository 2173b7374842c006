"""The network of the learned pose: how far off a predicted pose is, from the map there and what the camera sees.

It is shown the patch of the map ahead of the predicted pose and, on the same cells, the frame's scan
(`slam.networks.features`). Where both fit, the pose is right; how the one must be moved to fit the other is the answer,
with its information matrix: along a bare corridor little is known, across it much. The matrix is the square of a
triangular one, so that it is positive whatever the network says.
Reference: Chaplot et al., Learning to Explore using Active Neural SLAM, ICLR 2020 (from patch to patch); Russell and
Reale, Multivariate uncertainty in deep learning, 2021 (the loss).
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from slam.support.checks import check_numbers

#: Channels: what the scan says (the first four of `slam.networks.features`), and the map's belief.
INPUTS = 5
#: What counts as 1 in the network's answers: x, y [m], yaw [rad].
UNIT = (0.05, 0.05, 0.04)
#: Standard deviation of predicted poses in training, the prior in the answers: x, y [m], yaw [rad].
SPREAD = UNIT
#: Channels of a scale, and weights of the layer that sees the whole patch.
WIDEST, MOST_WEIGHTS = 512, 20_000_000


@dataclass(frozen=True, kw_only=True)
class PoseNetworkConfig:
    """Size of the network."""

    widths: tuple[int, ...] = (24, 32, 48, 64)
    """Channels at each scale; each halves the resolution of the patch."""
    hidden: int = 96
    """Width of the layer that sees the whole patch."""

    def __post_init__(self) -> None:
        check_numbers(self, widths=(1, 4096, "channels"), hidden=(1, 65_536, "units"))
        if not 1 <= len(self.widths) <= 6:
            raise ValueError(f"widths is {self.widths}, expected one to six numbers of channels.")


class PoseNetwork(nn.Module):
    """Offset of the true pose from the predicted one, and the root of its information matrix."""

    def __init__(self, config: PoseNetworkConfig = PoseNetworkConfig()) -> None:
        super().__init__()
        self.config = config
        layers: list[nn.Module] = []
        before = INPUTS
        for width in config.widths:
            layers += [nn.Conv2d(before, width, 3, stride=2, padding=1), nn.ReLU(inplace=True)]
            before = width
        side = 64 >> len(config.widths)
        self.look = nn.Sequential(*layers, nn.Flatten())
        self.tell = nn.Sequential(
            nn.Linear(before * side * side, config.hidden), nn.ReLU(inplace=True), nn.Linear(config.hidden, 9)
        )

    def forward(
        self, patches: Float[Tensor, "b 5 64 64"]
    ) -> tuple[Float[Tensor, "b 3"], Float[Tensor, "b 3 3"]]:
        """Offset x, y, yaw in `UNIT`s, axes of the robot at the predicted pose; and L, with information L L^T."""
        told = self.tell(self.look(patches))
        rows, columns = torch.tril_indices(3, 3, offset=-1)
        root = torch.diag_embed(torch.exp(told[:, 3:6].clamp(-4, 4)))
        root[:, rows, columns] = told[:, 6:]
        return told[:, :3], root


def surprise(
    offset: Float[Tensor, "b 3"], root: Float[Tensor, "b 3 3"], true: Float[Tensor, "b 3"]
) -> Float[Tensor, ""]:
    """Mean negative log-likelihood of true offsets, less its constant: least for the true mean and covariance."""
    whitened = torch.einsum("bji,bj->bi", root, true - offset)
    log_det = torch.log(torch.diagonal(root, dim1=1, dim2=2)).sum(dim=1)
    return (0.5 * (whitened**2).sum(dim=1) - log_det).mean()
