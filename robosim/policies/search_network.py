"""The recurrent network of the learned search: its inputs, and the network in ONNX Runtime.

Inputs are numbers of about 1 in size, in the robot's own frame. They need neither a map nor the pose of a mapper:

    depth      64 columns from left to right, each as nearness 0.5 m / (0.5 m + d) and as distance d / 10 m, 0 for none
    paths      5, each as found, cosine and sine of the azimuth of arrival, SNR / 30 dB, delay / 30 ns, 0 for none
    state      probabilities of outage, line of sight, first order, higher order
    odometry   forward and left in steps of 0.25 m, turn in steps of 10 degrees
    trail      how often the robot was in each of 8 directions by 3 distances around it, by odometry
    start      ahead and left of the robot, in 10 m; number of steps, in 1000

Obstacles below the camera's horizon are not in the inputs. The network has one layer of rectified units, a gated
recurrent unit as memory, and two linear readings of the memory: scores of the three actions, and the discounted
reward to come, which only training uses.

    e  = relu(x We + be)
    r  = s(e Wr + h Ur + b),  z = s(e Wz + h Uz + b),  n = tanh(e Wn + b + r (h Un + c))
    h' = (1 - z) n + z h

Reference: Cho et al., Learning phrase representations using RNN encoder-decoder, EMNLP 2014, in the form of PyTorch's
`GRUCell`, with transposed weights.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from robosim.support.weights import Weights, read_weights
from slam.actions import FORWARD_M, PUBLISHED, TURN_RAD
from slam.networks.onnx_graph import OnnxGraph, OnnxRunner
from slam.poses import to_robot

COLUMNS, PATHS, STATES = 64, 5, 4
#: Largest distance [m]; distance with a nearness of one half [m].
_FAR_M, _NEAR_M = 10.0, 0.5
_SNR_DB, _DELAY_S, _MOST_DELAYS = 30.0, 30e-9, 3.0
#: Directions and outer distances [m] of the parts of the trail.
_SECTORS, _RINGS_M = 8, (0.8, 2.0, 5.0)
#: Logarithm of the number of visits that becomes 1.
_TRAIL = 4.0
_PLACE_M, _STEPS = 10.0, 1000.0
#: Inputs and their sizes, in their order.
_LAYOUT = {
    "distances": 2 * COLUMNS, "radio paths": 5 * PATHS + STATES, "motion": 3,
    "places visited": _SECTORS * len(_RINGS_M) + 3,
}  # fmt: skip
_ENDS = np.cumsum(list(_LAYOUT.values())).tolist()
INPUTS = _ENDS[-1]
#: The inputs of each kind.
SENSES = {name: slice(end - count, end) for (name, count), end in zip(_LAYOUT.items(), _ENDS, strict=True)}
#: Units of the first layer, and of the memory.
HIDDEN = 128


class SearchSenses:
    """Encodes the observations of one robot on one search."""

    def __init__(self) -> None:
        self._pose = np.zeros(3)
        self._trail = np.zeros((64, 2))
        self._steps = -1

    def encode(
        self,
        depth_m: Float[np.ndarray, "h w"],
        odometry: Float[np.ndarray, "3"],
        direction_rad: Float[np.ndarray, " n"],
        snr_db: Float[np.ndarray, " n"],
        delay_s: Float[np.ndarray, " n"],
        probability: Float[np.ndarray, "4"],
        *,
        waited: bool = False,
    ) -> Float32[np.ndarray, " k"]:
        """Inputs of the network; to be called once per step, at the start of the search first.

        Args:
            depth_m: The camera's depth [m], 0 where nothing was measured.
            odometry: Measured motion since the last step in the robot's frame: dx [m], dy [m], dyaw [rad].
            direction_rad: Azimuths of arrival in the robot's frame, the strongest path first.
            snr_db: SNR of these paths [dB].
            delay_s: Their delays relative to the strongest [s].
            probability: Of each link state.
            waited: Whether the last action was a wait, which does not count as a visit.
        """
        if not waited:
            self._move(odometry)
        ahead = np.minimum(horizon(depth_m), _FAR_M)
        n = min(len(direction_rad), PATHS)
        paths = np.zeros((PATHS, 5), np.float32)
        paths[:n, 0] = 1
        paths[:n, 1], paths[:n, 2] = np.cos(direction_rad[:n]), np.sin(direction_rad[:n])
        paths[:n, 3] = snr_db[:n] / _SNR_DB
        paths[:n, 4] = np.clip(delay_s[:n] / _DELAY_S, -_MOST_DELAYS, _MOST_DELAYS)
        parts = (
            np.where(ahead > 0, _NEAR_M / (_NEAR_M + ahead), 0.0),
            ahead / _FAR_M,
            paths.ravel(),
            probability,
            odometry / (FORWARD_M, FORWARD_M, TURN_RAD),
            self._visits(),
            to_robot(self._pose, np.zeros((1, 2)))[0] / _PLACE_M,
            [self._steps / _STEPS],
        )
        return np.concatenate([np.asarray(values, np.float32) for values in parts])

    def _move(self, odometry: Float[np.ndarray, "3"]) -> None:
        """Add up odometry in the frame of the start, and record the place."""
        x, y, yaw = self._pose
        dx, dy, turn = (float(value) for value in odometry)
        c, s = math.cos(yaw), math.sin(yaw)
        self._pose = np.array([x + c * dx - s * dy, y + s * dx + c * dy, yaw + turn])
        self._steps += 1
        if self._steps == len(self._trail):
            self._trail = np.concatenate([self._trail, np.zeros_like(self._trail)])
        self._trail[self._steps] = self._pose[:2]

    def _visits(self) -> Float[np.ndarray, " n"]:
        """Visits around the robot: distance by distance, counter-clockwise from behind."""
        ahead, left = to_robot(self._pose, self._trail[: self._steps]).T
        ring = np.searchsorted(_RINGS_M, np.hypot(ahead, left))
        sector = ((np.arctan2(left, ahead) + math.pi) * (_SECTORS / (2 * math.pi))).astype(int) % _SECTORS
        count = np.bincount(ring * _SECTORS + sector, minlength=_SECTORS * (len(_RINGS_M) + 1))
        return np.log1p(count[: _SECTORS * len(_RINGS_M)]) / _TRAIL


def horizon(depth_m: Float[np.ndarray, "h w"]) -> Float[np.ndarray, " n"]:
    """Depth at the height of the camera [m]: the larger one of the two middle rows."""
    height, width = depth_m.shape
    columns = ((np.arange(COLUMNS) + 0.5) * (width / COLUMNS)).astype(int)
    return depth_m[(height - 1) // 2 : height // 2 + 1, columns].max(axis=0)


class Output(NamedTuple):
    """Output of the network."""

    scores: Float32[np.ndarray, "*batch 3"]
    """Logarithm of each action's probability, up to a constant."""
    value: Float32[np.ndarray, "*batch"]
    """Discounted reward to come."""
    memory: Float32[np.ndarray, "*batch hidden"]
    """For the next step."""


