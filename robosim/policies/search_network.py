"""A small recurrent network that searches: from what is sensed to the next action, in ONNX Runtime.

One layer of rectified units, a gated recurrent unit that remembers, and two readings of its memory: scores of the three
actions, and what is still to be earned, which only training asks for.

    e  = relu(x We + be)
    r  = s(e Wr + h Ur + b),  z = s(e Wz + h Uz + b),  n = tanh(e Wn + b + r (h Un + c))
    h' = (1 - z) n + z h

Reference: Cho et al., Learning phrase representations using RNN encoder-decoder, EMNLP 2014, in the form of PyTorch's
`GRUCell`, whose weights these are, transposed.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from robosim.policies.search_senses import INPUTS
from slam.actions import PUBLISHED
from slam.networks.onnx_graph import OnnxGraph
from slam.networks.runtime import OnnxRunner
from slam.support.weights import Weights, read_weights

#: Units of the first layer, and of the memory.
HIDDEN = 128


class Answer(NamedTuple):
    """What the network makes of a step."""

    scores: Float32[np.ndarray, "*batch 3"]
    """Logarithm of how likely each action is, but for a constant."""
    value: Float32[np.ndarray, "*batch"]
    """What is still to be earned, discounted."""
    memory: Float32[np.ndarray, "*batch hidden"]
    """For the next step."""


def initial_weights(rng: np.random.Generator) -> dict[str, Float32[np.ndarray, "..."]]:
    """Weights that know nothing: all actions are about as likely."""

    def drawn(rows: int, columns: int, gain: float) -> Float32[np.ndarray, "_ _"]:
        return (rng.standard_normal((rows, columns)) * gain / math.sqrt(rows)).astype(np.float32)

    zeros = np.zeros
    return {
        "encoder.weight": drawn(INPUTS, HIDDEN, math.sqrt(2)),
        "encoder.bias": zeros(HIDDEN, np.float32),
        "memory.input_weight": drawn(HIDDEN, 3 * HIDDEN, 1.0),
        "memory.input_bias": zeros(3 * HIDDEN, np.float32),
        "memory.own_weight": drawn(HIDDEN, 3 * HIDDEN, 1.0),
        "memory.own_bias": zeros(3 * HIDDEN, np.float32),
        "action.weight": drawn(HIDDEN, len(PUBLISHED), 0.01),
        "action.bias": zeros(len(PUBLISHED), np.float32),
        "value.weight": drawn(HIDDEN, 1, 1.0),
        "value.bias": zeros(1, np.float32),
    }


def no_memory(*batch: int) -> Float32[np.ndarray, "*batch hidden"]:
    """Memory at the beginning of a search."""
    return np.zeros((*batch, HIDDEN), np.float32)


class SearchNetwork:
    """The network, ready to be asked."""

    def __init__(self, weights: Weights) -> None:
        """Take weights by the names of `initial_weights`."""
        self.weights = weights
        self._run = OnnxRunner(_model(weights))

    def __call__(
        self, told: Float32[np.ndarray, "*batch inputs"], memory: Float32[np.ndarray, "*batch hidden"]
    ) -> Answer:
        """One step.

        Args:
            told: Of `SearchSenses`.
            memory: From the step before; `no_memory` at first.
        """
        batch = told.shape[:-1]
        found = self._run(told=told.reshape(-1, INPUTS), memory=memory.reshape(-1, HIDDEN))
        scores, value, after = np.split(
            found.reshape(*batch, -1), [len(PUBLISHED), len(PUBLISHED) + 1], axis=-1
        )
        return Answer(scores, value[..., 0], after)


def _model(weights: Weights) -> bytes:
    """An ONNX model that gives scores, value and memory side by side."""
    graph = OnnxGraph()

    def layer(seen: str, name: str, gate: int | None = None, kind: str = "") -> str:
        """Weights times what is seen, plus a bias; of one of three gates, which lie side by side."""
        part = slice(None) if gate is None else slice(gate * HIDDEN, (gate + 1) * HIDDEN)
        weight = graph.weight(weights[f"{name}.{kind}weight"][:, part])
        bias = graph.weight(weights[f"{name}.{kind}bias"][part])
        return graph.node("Add", graph.node("MatMul", seen, weight), bias)

    seen = graph.node("Relu", layer("told", "encoder"))
    new = [layer(seen, "memory", gate, "input_") for gate in range(3)]
    old = [layer("memory", "memory", gate, "own_") for gate in range(3)]
    reset, keep = (graph.node("Sigmoid", graph.node("Add", new[k], old[k])) for k in range(2))
    fresh = graph.node("Tanh", graph.node("Add", new[2], graph.node("Mul", reset, old[2])))
    # (1 - z) n + z h
    kept = graph.node("Mul", keep, graph.node("Sub", "memory", fresh))
    after = graph.node("Add", fresh, kept)
    out = graph.node("Concat", layer(after, "action"), layer(after, "value"), after, axis=1)
    return graph.model({"told": ("robots", INPUTS), "memory": ("robots", HIDDEN)}, out)


def likelihood(scores: Float32[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Probability of each action."""
    odds = np.exp(scores.astype(float) - scores.max(axis=-1, keepdims=True))
    return odds / odds.sum(axis=-1, keepdims=True)


def drawn_actions(scores: Float32[np.ndarray, "n 3"], rng: np.random.Generator) -> np.ndarray:
    """Actions drawn by their probabilities, (n,) int."""
    below = np.cumsum(likelihood(scores), axis=-1)
    return np.minimum((below < rng.random((len(scores), 1))).sum(axis=-1), len(PUBLISHED) - 1)


def load_search(path: Path) -> SearchNetwork:
    """A network from a .safetensors file of `robosim train search`.

    Raises:
        FileError: If the file is missing, damaged, or of something else.
    """
    return SearchNetwork(read_weights(path, initial_weights(np.random.default_rng(0)), "search"))
