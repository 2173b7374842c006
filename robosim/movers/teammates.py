"""The other robots of a world, as one of them meets them: upright cylinders that stop it, and that its sensors see."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from robosim.movers.mover import Body, Surroundings


class Teammates:
    """Robots that stand where the world has put them (`robosim.movers.mover.Mover`)."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self.bodies = bodies
        self._at = np.full((len(bodies), 3), np.nan)

    def place(self, poses: Float[np.ndarray, "n 3"]) -> None:
        """Put them at poses x [m], y [m], yaw [rad] in `map`."""
        self._at = np.array(poses, float)

    def reset(self, surroundings: Surroundings, rng: np.random.Generator) -> None:
        """Stay where they were put last."""

    def poses(self, time_s: float, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Where they were put last."""
        return self._at
