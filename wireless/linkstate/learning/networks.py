"""Networks that classify the link state from estimated paths, as PyTorch trains them.

Ours and the published one; `wireless.linkstate.forward` is what is used of them, with weights of
the same names and shapes, and a test compares their results.

`RelationNetwork` lets every path look at every other: a message from each pair's geometry, summed over partners,
twice; then the paths, from the strongest, go through a small dense head. `ReferenceNetwork` is the published
network on scaled raw estimates, 8 and 6 hidden units. Both take tokens (`wireless.linkstate.tokens`) and give logits
of the four states.

Reference: Yin et al., arXiv 2110.14789.
"""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from wireless.linkstate.features import feature_counts, path_and_pair_features, scaled_estimates
from wireless.linkstate.forward import N_STATES
from wireless.linkstate.tokens import N_PATHS


class RelationNetwork(nn.Module):
    """Messages between paths, then a dense head."""

    def __init__(
        self, inputs: Sequence[str], *, width: int = 48, rounds: int = 2, dropout: float = 0.2
    ) -> None:
        super().__init__()
        self.inputs = tuple(inputs)
        n_path, n_pair = feature_counts(inputs)
        self.embed = nn.Sequential(nn.Linear(n_path + N_PATHS, width), nn.ReLU(), nn.Linear(width, width))
        self.rounds = nn.ModuleList(_Round(n_pair, width) for _ in range(rounds))
        self.head = nn.Sequential(
            nn.Dropout(dropout),
            nn.Linear((N_PATHS + 1) * width, 2 * width),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(2 * width, 2 * width),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(2 * width, N_STATES),
        )
        self.register_buffer("rank", torch.eye(N_PATHS), persistent=False)

    def forward(self, tokens: Float[Tensor, "n 5 5"]) -> Float[Tensor, "n 4"]:
        """Logits of the states."""
        path, pair, there = map(torch.from_numpy, path_and_pair_features(tokens.numpy(), self.inputs))
        present = there[..., None].to(path.dtype)
        rank = self.get_buffer("rank").expand(len(path), -1, -1)
        state = self.embed(torch.cat([path, rank], -1)) * present
        for one_round in self.rounds:
            state = one_round(state, pair, present)
        return self.head(torch.cat([state.flatten(1), state.amax(1)], -1))


class _Round(nn.Module):
    """Each path takes the mean message of all paths, its own included, and moves on from where it was."""

    def __init__(self, n_pair: int, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        # Linear in [pair, to, from] side by side, without making that array.
        self.pair = nn.Linear(n_pair, width // 2)
        self.taker, self.giver = (nn.Linear(width, width // 2, bias=False) for _ in range(2))
        self.message = nn.Linear(width // 2, width)
        self.update = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, width))

    def forward(self, state: Tensor, pair: Tensor, present: Tensor) -> Tensor:
        """States of the paths after one exchange; missing paths send nothing and stay 0."""
        seen = self.norm(state)
        sent = (
            torch.relu(self.pair(pair) + self.taker(seen)[:, :, None] + self.giver(seen)[:, None])
            * present[:, None]
        )
        return (state + self.update(torch.cat([seen, self.message(sent.mean(2))], -1))) * present


class ReferenceNetwork(nn.Module):
    """The published network on the raw estimates, scaled as published."""

    def __init__(self, inputs: Sequence[str]) -> None:
        super().__init__()
        self.inputs = tuple(inputs)
        n_inputs = N_PATHS * len(self.inputs)
        self.layers = nn.Sequential(
            nn.Linear(n_inputs, 8), nn.ReLU(), nn.Linear(8, 6), nn.ReLU(), nn.Linear(6, N_STATES)
        )

    def forward(self, tokens: Float[Tensor, "n 5 5"]) -> Float[Tensor, "n 4"]:
        """Logits of the states."""
        return self.layers(torch.from_numpy(scaled_estimates(tokens.numpy(), self.inputs)))


#: Networks by name.
NETWORKS: dict[str, Callable[..., nn.Module]] = {
    "ours": RelationNetwork,
    "reference": ReferenceNetwork,
}
