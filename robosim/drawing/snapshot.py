"""What a picture of one decision shows, as plain arrays: drawn while the episode runs, or from its log afterwards.

Depth is rounded to millimetres, the belief to 64 levels, before anything is drawn: so a replay from the log is the
same picture, to the pixel.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8, UInt16

from robosim.policies.belief import TargetBelief
from robosim.policies.reason import Reason
from robosim.radio.measurement import Measurement
from slam.grid import GridFrame, MapEstimate
from wireless.paths import LinkState

#: What a cell of the built map is.
UNKNOWN, FREE, OBSTACLE, BLOCKED = 0, 1, 2, 3
#: From this number on: unknown, but guessed to hold an obstacle with a probability of so many 16ths.
GUESS, GUESS_LEVELS = 4, 16
#: Highest level of belief: a thousand times as likely as if nothing were known.
TOP_LEVEL = 63
_TOP_LOG10 = 3.0


@dataclass(frozen=True, eq=False)
class Layer:
    """A grid of small numbers, and where it lies."""

    frame: GridFrame
    values: UInt8[np.ndarray, "ny nx"]


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Estimated radio paths, the strongest first."""

    aoa_rad: Float[np.ndarray, " n"]
    """Azimuth of arrival in `map`."""
    snr_db: Float[np.ndarray, " n"]
    """Signal-to-noise ratio."""
    state: LinkState
    """The most probable link state."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """One decision; all but camera and true pose may be missing."""

    rgb: UInt8[np.ndarray, "h w 3"]
    """What the camera sees."""
    depth_mm: UInt16[np.ndarray, "h w"]
    """Its depth as measured [mm]; 0 for none."""
    pose: Float[np.ndarray, "3"]
    """True pose."""
    estimate: Float[np.ndarray, "3"] | None = None
    """Estimated pose."""
    built: Layer | None = None
    """The built map, as UNKNOWN, FREE, OBSTACLE, BLOCKED or a GUESS."""
    goal: Float[np.ndarray, "2"] | None = None
    """Where the robot wants to go."""
    path: Float[np.ndarray, "n 2"] | None = None
    """How it means to get there."""
    arrivals: Arrivals | None = None
    """What its radio measured where it believed to be."""
    belief: Layer | None = None
    """Where the target may be, in levels of `belief_layer`."""
    text: str = ""
    """A line below."""
    reason: Reason | None = None
    """Why it wants to go there."""
    decisions: float = math.nan
    """What the way there takes, if nothing comes between; NaN if there is no way."""
    coverage: float = math.nan
    """Part of the reachable floor seen so far, 0 to 1."""
    true_state: LinkState | None = None
    """The true link state."""


def whole_mm(depth: Float[np.ndarray, "h w"]) -> UInt16[np.ndarray, "h w"]:
    """Depth [m] in whole millimetres, up to 65 m."""
    return np.rint(np.minimum(depth, 65.0) * 1000).astype(np.uint16)


def built_layer(estimate: MapEstimate) -> Layer:
    """The built map as one number a cell."""
    kind = np.where(estimate.explored, FREE, UNKNOWN).astype(np.uint8)
    kind[estimate.obstacle] = OBSTACLE
    kind[estimate.blocked] = BLOCKED
    guess = estimate.anticipated_probability
    if guess is not None:
        guessed = (kind == UNKNOWN) & (guess != 0.5)
        kind[guessed] = GUESS + np.minimum(GUESS_LEVELS * guess[guessed], GUESS_LEVELS - 1).astype(np.uint8)
    return Layer(estimate.frame, kind)


def belief_layer(belief: TargetBelief) -> Layer:
    """How much likelier than if nothing were known the target is in each cell: 0 for no likelier, logarithmic."""
    p = belief.probability()
    times = np.maximum(p * p.size, 1.0)
    levels = np.rint(TOP_LEVEL * np.minimum(np.log10(times) / _TOP_LOG10, 1.0))
    return Layer(belief.frame, levels.astype(np.uint8))


def arrivals(measurement: Measurement) -> Arrivals:
    """What is drawn of a measurement."""
    return Arrivals(measurement.aoa_rad, measurement.snr_db, measurement.state)
