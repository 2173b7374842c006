"""A measurement of the robot's radio, interpreted: directions in its own map, and the link state.

Azimuths of arrival are in the robot's frame and are turned by its estimated yaw, so that an error of its pose becomes
an error of direction. A classifier gives calibrated probabilities of the link state; or they are those of the true
state.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light

from robosim.parts import CLASSIFIER
from robosim.radio.link import RadioLink
from robosim.radio.link_state import Classifier, TrueStates
from robosim.support.parts import Part, part_name
from wireless.estimates import PathEstimates
from wireless.paths import LinkState


@dataclass(frozen=True, eq=False)
class Measurement:
    """One measurement; the strongest path first."""

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
    """Of each `LinkState`."""

    @property
    def state(self) -> LinkState:
        """The most probable link state."""
        return LinkState(int(np.argmax(self.probability)))


def free_path_m(gain_db: float, frequency_hz: float) -> float:
    """Length [m] of a path in free space of a gain (Friis): lambda / (4 pi) 10^(-gain / 20 dB)."""
    return speed_of_light / frequency_hz / (4 * math.pi) * 10 ** (-gain_db / 20)


def check_classifier(classifier: Part) -> None:
    """Raise ValueError if a classifier needs inputs that episodes do not measure."""
    made = CLASSIFIER.make(classifier, field="link_states")
    if "peak" in getattr(made, "inputs", ()):
        raise ValueError(
            f"link_states is {part_name(classifier)!r}, a classifier that needs heights of peaks, which are not "
            "measured here. Take one without, such as generated."
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
        return Measurement(
            pose=np.array(pose),
            aoa_rad=turned.aoa_rad[0, :n],
            aod_rad=turned.aod_rad[0, :n],
            snr_db=turned.snr_db[0, :n],
            gain_db=self._radio.sounder.gain_db(paths)[0, :n],
            delay_s=turned.delay_s[0, :n],
            probability=self._probability(turned, radio or self._radio),
        )

    def probability(self, paths: PathEstimates) -> Float[np.ndarray, "4"]:
        """Of each link state, without a pose: as of a robot that looks along the map's x axis."""
        if isinstance(self._classifier, TrueStates) or self._radio.config.engine == "table":
            return self._probability(paths, self._radio)
        return self._probability(paths.turned(rx_heading_rad=0.0), self._radio)

    def _probability(self, turned: PathEstimates, radio: RadioLink) -> Float[np.ndarray, "4"]:
        if isinstance(self._classifier, TrueStates):
            return np.eye(len(LinkState))[radio.state]
        if radio.config.engine == "table":
            return radio.table_probability(self._classifier)
        return self._classifier.predict(
            turned.aoa_rad, turned.snr_db, aod_rad=turned.aod_rad, delay_s=turned.delay_s
        )[0]
