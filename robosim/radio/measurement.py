"""A measurement of the robot's radio, interpreted: directions, ranges, and the link state.

Azimuths of arrival are in the robot's frame and are turned by its estimated yaw, so that an error of its pose becomes
an error of direction. A classifier gives calibrated probabilities of the link state; or they are those of the true
state.

Bearings and ranges of transmitters are for the mapper. The power gain g of the strongest path gives its length as in
free space (Friis): r = lambda / (4 pi) 10^(-g / 20 dB). Delays give the additional length of other paths more
exactly, within the receiver's window. A path that is close to another one in angle and delay may be off by degrees,
as at grazing angles along a corridor.

Standard deviations were measured with the shipped receiver in halls, corridors, rings and offices. Directions of
separate paths are within 0.1 degrees in 90 % of all cases on most floors, those of close ones within 0.5 degrees in
80 %. Outliers, in corridors over metres, are left to the triangulation of landmarks and a robust kernel. In lines of
sight in generated homes, 80 % of the directions of BLE are within 13 degrees, and of UWB within 2.
"""

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.constants import speed_of_light

from robosim.parts import CLASSIFIER, TERMINAL
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.link_state import Classifier, TrueStates
from robosim.support.parts import Part, part_name
from slam.poses import compose, wrap
from slam.sensing.bearings import Bearing
from wireless.estimates import PathEstimates, measured
from wireless.paths import LinkState
from wireless.sounding.first_path import range_merged_m
from wireless.tracing.tracer import OPAQUE_HZ

logger = logging.getLogger(__name__)

#: Probabilities of the state of a received link that is not classified: by its place among states, none is trusted.
_UNKNOWN_STATE = np.array([0.0, 0.3, 0.3, 0.4])
#: Classifiers count as trained for carriers within this logarithm of the ratio.
_BAND = 0.2


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measurement; the strongest path first."""

    pose: Float[np.ndarray, "3"]
    """Estimated pose of the robot: x [m], y [m], yaw [rad] in `map`."""
    aoa_rad: Float[np.ndarray, " n"]
    """Azimuth of arrival in `map`: the direction from which a path arrives."""
    aod_rad: Float[np.ndarray, " n"]
    """Azimuth of departure in `map`: the direction in which a path left the target."""
    snr_db: Float[np.ndarray, " n"]
    """Signal-to-noise ratio, as `wireless.estimates` defines it."""
    gain_db: Float[np.ndarray, " n"]
    """Power gain between isotropic antennas: less than 0 by the path's loss."""
    delay_s: Float[np.ndarray, " n"]
    """Delay after the strongest path."""
    probability: Float[np.ndarray, "4"]
    """Probability of each `LinkState`."""
    range_m: float = math.nan
    """Range by round-trip time of the first path [m]; NaN if not measured."""
    range_sigma_m: float = math.nan
    """Its standard deviation [m]: of the device, and of paths that its bandwidth does not separate."""
    range_merged_m: float = 0.0
    """The latter alone [m], by which ranges out of sight are longer, too."""

    @property
    def state(self) -> LinkState:
        """The most probable link state."""
        return LinkState(int(np.argmax(self.probability)))

    @property
    def directed(self) -> Int[np.ndarray, " m"]:
        """Numbers of the paths whose direction of arrival is known."""
        return np.flatnonzero(np.isfinite(self.aoa_rad))

    def transformed(self, by: Float[np.ndarray, "3"]) -> "Measurement":
        """The measurement in the frame in which its frame lies at a pose."""
        return replace(
            self,
            pose=compose(by, self.pose),
            aoa_rad=wrap(self.aoa_rad + by[2]),
            aod_rad=wrap(self.aod_rad + by[2]),
        )

    def power_only(self) -> "Measurement":
        """Return the measurement of a single antenna: total SNR and gain, direction (NaN) and state unknown."""
        if not len(self.aoa_rad):
            return self
        unknown = np.full(1, np.nan)
        return replace(
            self,
            aoa_rad=unknown,
            aod_rad=unknown,
            snr_db=_total_db(self.snr_db),
            gain_db=_total_db(self.gain_db),
            delay_s=np.zeros(1),
            probability=_UNKNOWN_STATE,
        )


def _total_db(powers_db: Float[np.ndarray, " n"]) -> Float[np.ndarray, "1"]:
    return np.atleast_1d(10 * np.log10(np.sum(10 ** (powers_db / 10))))


def free_path_m(gain_db: float, frequency_hz: float) -> float:
    """Length [m] of a path in free space of a gain (Friis): lambda / (4 pi) 10^(-gain / 20 dB)."""
    return speed_of_light / frequency_hz / (4 * math.pi) * 10 ** (-gain_db / 20)


