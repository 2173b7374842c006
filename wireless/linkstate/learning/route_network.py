"""The link state along a robot's route: a small recurrent network over classification and measurement at each place.

A hand-made filter of the probabilities does not help: a classifier is surest where the state changes, and its
errors persist for metres, so that a Markov chain in the distance moved loses more at borders than it gains
between them (measured: 1 to 2 points worse than each measurement alone). The informative feature is how
measurements change with the robot's moves: the arrival from a far transmitter stays, the one from a near corner turns.

The network's output is added to the log probability of the place itself, so that it starts from there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Integer
from torch import Tensor, nn

from wireless.linkstate.features import place_feature_count, place_features
from wireless.linkstate.forward import N_STATES, Weights
from wireless.linkstate.learning.networks import one_thread

#: Longer routes are cut into pieces of so many places for training.
PIECE = 60


class RouteNetwork(nn.Module):
    """A gated recurrent unit over the places of a route."""

    def __init__(self, inputs: Sequence[str], *, width: int = 32) -> None:
        super().__init__()
        self.inputs = tuple(inputs)
        self.embed = nn.Linear(place_feature_count(inputs), width)
        self.memory = nn.GRU(width, width, batch_first=True)
        self.out = nn.Linear(2 * width, N_STATES)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self,
        features: Float[Tensor, "routes places f"],
        memory: Float[Tensor, "1 routes width"] | None = None,
    ) -> tuple[Float[Tensor, "routes places 4"], Float[Tensor, "1 routes width"]]:
        """Logits at each place from all places up to it, and what to remember."""
        seen = torch.relu(self.embed(features))
        remembered, memory = self.memory(seen, memory)
        return features[..., :N_STATES] + self.out(torch.cat([seen, remembered], -1)), memory


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteBatch:
    """Routes of equal length; shorter ones are filled up at their ends."""

    features: Float[Tensor, "routes places f"]
    """From `place_features`."""
    state: Int[Tensor, "routes places"]
    """True states."""
    there: Bool[Tensor, "routes places"]
    """Which places are no filling."""


def pack_routes(
    rows: Sequence[Int[np.ndarray, " _"]],
    moved_m: Sequence[Float[np.ndarray, " _"]],
    probability: Float[np.ndarray, "n 4"],
    tokens: Float[np.ndarray, "n 5 5"],
    state: Integer[np.ndarray, " n"],
    inputs: Sequence[str],
) -> RouteBatch:
    """Routes along rows of links, cut into pieces of at most `PIECE` places."""
    pieces = [
        (row[i : i + PIECE], move[i : i + PIECE])
        for row, move in zip(rows, moved_m, strict=True)
        for i in range(0, len(row), PIECE)
    ]
    links = np.stack([np.pad(row, (0, PIECE - len(row)), mode="edge") for row, _ in pieces])
    moves = np.stack([np.pad(move, (0, PIECE - len(move))) for _, move in pieces])
    moves[:, 0] = 0
    features = place_features(
        probability[links].astype(np.float32),
        tokens[links].astype(np.float32),
        moves.astype(np.float32),
        inputs,
    )
    there = np.arange(PIECE) < np.array([len(row) for row, _ in pieces])[:, None]
    return RouteBatch(
        features=torch.from_numpy(features),
        state=torch.from_numpy(state[links]).long(),
        there=torch.from_numpy(there),
    )


def route_network_of(weights: Weights, inputs: Sequence[str]) -> RouteNetwork:
    """The network of trained weights."""
    network = RouteNetwork(inputs, width=len(weights["embed.bias"]))
    network.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
    return network.eval()


def train_route_network(
    batch: RouteBatch, inputs: Sequence[str], *, seed: int, epochs: int = 12, size: int = 64, width: int = 32
) -> RouteNetwork:
    """Train by cross entropy over all places with AdamW and one cycle of learning rate; reproducible for a seed."""
    with one_thread(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return _train(batch, RouteNetwork(inputs, width=width), epochs, size).eval()


def _train(batch: RouteBatch, network: RouteNetwork, epochs: int, size: int) -> RouteNetwork:
    n = len(batch.features)
    optimiser = torch.optim.AdamW(network.parameters(), 4e-3, weight_decay=0.1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=epochs * -(-n // size))
    for _ in range(epochs):
        for routes in torch.randperm(n).split(size):
            there = batch.there[routes]
            logits = network(batch.features[routes])[0][there]
            loss = nn.functional.cross_entropy(logits, batch.state[routes][there])
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            schedule.step()
    return network
