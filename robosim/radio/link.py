"""A robot's radio: the target sends; the robot sounds the channel at its true place, and estimates paths.

At every decision the paths between target and robot are traced, measured beam by beam with noise, and estimated. The
estimates are in the robot's own frame, since it knows its yaw from its own map only. The true paths are stored for
evaluation.

With `engine="cached"` paths come from a table that is traced once for each place of the transmitter
(`robosim.radio.table`); they are measured and estimated as usual. With `engine="table"` estimates are made from the
table's paths by rule (`robosim.radio.table_reader`), without a measurement, for learning. Errors are drawn every time.
Robots of one process share tables. The last ones are cached in memory, and all of them in a folder if one is given.

People weaken paths at each measurement. The link state stays that of the building.

Left out: Doppler, shadowing by the robot's own body, interference between transmitters; with `engine="table"` people
in the probabilities of link states.
"""

import hashlib
import math
from collections import OrderedDict
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light

import wireless
from robosim.building.building import Building
from robosim.parts import ESTIMATOR, TERMINAL, EstimatorPart, TerminalPart
from robosim.radio.link_state import Classifier
from robosim.radio.table import STEP_M, RadioTable
from robosim.radio.table_reader import read_paths, states_of
from robosim.support.checks import ADVANCED, FREQUENCY_HZ, Range, checked
from robosim.support.parts import Part
from wireless.bands import band_named, check_bandwidth
from wireless.channel import Channel
from wireless.estimates import PathEstimates
from wireless.estimation.estimators import PathEstimator
from wireless.motion.blockage import Blockage, block
from wireless.motion.bodies import Bodies
from wireless.paths import LinkState, Paths
from wireless.sounding.first_path import NOISE_MARGIN_DB, detect_first_path
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig
from wireless.tracing.tracer import Tracer, TracerConfig

RadioEngine = Literal["live", "cached", "table"]
BlockageModel = Literal["knife-edges", "model-b", "none"]
#: Tables that are cached in memory: 5 MB each in a flat, 40 MB in an office.
_CACHED = 16


