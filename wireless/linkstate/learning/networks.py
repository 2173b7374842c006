"""The network that classifies the link state from estimated paths, as PyTorch trains it.

`wireless.linkstate.forward` runs the trained network, with weights of the same names and shapes, and a test compares
their results. The network lets every path look at every other: a message from each pair's geometry, summed over
partners, twice; then the paths, from the strongest, go through a small dense head. It takes tokens
(`wireless.linkstate.tokens`) and gives logits of the four states.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from wireless.linkstate.features import feature_counts, path_and_pair_features
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
