"""A robot's radio: the target sends, the robot sounds the channel where it truly is, and estimates paths.

At every decision the paths between target and robot are traced, measured beam by beam with noise, and estimated;
what comes out is in the robot's own frame, for it knows its heading from its own map only. The true paths are
kept for judging.

With `engine="cached"` paths are traced from the middle of the 0.15 m square that the robot is in, once for each
square: what a table of traced links would say. Noise is drawn anew every time all the same.

Left out: Doppler, shadowing by the robot's own body, interference between transmitters.
"""

from copy import copy
from dataclasses import dataclass, field
from functools import cache
from typing import Literal, get_args

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building
from robosim.parts import ESTIMATOR, TERMINAL, EstimatorPart, TerminalPart
from robosim.support.checks import FREQUENCY_HZ, check_choice, check_numbers
from robosim.support.parts import Part
from wireless.estimates import PathEstimates
from wireless.estimation.estimators import PathEstimator
from wireless.paths import LinkState, Paths
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig
from wireless.tracing.tracer import Tracer, TracerConfig

RadioEngine = Literal["live", "cached"]

#: Side of the squares that a cached radio traces once [m]; the grid of the reference's tables.
SQUARE_M = 0.15


@dataclass(frozen=True, kw_only=True)
class RadioLinkConfig:
    """How the target sends, and how the robot measures."""

    engine: RadioEngine = "live"
    """live: traced at the robot's true place. cached: at the middle of its square of 0.15 m."""
    frequency_hz: float = 28e9
    """Carrier frequency."""
    height_m: float = 1.5
    """Height of both antennas above the floor [m]."""
    transmitter: TerminalPart = "gnb"
    """The target's arrays; gnb, the published base station's, face 0 and ±120 degrees in `map`."""
    receiver: TerminalPart = "ue"
    """The robot's arrays, which turn with it; ue is the published robot's."""
    estimator: EstimatorPart = "sage"
    """What reads paths out of a measurement: sage by likelihood, pca as published."""
    sounding: SoundingConfig = field(default_factory=SoundingConfig)
    """Power, waveform and noise."""
    tracer: TracerConfig = field(default_factory=TracerConfig)
    """Which paths there are."""

    def __post_init__(self) -> None:
        check_choice("engine", self.engine, get_args(RadioEngine))
        TERMINAL.check("transmitter", self.transmitter)
        TERMINAL.check("receiver", self.receiver)
        ESTIMATOR.check("estimator", self.estimator)
        check_numbers(self, frequency_hz=FREQUENCY_HZ, height_m=(0, 100, "m"))


@cache
def _receiver(
    transmitter: Part, receiver: Part, estimator: Part, sounding: SoundingConfig
) -> tuple[Sounder, PathEstimator]:
    """What measures and what estimates; its tables take seconds to make, and serve any building."""
    ends = TERMINAL.make(transmitter, field="transmitter"), TERMINAL.make(receiver, field="receiver")
    sounder = Sounder(*ends, sounding)
    return sounder, ESTIMATOR.make(estimator, sounder, field="estimator")


def warm_up(config: RadioLinkConfig) -> None:
    """Call the loops of a receiver once, so that they are compiled; what it measures is noise."""
    sounder, estimator = _receiver(config.transmitter, config.receiver, config.estimator, config.sounding)
    none = np.zeros((1, 1))
    rays = Rays(gain=none + 0j, delay_s=none, aoa_az=none, aoa_el=none, aod_az=none, aod_el=none)
    estimator.estimate(sounder.measure(rays, np.random.default_rng(0)))


class RadioLink:
    """One transmitter in a building, and a robot's receiver that goes about in it."""

    def __init__(self, building: Building, config: RadioLinkConfig | None = None) -> None:
        """Make the building ready for tracing, and the receiver for estimating.

        Raises:
            ValueError: If the antennas do not fit under the ceiling, or a name is unknown.
        """
        self.config = config or RadioLinkConfig()
        if not 0 < self.config.height_m < building.height_m:
            raise ValueError(
                f"height_m is {self.config.height_m}, expected antennas between floor and ceiling, 0 to "
                f"{building.height_m:g} m."
            )
        self._free = building.free_at(self.config.height_m)
        self._tracer = Tracer(building, frequency_hz=self.config.frequency_hz, config=self.config.tracer)
        c = self.config
        self.sounder, self._estimator = _receiver(c.transmitter, c.receiver, c.estimator, c.sounding)
        self._target = np.full(3, np.nan)
        self._traced: dict[tuple[int, int], Paths] = {}
        self.paths: Paths | None = None

    def another(self) -> "RadioLink":
        """The same receiver's link with another transmitter: they take turns, and do not disturb each other."""
        other = copy(self)
        other._target, other._traced, other.paths = np.full(3, np.nan), {}, None
        return other

    def place(self, target: Float[np.ndarray, "2"]) -> None:
        """Put the transmitter at a point of `map` [m]."""
        at = np.array([*target, self.config.height_m])
        if not np.array_equal(at, self._target):
            self._target, self._traced = at, {}
        self.paths = None

    def measure(self, pose: Float[np.ndarray, "3"], rng: np.random.Generator) -> PathEstimates:
        """Sound the channel at a true pose, and estimate its paths.

        Args:
            pose: x [m], y [m], yaw [rad] in `map`.
            rng: Source of noise, phases and clock offsets.

        Returns:
            Estimates of the one link: arrivals in the robot's frame, departures in `map`.
        """
        self.paths = self._paths(pose[:2])
        rays = Rays.from_paths(self.paths, rx_heading_rad=float(pose[2]))
        return self._estimator.estimate(self.sounder.measure(rays, rng, workers=1))

    @property
    def state(self) -> LinkState:
        """True link state where the robot last listened."""
        if self.paths is None:
            raise RuntimeError("The radio has not measured yet. Call measure first.")
        return LinkState(int(self.paths.link_state()[0, 0]))

    @property
    def bearing(self) -> float:
        """True azimuth of arrival of the strongest path in `map` [rad]; NaN if there is none."""
        if self.paths is None or not len(self.paths.aoa_az):
            return float("nan")
        return float(self.paths.aoa_az[0])

    def _paths(self, at: Float[np.ndarray, "2"]) -> Paths:
        if self.config.engine == "live":
            return self._trace(at)
        square = int(np.floor(at[0] / SQUARE_M)), int(np.floor(at[1] / SQUARE_M))
        if square not in self._traced:
            middle = (np.array(square) + 0.5) * SQUARE_M
            # The middle of a square at a wall may lie behind it.
            self._traced[square] = self._trace(middle if self._free.contains(shapely.Point(middle)) else at)
        return self._traced[square]

    def _trace(self, at: Float[np.ndarray, "2"]) -> Paths:
        return self._tracer.trace(self._target[None], np.array([[*at, self.config.height_m]]), workers=1)
