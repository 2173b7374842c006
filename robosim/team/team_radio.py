"""The radio between robots: a link of each pair through the building.

Both ends of a pair send in turn and sound the channel as they sound the target's: each measures directions of arrival
in its own frame, ranges where the radio measures them, and the link state. Rates follow from the same paths.

Robots do not know how the arrays of the others are turned, so departures are not used.
Left out: bodies of other robots in the paths, interference between pairs, near fields.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from robosim.parts import CLASSIFIER
from robosim.radio.link import RadioLink
from robosim.radio.measurement import Interpreter, Measurement, check_classifier
from robosim.simulator import Simulator
from robosim.support.parts import Part

#: Nothing is received below this SNR [dB]; most bits per second and hertz.
_LEAST_SNR_DB, _MOST_BITS = -6.0, 8.0


class TeamRadio:
    """Links of all pairs of robots."""

    def __init__(self, robots: Mapping[str, Simulator], classifier: Part, rng: np.random.Generator) -> None:
        """Make the links; both ends have the arrays that robots receive with.

        Args:
            robots: The robots by name.
            classifier: Of link states; one that needs departures is replaced by `generated-no-aod`.
            rng: Draws the noise of measurements.
        """
        self._robots, self._rng = robots, rng
        first = next(iter(robots.values()))
        config = first.config.radio
        config = replace(config, transmitter=config.receiver, engine="live", tables=None)
        self._link = RadioLink(first.building, config)
        if "aod" in getattr(CLASSIFIER.make(classifier, field="link_states"), "inputs", ()):
            classifier = "generated-no-aod"
            check_classifier(classifier, config)
        self._interpreter = Interpreter(self._link, classifier)
        self._snr_db = dict.fromkeys(combinations(robots, 2), -math.inf)
        self.measured: dict[str, dict[str, Measurement]] = {name: {} for name in robots}
        """Last measurements of each robot by the one that sent, of which azimuths are in the frame of the robot; none
        of robots that were not received."""

    def measure(self, going: Collection[str]) -> None:
        """Trace and sound all links between robots that are going, at their true places."""
        self.measured = {name: {} for name in self._robots}
        for pair in combinations(going, 2):
            for sender, receiver in (pair[::-1], pair):
                self._sound(sender, receiver)
            paths = self._link.paths
            gain = 0.0 if paths is None else float(paths.power.sum())
            budget_db = self._link.sounder.budget_db
            self._snr_db[pair] = budget_db + 10 * math.log10(gain) if gain > 0 else -math.inf

    def _sound(self, sender: str, receiver: str) -> None:
        self._link.place(self._robots[sender].pose[:2])
        estimates = self._link.measure(self._robots[receiver].pose, self._rng)
        if estimates.count[0]:
            estimates = replace(estimates, aod_rad=np.full_like(estimates.aod_rad, np.nan))
            self.measured[receiver][sender] = self._interpreter.interpret(estimates, np.zeros(3))

    def rate_bps(self, pair: tuple[str, str]) -> float:
        """Rate of a pair [bit/s]: Shannon's, up to 8 bit/s for each hertz of the bandwidth."""
        if self._snr_db[pair] < _LEAST_SNR_DB:
            return 0.0
        bandwidth_hz = 1e6 * self._link.sounder.config.bandwidth_mhz
        return bandwidth_hz * min(math.log2(1 + 10 ** (self._snr_db[pair] / 10)), _MOST_BITS)
