"""What a robot knows when it chooses a goal."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robosim.radio.measurement import Heard
from slam.grid import MapEstimate


@dataclass(frozen=True, eq=False)
class Moment:
    """One decision's knowledge; never the truth."""

    estimate: MapEstimate
    """Map and pose."""
    heard: Heard | None = None
    """What its radio heard; None without a radio."""
    target: Float[np.ndarray, "2"] | None = None
    """Where its camera sees the target now: x ahead, y left [m]; None if it does not."""

    def listened(self) -> Heard:
        """What the radio heard, for policies that cannot do without.

        Raises:
            ValueError: If there is no radio.
        """
        if self.heard is None:
            raise ValueError("This policy needs what the radio heard, but the robot has no radio.")
        return self.heard