def check_classifier(classifier: Part, radio: RadioLinkConfig) -> None:
    """Raise ValueError if a classifier needs inputs that a radio does not measure.

    Warn if it was trained in another band, or if its inputs are more exact than the radio's.
    """
    if radio.engine == "table" and radio.receiver != "ue":
        logger.warning(
            "engine is 'table', whose errors were measured with the receiver 'ue', and the receiver is "
            f"{part_name(radio.receiver)!r}: estimated paths are more exact than in a measurement. Take live or "
            "cached to measure them."
        )
    made = CLASSIFIER.make(classifier, field="link_states")
    inputs, name = getattr(made, "inputs", ()), part_name(classifier)
    if "peak" in inputs:
        raise ValueError(
            f"link_states is {name!r}, a classifier that needs heights of peaks, which are not "
            "measured here. Take one without, such as generated."
        )
    if "aod" in inputs and TERMINAL.make(radio.transmitter, field="transmitter").n_beams == 1:
        raise ValueError(
            f"link_states is {name!r}, a classifier that needs directions of departure, which a transmitter with a "
            f"single beam ({part_name(radio.transmitter)}) does not show. Take one without, such as generated-no-aod."
        )
    if "delay" in inputs and not radio.sounding.resolves_delays:
        raise ValueError(
            f"link_states is {name!r}, a classifier that needs delays, which a bandwidth of "
            f"{radio.sounding.bandwidth_mhz:g} MHz does not resolve. Take one without, such as generated-no-sync."
        )
    trained_ghz = getattr(made, "card", {}).get("frequency_ghz")
    if trained_ghz and abs(math.log(radio.frequency_hz / 1e9 / trained_ghz)) > _BAND:
        logger.warning(
            f"link_states is {name!r}, trained at {trained_ghz:g} GHz, and the radio works at "
            f"{radio.frequency_hz / 1e9:g} GHz: probabilities of link states are not reliable. Take the one of "
            "--band, train one on links of robosim dataset at this frequency, or take true."
        )


class Interpreter:
    """Interprets measurements."""

    def __init__(self, radio: RadioLink, classifier: Part) -> None:
        """Load a classifier of `robosim.parts.CLASSIFIER`; the radio gives gains of antennas, and true states."""
        self._radio = radio
        self._classifier: Classifier = CLASSIFIER.make(classifier, field="link_states")

    def interpret(
        self, paths: PathEstimates | None, pose: Float[np.ndarray, "3"], radio: RadioLink | None = None
    ) -> Measurement:
        """Directions in `map` and link state of the estimates of one link, from an estimated pose.

        `radio` is the measured link, if it is not that of the target.
        """
        if paths is None:
            raise ValueError("There is no measurement to interpret: the simulator was made without a radio.")
        n = int(paths.count[0])
        turned = paths.turned(rx_heading_rad=float(pose[2]))
        merged_m = range_merged_m(1e6 * self._radio.config.sounding.bandwidth_mhz)
        return Measurement(
            pose=np.array(pose),
            aoa_rad=turned.aoa_rad[0, :n],
            aod_rad=turned.aod_rad[0, :n],
            snr_db=turned.snr_db[0, :n],
            gain_db=self._radio.sounder.gain_db(paths)[0, :n],
            delay_s=turned.delay_s[0, :n],
            probability=self._probability(turned, radio or self._radio),
            range_m=(radio or self._radio).range_m,
            range_sigma_m=math.hypot(self._radio.config.range_sigma_m or math.nan, merged_m),
            range_merged_m=merged_m,
        )

    def probability(self, paths: PathEstimates) -> Float[np.ndarray, "4"]:
        """Return the probability of each link state, without a pose: for a robot that looks along the map's x axis."""
        if isinstance(self._classifier, TrueStates) or self._radio.config.engine == "table":
            return self._probability(paths, self._radio)
        return self._probability(paths.turned(rx_heading_rad=0.0), self._radio)

    def _probability(self, turned: PathEstimates, radio: RadioLink) -> Float[np.ndarray, "4"]:
        if isinstance(self._classifier, TrueStates):
            return np.eye(len(LinkState))[radio.state]
        if radio.config.engine == "table":
            return radio.table_probability(self._classifier)
        resolved = measured(aod_rad=turned.aod_rad, delay_s=turned.delay_s)
        return self._classifier.predict(turned.aoa_rad, turned.snr_db, **resolved)[0]


#: Interprets a measurement of the transmitter of a name, from an estimated pose.
Interpret = Callable[[str, PathEstimates | None, Float[np.ndarray, "3"]], Measurement]


