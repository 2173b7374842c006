"""A robot's radio: the target sends, the robot sounds the channel where it truly is, and estimates paths.

At every decision the paths between target and robot are traced, measured beam by beam with noise, and estimated;
what comes out is in the robot's own frame, for it knows its heading from its own map only. The true paths are
kept for judging.

With `engine="cached"` paths come from a table that is traced once for each place of the transmitter
(`robosim.radio.table`); they are measured and estimated all the same. With `engine="table"` there is no measurement
either: estimates are made from the table's paths by rule (`robosim.radio.table_reader`), for learning. Errors are drawn
anew every time.

Left out: Doppler, shadowing by the robot's own body, interference between transmitters.
"""

from copy import copy
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.parts import ESTIMATOR, TERMINAL, EstimatorPart, TerminalPart
from robosim.radio.classifier import Classifier
from robosim.radio.table import RadioTable
from robosim.radio.table_reader import read_paths, states_of
from robosim.radio.tables import RadioTables
from robosim.support.checks import FREQUENCY_HZ, Range, checked
from robosim.support.parts import Part
from wireless.estimates import PathEstimates
from wireless.estimation.estimators import PathEstimator
from wireless.paths import LinkState, Paths
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig
from wireless.tracing.tracer import Tracer, TracerConfig

RadioEngine = Literal["live", "cached", "table"]


@dataclass(frozen=True, kw_only=True)
@checked
class RadioLinkConfig:
    """How the target sends, and how the robot measures."""

    engine: RadioEngine = "live"
    """live: traced at the robot's true place. cached: from a table of the whole building. table: that, and estimates by
    rule, without a measurement."""
    tables: Path | None = None
    """Folder where tables are kept in files; without it they last as long as the process."""
    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency."""
    height_m: Annotated[float, Range(0, 100, "m")] = 1.5
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


@cache
def _receiver(
    transmitter: Part, receiver: Part, estimator: Part, sounding: SoundingConfig
) -> tuple[Sounder, PathEstimator]:
    """What measures and what estimates; its tables take seconds to make, and serve any building."""
    ends = TERMINAL.make(transmitter, field="transmitter"), TERMINAL.make(receiver, field="receiver")
    sounder = Sounder(*ends, sounding)
    return sounder, ESTIMATOR.make(estimator, sounder, field="estimator")


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
        self._tracer = Tracer(building, frequency_hz=self.config.frequency_hz, config=self.config.tracer)
        c = self.config
        self.sounder, self._estimator = _receiver(c.transmitter, c.receiver, c.estimator, c.sounding)
        self._target = np.full(3, np.nan)
        self.tables = RadioTables(building, self._tracer, self.config.tables)
        self.paths: Paths | None = None
        self._at = np.full(2, np.nan)

    def another(self) -> "RadioLink":
        """The same receiver's link with another transmitter: they take turns, and do not disturb each other."""
        other = copy(self)
        other._target, other.paths = np.full(3, np.nan), None
        return other

    def place(self, target: Float[np.ndarray, "2"]) -> None:
        """Put the transmitter at a point of `map` [m]."""
        self._target = np.array([*target, self.config.height_m])
        self.paths = None

    def measure(self, pose: Float[np.ndarray, "3"], rng: np.random.Generator) -> PathEstimates:
        """Sound the channel at a true pose in `map`, and estimate its paths.

        Returns:
            Estimates of the one link: arrivals in the robot's frame, departures in `map`.
        """
        self._at = np.array(pose[:2])
        self.paths = self._paths(self._at)
        if self.config.engine == "table":
            return read_paths(self.paths, float(pose[2]), self.sounder, rng)
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

    def believed(self, classifier: Classifier) -> Float[np.ndarray, "4"]:
        """Probabilities of the link state where the robot last listened, between those of the table's nodes."""
        around = self.table.nodes_around(self._at)
        if around is None:
            assert self.paths is not None
            return states_of([self.paths], self.sounder, classifier)[0]
        node, weight = around
        return weight @ self.tables.states(self._target, self.sounder, classifier)[node]

    @property
    def table(self) -> RadioTable:
        """Of the transmitter where it stands."""
        return self.tables.of(self._target)

    def _paths(self, at: Float[np.ndarray, "2"]) -> Paths:
        found = None if self.config.engine == "live" else self.table.at(at)
        # In niches that no node looks into there is no table.
        return self._trace(at) if found is None else found

    def _trace(self, at: Float[np.ndarray, "2"]) -> Paths:
        return self._tracer.trace(self._target[None], np.array([[*at, self.config.height_m]]), workers=1)
