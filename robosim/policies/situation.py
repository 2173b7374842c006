"""What a robot knows when it chooses a goal."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robosim.radio.measurement import Measurement
from slam.grid import MapEstimate


@dataclass(frozen=True, eq=False)
class Situation:
    """One decision's knowledge; never the truth."""

    estimate: MapEstimate
    """Map and pose."""
    measurement: Measurement | None = None
    """What its radio measured; None without a radio."""
    target: Float[np.ndarray, "2"] | None = None
    """Where its camera sees the target now: x ahead, y left [m]; None if it does not."""

    def measured(self) -> Measurement:
        """What the radio measured, for policies that cannot do without.

        Raises:
            ValueError: If there is no radio.
        """
        if self.measurement is None:
            raise ValueError("This policy needs what a radio measures, but the robot has no radio.")
        return self.measurement