#: Standard deviation of directions of a separate path, of one that is close to others, and of any path below 10 GHz,
#: where few antennas receive many paths through walls. It does not depend on the link state: a path whose direction and
#: strength fit its landmark is as exact in every state.
_SIGMA_RAD = np.radians([0.1, 0.5, 10.0])
#: Part of it that measurements share over metres.
_SHARED_RAD = np.radians([0.0, 1.0, 5.0])
#: Deviations of the logarithm of ranges, and the part that ranges of one place share.
_LOG_RANGE, _SHARED_LOG_RANGE = np.array([0.06, 0.3, 0.5]), 0.03
#: Standard deviation of the additional length of a path over that of the strongest [m].
_BEYOND_M = 0.05
#: Paths nearer to each other than this in azimuth [rad] and delay [samples] are close.
_CLOSE_RAD, _CLOSE_SAMPLES = math.radians(20.0), 1.3
#: Bounds of ranges from power [m].
_NEAREST_M, _FARTHEST_M = 0.1, 1e5
#: Weaker paths are not used: the strongest, others [dB].
_LEAST_SNR_DB, _LEAST_OTHER_DB = 0.0, 20.0


def bearings_of(
    measured: Mapping[str, Measurement], radio: RadioLinkConfig, known: Mapping[str, Float[np.ndarray, "2"]]
) -> list[Bearing]:
    """Directions of well received transmitters, by name: of each the strongest path, then others.

    `known` are the places [m] in `map` of transmitters whose places are known.
    """
    bearings = []
    for name, measurement in measured.items():
        is_received = len(measurement.aoa_rad) > 0 and measurement.snr_db[0] >= _LEAST_SNR_DB
        if is_received and np.isfinite([measurement.aoa_rad[0], measurement.gain_db[0]]).all():
            bearings.append(_strongest(name, measurement, radio, known.get(name)))
            bearings += _others(name, measurement, radio) if radio.frequency_hz >= OPAQUE_HZ else []
    return bearings


def _strongest(
    name: str, measured: Measurement, radio: RadioLinkConfig, place_xy: Float[np.ndarray, "2"] | None
) -> Bearing:
    # Probabilities of a user's classifier may round to a little over 1.
    direct = float(np.clip(np.nan_to_num(measured.probability[LinkState.LOS]), 0.0, 1.0))
    kind = 2 if radio.frequency_hz < OPAQUE_HZ else int(_is_close(measured, 0, radio))
    length_m, is_ranged = _strongest_m(measured, radio), math.isfinite(measured.range_m)
    return Bearing(
        source=name,
        bearing_rad=wrap(float(measured.aoa_rad[0] - measured.pose[2])),
        sigma_rad=float(_SIGMA_RAD[kind]),
        shared_rad=float(_SHARED_RAD[kind]),
        range_m=length_m,
        sigma_log_range=max(measured.range_sigma_m / length_m, 1e-3)
        if is_ranged
        else float(_LOG_RANGE[kind]),
        shared_log_range=0.0 if is_ranged else _SHARED_LOG_RANGE,
        direct=direct,
        apart_rad=_CLOSE_RAD,
        apart_m=_CLOSE_SAMPLES * speed_of_light * radio.sounding.sample_s,
        place_xy=place_xy,
    )


def _others(name: str, measured: Measurement, radio: RadioLinkConfig) -> list[Bearing]:
    """Return the other strong, separate paths, well within the window of delays."""
    most_m = speed_of_light * (radio.sounding.half_window - 1) * radio.sounding.sample_s
    bearings = []
    for k in range(1, len(measured.aoa_rad)):
        beyond_m = speed_of_light * float(measured.delay_s[k])
        is_strong = measured.snr_db[k] >= _LEAST_OTHER_DB and np.isfinite(measured.aoa_rad[k])
        if not (is_strong and abs(beyond_m) <= most_m) or _is_close(measured, k, radio):
            continue
        bearing = Bearing(
            source=name,
            bearing_rad=wrap(float(measured.aoa_rad[k] - measured.pose[2])),
            sigma_rad=float(_SIGMA_RAD[0]),
            range_m=max(_strongest_m(measured, radio) + beyond_m, _NEAREST_M),
            sigma_log_range=1.0,
            direct=0.0,
            beyond_m=beyond_m,
            sigma_m=_BEYOND_M,
        )
        bearings.append(bearing)
    return bearings


def _strongest_m(measured: Measurement, radio: RadioLinkConfig) -> float:
    """Length of the strongest path [m]: by the range of the first one, or as if only free space attenuates it."""
    length_m = free_path_m(float(measured.gain_db[0]), radio.frequency_hz)
    if math.isfinite(measured.range_m):
        length_m = measured.range_m - speed_of_light * float(np.nan_to_num(measured.delay_s).min())
    return float(np.clip(length_m, _NEAREST_M, _FARTHEST_M))


def _is_close(measured: Measurement, k: int, radio: RadioLinkConfig) -> bool:
    """Whether another strong path is so near in azimuth and delay that the receiver hardly separates them."""
    turn = wrap(measured.aoa_rad - measured.aoa_rad[k])
    gap = np.abs(measured.delay_s - measured.delay_s[k]) / radio.sounding.sample_s
    near = (np.abs(turn) < _CLOSE_RAD) & (gap < _CLOSE_SAMPLES) & (measured.snr_db >= _LEAST_OTHER_DB)
    near[k] = False
    return bool(near.any())
