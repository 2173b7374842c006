"""Map, belief and depth of a step in small integers, as they are drawn and recorded."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8, UInt16

from slam.grid import GridFrame, MapEstimate

#: Kinds of cells of a map.
UNKNOWN, FREE, OBSTACLE, BLOCKED = 0, 1, 2, 3
#: From this number on: an unknown cell that the mapper anticipates, in 16 levels of the probability of an obstacle.
GUESS, GUESS_LEVELS = 4, 16
#: Highest level of belief: a thousand times as likely as in a uniform distribution.
TOP_LEVEL = 63
_TOP_LOG10 = 3.0


@runtime_checkable
class Belief(Protocol):
    """A probability for each cell of a grid."""

    @property
    def frame(self) -> GridFrame:
        """Where the cells lie in `map`."""

    def probability(self) -> Float[np.ndarray, "ny nx"]:
        """Probability that the target stands in each cell."""


@dataclass(frozen=True, eq=False)
class Layer:
    """A grid of small integers."""

    frame: GridFrame
    """Where the cells lie in `map`."""
    values: UInt8[np.ndarray, "ny nx"]
    """Kinds of cells, or levels of belief."""


@dataclass(frozen=True, eq=False)
class LevelledBelief:
    """A belief known by its levels only, as recorded."""

    layer: Layer

    @property
    def frame(self) -> GridFrame:
        """Where the cells lie in `map`."""
        return self.layer.frame

    def probability(self) -> Float[np.ndarray, "ny nx"]:
        """Probability of each cell; not normalised, since cells below the uniform distribution count as uniform."""
        return 10 ** (_TOP_LOG10 / TOP_LEVEL * self.layer.values) / self.layer.values.size


def layer_of_map(estimate: MapEstimate) -> Layer:
    """The kind of each cell of a map."""
    kind = np.where(estimate.explored, FREE, UNKNOWN).astype(np.uint8)
    kind[estimate.obstacle] = OBSTACLE
    kind[estimate.blocked] = BLOCKED
    guess = estimate.anticipated_probability
    if guess is not None:
        guessed = (kind == UNKNOWN) & (guess != 0.5)
        kind[guessed] = GUESS + np.minimum(GUESS_LEVELS * guess[guessed], GUESS_LEVELS - 1).astype(np.uint8)
    return Layer(estimate.frame, kind)


def map_of_layer(layer: Layer, pose: Float[np.ndarray, "3"]) -> MapEstimate:
    """A map with these kinds of cells; obstacles and floor are certain, guesses in the middle of their level."""
    kind = layer.values
    observed = np.full(kind.shape, 0.5, np.float32)
    observed[kind == FREE], observed[kind == OBSTACLE] = 0.0, 1.0
    guessed, anticipated = kind >= GUESS, observed.copy()
    anticipated[guessed] = (kind[guessed] - GUESS + np.float32(0.5)) / GUESS_LEVELS
    return MapEstimate(
        frame=layer.frame,
        obstacle_probability=observed,
        explored=(kind == FREE) | (kind == OBSTACLE) | (kind == BLOCKED),
        blocked=kind == BLOCKED,
        pose=pose,
        anticipated_probability=anticipated if guessed.any() else None,
    )


def layer_of_belief(belief: Belief) -> Layer:
    """How much likelier each cell is than in a uniform distribution, in logarithmic levels; 0 for no likelier."""
    p = belief.probability()
    times = np.maximum(p * p.size, 1.0)
    levels = np.rint(TOP_LEVEL * np.minimum(np.log10(times) / _TOP_LOG10, 1.0))
    return Layer(belief.frame, levels.astype(np.uint8))


def depth_in_mm(depth_m: Float[np.ndarray, "h w"]) -> UInt16[np.ndarray, "h w"]:
    """Depth in whole millimetres, up to 65 m."""
    return np.rint(np.minimum(depth_m, 65.0) * 1000).astype(np.uint16)
