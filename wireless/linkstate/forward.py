"""Networks of link states in use: from tokens and trained weights to logits, in NumPy.

They are small and used for one link at a time, so that matrix products suffice. `wireless.linkstate.learning.networks`
trains them, with weights of the same names and shapes. Each link is computed separately: its result does not depend on
the other links of a call.

Reference: Ba et al., "Layer normalization", arXiv 1607.06450.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from robosim.support.weights import Weights
from wireless.linkstate.features import feature_counts, path_and_pair_features
from wireless.linkstate.tokens import N_PATHS

Shapes = dict[str, tuple[int, ...]]

N_STATES = 4
#: Widest network that is made; weights that are read must fit into memory.
WIDEST = 512
#: Constant that normalisation adds to variances, as in PyTorch.
_EPSILON = np.float32(1e-5)


def relation_logits(
    weights: Weights, tokens: Float32[np.ndarray, "n 5 5"], inputs: Sequence[str]
) -> Float32[np.ndarray, "n 4"]:
    """Messages between paths, then a dense head."""
    path, pair, there = path_and_pair_features(tokens, inputs)
    n, present = len(path), there[..., None].astype(np.float32)
    rank = np.broadcast_to(np.eye(N_PATHS, dtype=np.float32), (n, N_PATHS, N_PATHS))
    state = _dense(weights, "embed.2", _relu(_dense(weights, "embed.0", np.concatenate([path, rank], -1))))
    state = state * present
    every = pair.reshape(n, N_PATHS * N_PATHS, -1)
    for i in range(_count(weights, "rounds")):
        name = f"rounds.{i}"
        seen = _normalised(weights, f"{name}.norm", state)
        of_pair = _dense(weights, f"{name}.pair", every).reshape(n, N_PATHS, N_PATHS, -1)
        taker, giver = (seen @ weights[f"{name}.{role}.weight"].T for role in ("taker", "giver"))
        sent = _relu(of_pair + taker[:, :, None] + giver[:, None]) * present[:, None]
        message = _dense(weights, f"{name}.message", sent.mean(2))
        step = _relu(_dense(weights, f"{name}.update.0", np.concatenate([seen, message], -1)))
        state = (state + _dense(weights, f"{name}.update.2", step)) * present
    x = np.concatenate([state.reshape(n, -1), state.max(1)], -1)
    for name in ("head.1", "head.4"):
        x = _relu(_dense(weights, name, x))
    return _dense(weights, "head.7", x)


def relation_shapes(
    inputs: Sequence[str], *, width: int = 48, rounds: int = 2, dropout: float = 0.2
) -> Shapes:
    """Shapes of its weights; dropout has none."""
    n_path, n_pair = feature_counts(inputs)
    half = width // 2
    shapes = _dense_shapes("embed.0", n_path + N_PATHS, width) | _dense_shapes("embed.2", width, width)
    for i in range(rounds):
        name = f"rounds.{i}"
        shapes |= {f"{name}.norm.weight": (width,), f"{name}.norm.bias": (width,)}
        shapes |= {f"{name}.taker.weight": (half, width), f"{name}.giver.weight": (half, width)}
        shapes |= _dense_shapes(f"{name}.pair", n_pair, half) | _dense_shapes(f"{name}.message", half, width)
        shapes |= _dense_shapes(f"{name}.update.0", 2 * width, width)
        shapes |= _dense_shapes(f"{name}.update.2", width, width)
    sizes = ((N_PATHS + 1) * width, 2 * width, 2 * width, N_STATES)
    for name, before, after in zip(("head.1", "head.4", "head.7"), sizes, sizes[1:], strict=False):
        shapes |= _dense_shapes(name, before, after)
    return shapes


def softmax(logits: Float32[np.ndarray, "n k"]) -> Float32[np.ndarray, "n k"]:
    """Probabilities of logits."""
    power = np.exp(logits - logits.max(1, keepdims=True))
    return power / power.sum(1, keepdims=True)


def _dense(weights: Weights, name: str, x: Float32[np.ndarray, "*n f"]) -> Float32[np.ndarray, "*n g"]:
    """A dense layer. Rows of a plain table are multiplied one by one, so that none depends on the others."""
    rows = x[:, None] if x.ndim == 2 else x
    outputs = rows @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]
    return outputs[:, 0] if x.ndim == 2 else outputs


def _dense_shapes(name: str, inputs: int, outputs: int) -> Shapes:
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}


def _normalised(weights: Weights, name: str, x: Float32[np.ndarray, "n 5 f"]) -> Float32[np.ndarray, "n 5 f"]:
    """Layer normalisation over the last axis."""
    centred = x - x.mean(-1, keepdims=True)
    spread = np.sqrt((centred**2).mean(-1, keepdims=True) + _EPSILON)
    return centred / spread * weights[f"{name}.weight"] + weights[f"{name}.bias"]


def _relu(x: Float32[np.ndarray, "*n"]) -> Float32[np.ndarray, "*n"]:
    return np.maximum(x, 0)


def _count(weights: Weights, name: str) -> int:
    """How many parts of a name there are, counted from 0."""
    return len({key.split(".")[1] for key in weights if key.startswith(f"{name}.")})