@dataclass(frozen=True, kw_only=True)
@checked
class RadioLinkConfig:
    """How the target sends, and how the robot measures."""

    engine: RadioEngine = "live"
    """live: traced at the robot's true place. cached: from a table of the whole building. table: that, and estimates by
    rule, without a measurement."""
    tables: Path | None = None
    """Folder for files of tables; without it they last as long as the process."""
    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency."""
    height_m: Annotated[float, Range(0, 100, "m")] = 1.5
    """Height of both antennas above the floor [m]."""
    transmitter: TerminalPart = "gnb"
    """The target's arrays; gnb, the published base station's, face 0 and ±120 degrees in `map`."""
    receiver: TerminalPart = "ue"
    """The robot's arrays, which turn with it; ue is the published robot's."""
    estimator: EstimatorPart = "sage"
    """Path estimator: sage by likelihood, pca as published."""
    sounding: SoundingConfig = field(default_factory=SoundingConfig)
    """Power, waveform and noise."""
    tracer: TracerConfig = field(default_factory=TracerConfig)
    """Which paths there are."""
    range_sigma_m: Annotated[float | None, Range(1e-3, 100, "m"), ADVANCED] = None
    """Standard deviation of a device's ranges by round-trip time (Wi-Fi, ultra-wideband) to the first path that its
    bandwidth shows [m]; None without ranging."""
    blockage: BlockageModel = "knife-edges"
    """How people weaken paths: by Fresnel integrals with phases, by model B of 3GPP TR 38.901, or not at all."""

    def __post_init__(self) -> None:
        check_bandwidth(self.sounding.bandwidth_mhz, self.frequency_hz)
        if self.tables is not None and self.engine == "live":
            raise ValueError(
                "tables is set, but engine is 'live', which has none. Set engine to cached or table."
            )

    def in_band(self, name: str) -> "RadioLinkConfig":
        """Return the configuration in a band of `wireless.bands`: other carrier, power, waveform, and antennas."""
        band = band_named(name)
        return replace(
            self,
            frequency_hz=band.frequency_hz,
            transmitter=band.transmitter,
            receiver=band.receiver,
            sounding=band.sounding,
        )


def first_path_m(paths: Paths, sounding: SoundingConfig) -> float:
    """Length of the first path of one link that a receiver of one antenna detects [m]; NaN if there is none."""
    if not len(paths):
        return math.nan
    least_db = NOISE_MARGIN_DB - sounding.snr_per_gain_db
    delay_s, _ = detect_first_path(Channel.from_paths(paths), 1e6 * sounding.bandwidth_mhz, least_db)
    return speed_of_light * float(delay_s[0, 0])


def _receiver(config: RadioLinkConfig) -> tuple[Sounder, PathEstimator]:
    """Sounder and estimator for any building."""
    return _make_receiver(config.transmitter, config.receiver, config.estimator, config.sounding)


@cache
def _make_receiver(
    transmitter: Part, receiver: Part, estimator: Part, sounding: SoundingConfig
) -> tuple[Sounder, PathEstimator]:
    """Their tables take seconds to compute."""
    ends = TERMINAL.make(transmitter, field="transmitter"), TERMINAL.make(receiver, field="receiver")
    sounder = Sounder(*ends, sounding)
    return sounder, ESTIMATOR.make(estimator, sounder, field="estimator")


class RadioLink:
    """Link of a transmitter in a building, and the receiver of a robot."""

    def __init__(self, building: Building, config: RadioLinkConfig | None = None) -> None:
        """Prepare tracer and estimator; ValueError if the antennas do not fit under the ceiling."""
        self.config = config or RadioLinkConfig()
        if not 0 < self.config.height_m < building.height_m:
            raise ValueError(
                f"height_m is {self.config.height_m}, expected antennas between floor and ceiling, 0 to "
                f"{building.height_m:g} m."
            )
        self._tracer = Tracer(building, frequency_hz=self.config.frequency_hz, config=self.config.tracer)
        self.sounder, self._estimator = _receiver(self.config)
        self._target = np.full(3, np.nan)
        self.tables = RadioTables(building, self._tracer, self.config.tables)
        self.paths: Paths | None = None
        """True paths of the last measurement, weakened by people."""
        self.blockage: Blockage | None = None
        """Blockage of each path by people; None without people."""
        self.range_m = math.nan
        """Measured range [m]; NaN without ranging or reception."""
        self._unblocked: Paths | None = None
        self._at = np.full(2, np.nan)

    def clone(self) -> "RadioLink":
        """Return the receiver's link with another transmitter; they take turns, without interference."""
        other = copy(self)
        other._target, other.paths, other._unblocked = np.full(3, np.nan), None, None
        return other

    def between_receivers(self) -> "RadioLink":
        """Return the link of one such receiver to another, traced live."""
        other = self.clone()
        other.config = replace(self.config, transmitter=self.config.receiver, engine="live", tables=None)
        other.sounder, other._estimator = _receiver(other.config)
        return other

    def place(self, target: Float[np.ndarray, "2"]) -> None:
        """Put the transmitter at a point of `map` [m]."""
        self._target = np.array([*target, self.config.height_m])
        self.paths = None

    def measure(
        self, pose: Float[np.ndarray, "3"], rng: np.random.Generator, bodies: Bodies | None = None
    ) -> PathEstimates:
        """Sound the channel among people; estimates have arrivals in the frame of the robot, departures in `map`."""
        self._at = np.array(pose[:2])
        self.paths = self._unblocked = self._paths(self._at)
        self.blockage = None
        if bodies is not None and self.config.blockage != "none":
            self.paths, self.blockage = block(self.paths, bodies, self.config.blockage)
        if self.config.engine == "table":
            estimates = read_paths(self.paths, float(pose[2]), self.sounder, rng)
        else:
            rays = Rays.from_paths(self.paths, rx_heading_rad=float(pose[2]))
            estimates = self._estimator.estimate(self.sounder.measure(rays, rng, workers=1))
        if self.config.range_sigma_m is not None:
            self.range_m = math.nan
            if estimates.count[0]:
                length_m = first_path_m(self.paths, self.config.sounding)
                self.range_m = length_m + float(rng.normal(0, self.config.range_sigma_m))
        return estimates

    @property
    def state(self) -> LinkState:
        """True link state at the last measurement, as of the building without people."""
        if self._unblocked is None:
            raise RuntimeError("The radio has not measured yet. Call measure first.")
        return LinkState(int(self._unblocked.link_state()[0, 0]))

    @property
    def sight_loss_db(self) -> float:
        """Loss of the direct path by people at the last measurement [dB]; NaN without a direct path, or people."""
        if self.paths is None or self.blockage is None or not (self.paths.order == 0).any():
            return math.nan
        return float(-20 * np.log10(np.abs(self.blockage.factor[self.paths.order == 0][0]) + 1e-15))

    @property
    def bearing(self) -> float:
        """True azimuth of arrival of the strongest path in `map` [rad]; NaN if there is none."""
        if self.paths is None or not len(self.paths.aoa_az):
            return float("nan")
        return float(self.paths.aoa_az[0])

    def table_probability(self, classifier: Classifier) -> Float[np.ndarray, "4"]:
        """Probabilities of the link state at the last measurement, interpolated between the table's nodes."""
        around = self.table.nodes_around(self._at)
        if around is None:
            assert self.paths is not None
            return states_of([self.paths], self.sounder, classifier)[0]
        node, weight = around
        return weight @ self.tables.states(self._target, self.sounder, classifier)[node]

    @property
    def table(self) -> RadioTable:
        """Return the table of the transmitter at its place."""
        return self.tables.of(self._target)

    def _paths(self, at: Float[np.ndarray, "2"]) -> Paths:
        paths = None if self.config.engine == "live" else self.table.at(at)
        # No node of the table is visible from a niche.
        return self.trace(at) if paths is None else paths

    def trace(self, at: Float[np.ndarray, "2"]) -> Paths:
        """True paths from the transmitter to a place [m] in the building without people."""
        return self._tracer.trace(self._target[None], np.array([[*at, self.config.height_m]]), workers=1)