def initial_weights(rng: np.random.Generator) -> dict[str, Float32[np.ndarray, "..."]]:
    """Random weights, with which all actions are about equally likely."""

    def draw(rows: int, columns: int, gain: float) -> Float32[np.ndarray, "_ _"]:
        return (rng.standard_normal((rows, columns)) * gain / math.sqrt(rows)).astype(np.float32)

    zeros = np.zeros
    return {
        "encoder.weight": draw(INPUTS, HIDDEN, math.sqrt(2)),
        "encoder.bias": zeros(HIDDEN, np.float32),
        "memory.input_weight": draw(HIDDEN, 3 * HIDDEN, 1.0),
        "memory.input_bias": zeros(3 * HIDDEN, np.float32),
        "memory.own_weight": draw(HIDDEN, 3 * HIDDEN, 1.0),
        "memory.own_bias": zeros(3 * HIDDEN, np.float32),
        "action.weight": draw(HIDDEN, len(PUBLISHED), 0.01),
        "action.bias": zeros(len(PUBLISHED), np.float32),
        "value.weight": draw(HIDDEN, 1, 1.0),
        "value.bias": zeros(1, np.float32),
    }


def empty_memory(*batch: int) -> Float32[np.ndarray, "*batch hidden"]:
    """Memory at the start of a search."""
    return np.zeros((*batch, HIDDEN), np.float32)


class SearchNetwork:
    """The network with weights, by the names of `initial_weights`."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        self._run = OnnxRunner(_model(weights))

    def __call__(
        self, inputs: Float32[np.ndarray, "*batch inputs"], memory: Float32[np.ndarray, "*batch hidden"]
    ) -> Output:
        """Compute a step from the inputs of `SearchSenses` and the memory of the last step, `empty_memory` at first."""
        batch = inputs.shape[:-1]
        output = self._run(inputs=inputs.reshape(-1, INPUTS), memory=memory.reshape(-1, HIDDEN))
        scores, value, after = np.split(
            output.reshape(*batch, -1), [len(PUBLISHED), len(PUBLISHED) + 1], axis=-1
        )
        return Output(scores, value[..., 0], after)


def _model(weights: Weights) -> bytes:
    """An ONNX model that gives scores, value and memory, concatenated."""
    graph = OnnxGraph()

    def layer(values: str, name: str, gate: int | None = None, kind: str = "") -> str:
        """Weights times values, plus a bias; of all units, or of one of three gates."""
        units = slice(None) if gate is None else slice(gate * HIDDEN, (gate + 1) * HIDDEN)
        weight = graph.weight(weights[f"{name}.{kind}weight"][:, units])
        bias = graph.weight(weights[f"{name}.{kind}bias"][units])
        return graph.node("Add", graph.node("MatMul", values, weight), bias)

    encoded = graph.node("Relu", layer("inputs", "encoder"))
    new = [layer(encoded, "memory", gate, "input_") for gate in range(3)]
    old = [layer("memory", "memory", gate, "own_") for gate in range(3)]
    reset, keep = (graph.node("Sigmoid", graph.node("Add", new[k], old[k])) for k in range(2))
    fresh = graph.node("Tanh", graph.node("Add", new[2], graph.node("Mul", reset, old[2])))
    # (1 - z) n + z h
    after = graph.node("Add", fresh, graph.node("Mul", keep, graph.node("Sub", "memory", fresh)))
    out = graph.node("Concat", layer(after, "action"), layer(after, "value"), after, axis=1)
    return graph.model({"inputs": ("robots", INPUTS), "memory": ("robots", HIDDEN)}, out)


def action_probabilities(scores: Float32[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Probability of each action."""
    odds = np.exp(scores.astype(float) - scores.max(axis=-1, keepdims=True))
    return odds / odds.sum(axis=-1, keepdims=True)


def draw_actions(scores: Float32[np.ndarray, "n 3"], rng: np.random.Generator) -> np.ndarray:
    """Actions drawn by their probabilities, (n,) int."""
    below = np.cumsum(action_probabilities(scores), axis=-1)
    return np.minimum((below < rng.random((len(scores), 1))).sum(axis=-1), len(PUBLISHED) - 1)


def load_search(path: Path) -> SearchNetwork:
    """A network from a .safetensors file of `robosim train search`.

    Raises:
        FileError: If the file is missing, damaged, or of something else.
    """
    return SearchNetwork(read_weights(path, initial_weights(np.random.default_rng(0)), "search"))
