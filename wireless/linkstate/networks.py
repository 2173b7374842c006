"""Networks that tell the link state from estimated paths: ours, the published one, and hand-made features.

`RelationNetwork` lets every path look at every other: a message from each pair's geometry, summed over partners,
twice; then the paths, from the strongest, go through a small dense head. `ReferenceNetwork` is the published
network on scaled raw estimates, 8 and 6 hidden units. `MomentsNetwork` sees a channel's moments only, after
Huang et al.; the public estimates have no delays, so delay spread, excess delay and rise time are missing there.
All take tokens (`wireless.linkstate.tokens`) and give logits of the four states.

References: Yin et al., arXiv 2110.14789; Huang et al., "Machine-learning-enabled LOS/NLOS identification for MIMO
systems in dynamic environments", IEEE TWC 2020.
"""

import math
from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from wireless.linkstate.features import feature_counts, path_and_pair_features, wrapped
from wireless.linkstate.tokens import AOA, AOD, DELAY, N_PATHS, PEAK, SNR

N_STATES = 4
#: Widest network that is made; weights that are read must fit into memory.
WIDEST = 512


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
        path, pair, there = path_and_pair_features(tokens, self.inputs)
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
        self.layers = _published_layers(N_PATHS * len(self.inputs))

    def forward(self, tokens: Float[Tensor, "n 5 5"]) -> Float[Tensor, "n 4"]:
        """Logits of the states."""
        x = torch.nan_to_num(tokens, nan=0.0)
        snr = ((x[..., SNR] - 5) / 45).clamp(0, 1) * torch.isfinite(tokens[..., SNR])
        scaled = {
            "aoa": x[..., AOA] / math.pi,
            "aod": x[..., AOD] / math.pi,
            "snr": snr,
            "peak": x[..., PEAK] / 30,
            "delay": (x[..., DELAY] - x[:, :1, DELAY]) / 100e-9,
        }
        return self.layers(torch.cat([scaled[name] for name in self.inputs], -1))


class MomentsNetwork(nn.Module):
    """Hand-made features: powers, K-factor, kurtosis and skewness of power, spreads of angles and delays."""

    def __init__(self, inputs: Sequence[str]) -> None:
        super().__init__()
        self.inputs = tuple(inputs)
        self.norm = nn.BatchNorm1d(moments(torch.zeros(1, N_PATHS, 5), inputs).shape[1], affine=False)
        self.layers = _published_layers(self.norm.num_features)

    def forward(self, tokens: Float[Tensor, "n 5 5"]) -> Float[Tensor, "n 4"]:
        """Logits of the states."""
        return self.layers(self.norm(moments(tokens, self.inputs)))


def moments(tokens: Float[Tensor, "n 5 5"], inputs: Sequence[str]) -> Float[Tensor, "n f"]:
    """Moments of the estimated channel.

    Returns:
        Total and strongest SNR [dB], K-factor [dB], skewness and kurtosis of path SNRs [dB]; the power-weighted
        circular spread sqrt(-2 ln R) [rad] of arrivals, and of departures if used; mean excess delay, delay
        spread and rise time from first to strongest [100 ns] if delays are used.
    """
    there = torch.isfinite(tokens[..., SNR])
    x = torch.nan_to_num(tokens, nan=0.0)
    power = (10 ** (x[..., SNR] / 10)) * there
    total = power.sum(1).clamp_min(1e-6)
    weight = power / total[:, None]
    level = x[..., SNR]
    count = there.sum(1).clamp_min(1)
    centred = (level - (level.sum(1) / count)[:, None]) * there
    spread = ((centred**2).sum(1) / count).clamp_min(1e-6)
    strongest = power.amax(1).clamp_min(1e-6)
    features = [
        10 * total.log10(),
        10 * strongest.log10(),
        10 * (strongest / (total - strongest).clamp_min(1e-3)).log10(),
        (centred**3).sum(1) / count / spread**1.5,
        (centred**4).sum(1) / count / spread**2,
    ]
    for name, column in (("aoa", AOA), ("aod", AOD)):
        if name in inputs:
            angle = wrapped(x[..., column])
            length = torch.hypot((weight * angle.cos()).sum(1), (weight * angle.sin()).sum(1))
            features.append((-2 * length.clamp(1e-6, 1).log()).sqrt())
    if "delay" in inputs:
        delay = x[..., DELAY] / 100e-9
        first = torch.where(there, delay, torch.inf).amin(1)
        excess = torch.where(there, delay - torch.nan_to_num(first, posinf=0.0)[:, None], 0.0)
        mean = (weight * excess).sum(1)
        features += [mean, (weight * (excess - mean[:, None]) ** 2).sum(1).clamp_min(0).sqrt(), excess[:, 0]]
    return torch.stack(features, 1)


def _published_layers(n_inputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(n_inputs, 8), nn.ReLU(), nn.Linear(8, 6), nn.ReLU(), nn.Linear(6, N_STATES)
    )


#: Networks by name.
NETWORKS: dict[str, Callable[..., nn.Module]] = {
    "ours": RelationNetwork,
    "reference": ReferenceNetwork,
    "huang": MomentsNetwork,
}