@cache
def _code_digest() -> str:
    """A text that changes with the code of the tracer, and of what this package does with paths."""
    digest = hashlib.sha256()
    for folder in (Path(wireless.__file__).parent, Path(__file__).parent):
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()


class RadioTables:
    """Tables by the place of the transmitter."""

    def __init__(self, building: Building, tracer: Tracer, folder: Path | None) -> None:
        """Nothing is traced yet; tables are stored in a folder if one is given."""
        self._building, self._tracer, self._folder = building, tracer, folder
        self._states: WeakKeyDictionary[RadioTable, tuple[Classifier, np.ndarray]] = WeakKeyDictionary()
        self._cached: OrderedDict[bytes, RadioTable] = OrderedDict()

    def of(self, place: Float[np.ndarray, "3"]) -> RadioTable:
        """The table of a transmitter at a place [m]; FileError if its file is damaged."""
        key = np.asarray(place, float).tobytes()
        if key not in self._cached:
            self._cached[key] = self._read_or_trace(np.asarray(place, float))
            if len(self._cached) > _CACHED:
                self._cached.popitem(last=False)
        self._cached.move_to_end(key)
        return self._cached[key]

    def states(
        self, place: Float[np.ndarray, "3"], sounder: Sounder, classifier: Classifier
    ) -> Float[np.ndarray, "nodes 4"]:
        """Probabilities of the link's states at the nodes of the table of a transmitter at a place [m]."""
        table = self.of(place)
        cached = self._states.get(table)
        if cached is None or cached[0] is not classifier:
            cached = classifier, states_of(table.links(), sounder, classifier)
            self._states[table] = cached
        return cached[1]

    def _read_or_trace(self, place: Float[np.ndarray, "3"]) -> RadioTable:
        file = None if self._folder is None else self._folder / f"{self._name(place)}.parquet"
        if file is not None and file.is_file():
            return RadioTable.read(file, self._building)
        table = RadioTable.trace(self._building, self._tracer, place)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            table.write(file)
        return table

    def _name(self, place: Float[np.ndarray, "3"]) -> str:
        """Differs for different paths, and for paths by other code."""
        tracer = self._tracer
        made_from = (
            self._building.digest, place.tolist(), STEP_M, tracer.frequency_hz, tracer.config, _code_digest()
        )  # fmt: skip
        return "radio-" + hashlib.sha256(repr(made_from).encode()).hexdigest()[:24]
