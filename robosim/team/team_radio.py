"""The radio between robots: a link of each pair through the building.

Both ends of a pair send in turn and sound the channel as they sound the target's: each measures directions of arrival
in its own frame, ranges where the radio measures them, and the link state. Rates follow from the same paths.

Robots do not know how the arrays of the others are turned, so departures are not used.
Left out: bodies of other robots in the paths, interference between pairs, near fields.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import cache, partial
from itertools import combinations

import numpy as np
from jaxtyping import Float

from robosim.parts import CLASSIFIER
from robosim.radio.link import RadioLink
from robosim.radio.measurement import Interpreter, Measurement, check_classifier
from robosim.simulator import Simulator
from robosim.support.parts import Part

#: Nothing is received below this SNR [dB]; most bits per second and hertz.
_LEAST_SNR_DB, _MOST_BITS = -6.0, 8.0

#: Measurements of each robot by the one that sent, of which azimuths are in the frame of the robot; none of robots that
#: were not received.
PairMeasurements = dict[str, dict[str, Measurement]]


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
        self._link = (first.radio or RadioLink(first.building, first.config.radio)).between_receivers()
        if "aod" in getattr(CLASSIFIER.make(classifier, field="link_states"), "inputs", ()):
            classifier = "generated-no-aod"
            check_classifier(classifier, self._link.config)
        self._interpreter = Interpreter(self._link, classifier)
        self._snr_db = dict.fromkeys(combinations(robots, 2), -math.inf)

    def measure(self, going: Collection[str]) -> Callable[[], PairMeasurements]:
        """Trace all links between robots that are going, at their true places; the result sounds them when called."""
        poses = {name: np.array(self._robots[name].pose) for name in going}
        for pair in combinations(going, 2):
            sender_xy, receiver_xy = (poses[name][:2] for name in pair)
            self._link.place(sender_xy)
            gain = float(self._link.trace(receiver_xy).power.sum())
            budget_db = self._link.sounder.budget_db
            self._snr_db[pair] = budget_db + 10 * math.log10(gain) if gain > 0 else -math.inf
        return cache(partial(self._sound, poses))

    def _sound(self, poses: Mapping[str, Float[np.ndarray, "3"]]) -> PairMeasurements:
        received: PairMeasurements = {name: {} for name in self._robots}
        for first, second in combinations(poses, 2):
            for sender, receiver in ((second, first), (first, second)):
                self._link.place(poses[sender][:2])
                estimates = self._link.measure(poses[receiver], self._rng)
                if estimates.count[0]:
                    estimates = replace(estimates, aod_rad=np.full_like(estimates.aod_rad, np.nan))
                    received[receiver][sender] = self._interpreter.interpret(estimates, np.zeros(3))
        return received

    def rate_bps(self, pair: tuple[str, str]) -> float:
        """Rate of a pair [bit/s]: Shannon's, up to 8 bit/s for each hertz of the bandwidth."""
        if self._snr_db[pair] < _LEAST_SNR_DB:
            return 0.0
        bandwidth_hz = 1e6 * self._link.sounder.config.bandwidth_mhz
        return bandwidth_hz * min(math.log2(1 + 10 ** (self._snr_db[pair] / 10)), _MOST_BITS)
