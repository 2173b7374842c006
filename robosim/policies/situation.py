"""What a robot knows when it chooses a goal."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from robosim.radio.measurement import Measurement
from robosim.simulator import Observation
from slam.graph.landmarks import Transmitter
from slam.grid import MapEstimate


@dataclass(frozen=True, eq=False)
class Situation:
    """One decision's knowledge; never the truth."""

    estimate: MapEstimate
    """Map and pose."""
    measurement: Measurement | None = None
    """What its radio measured; None without a radio."""
    anchors: Mapping[str, Measurement] = field(default_factory=dict)
    """The same of other transmitters, by their names."""
    places: Mapping[str, Float[np.ndarray, "2"]] = field(default_factory=dict)
    """Where those of them stand, in `map` [m], of which that is known."""
    target: Float[np.ndarray, "2"] | None = None
    """Where its camera sees the target now: x ahead, y left [m]; None if it does not."""
    view: Observation | None = None
    """What it sensed, for policies that use neither map nor pose."""
    located: Callable[[], Mapping[str, Transmitter]] = dict
    """Where the mapper takes transmitters to stand, by name ("target" is one), if it listens to them. To be asked only
    where it is needed: covariances take milliseconds."""

    def measured(self) -> Measurement:
        """What the radio measured, for policies that cannot do without.

        Raises:
            ValueError: If there is no radio.
        """
        if self.measurement is None:
            raise ValueError("This policy needs what a radio measures, but the robot has no radio.")
        return self.measurement
