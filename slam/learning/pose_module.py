"""The network of the learned pose as PyTorch trains it; `slam.networks.pose_network` is what is used.

Both have weights of the same names and shapes, and a test holds their answers against each other.
Reference: Russell and Reale, Multivariate uncertainty in deep learning, 2021 (the loss).
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from slam.learning.map_module import arrays_of
from slam.networks.pose_network import INPUTS, LIMIT, N_OUTPUTS, PoseNetwork, PoseNetworkConfig


class PoseModule(nn.Module):
    """Offset of the true pose from the predicted one, and the root of its information matrix."""

    def __init__(self, config: PoseNetworkConfig = PoseNetworkConfig()) -> None:
        super().__init__()
        self.config = config
        layers: list[nn.Module] = []
        before = INPUTS
        for width in config.widths:
            layers += [nn.Conv2d(before, width, 3, stride=2, padding=1), nn.ReLU(inplace=True)]
            before = width
        self.look = nn.Sequential(*layers, nn.Flatten())
        self.head = nn.Sequential(
            nn.Linear(config.flat, config.hidden), nn.ReLU(inplace=True), nn.Linear(config.hidden, N_OUTPUTS)
        )

    @classmethod
    def of(cls, network: PoseNetwork) -> "PoseModule":
        """A network in use, to be looked at or trained on."""
        module = cls(network.config)
        module.load_state_dict({name: torch.tensor(array) for name, array in network.weights.items()})
        return module.eval()

    def network(self) -> PoseNetwork:
        """The network with the weights as they are, for use."""
        return PoseNetwork(arrays_of(self), self.config)

    def forward(
        self, patches: Float[Tensor, "b 5 64 64"]
    ) -> tuple[Float[Tensor, "b 3"], Float[Tensor, "b 3 3"]]:
        """Offset x, y, yaw in `UNIT`s, axes of the robot at the predicted pose; and L, with information L L^T."""
        output = self.head(self.look(patches))
        rows, columns = torch.tril_indices(3, 3, offset=-1)
        root = torch.diag_embed(torch.exp(output[:, 3:6].clamp(-LIMIT, LIMIT)))
        root[:, rows, columns] = output[:, 6:]
        return output[:, :3], root


def surprise(
    offset: Float[Tensor, "b 3"], root: Float[Tensor, "b 3 3"], true: Float[Tensor, "b 3"]
) -> Float[Tensor, ""]:
    """Mean negative log-likelihood of true offsets, less its constant: least for the true mean and covariance."""
    whitened = torch.einsum("bji,bj->bi", root, true - offset)
    log_det = torch.log(torch.diagonal(root, dim1=1, dim2=2)).sum(dim=1)
    return (0.5 * (whitened**2).sum(dim=1) - log_det).mean()
