"""The estimates of a robot: with the `Observation`, they are all inputs of a goal policy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from robosim.radio.measurement import Measurement
from slam.graph.landmarks import Transmitter
from slam.grid import MapEstimate


@dataclass(frozen=True, eq=False)
class Estimates:
    """Map, pose and radio link as the robot estimates them at one step; never the truth."""

    map: MapEstimate
    """Map and pose."""
    measurement: Measurement | None = None
    """Radio measurement of the target; None without a radio."""
    anchors: Mapping[str, Measurement] = field(default_factory=dict)
    """Radio measurements of other transmitters, by name."""
    anchor_places: Mapping[str, Float[np.ndarray, "2"]] = field(default_factory=dict)
    """Positions in `map` [m] of those other transmitters whose position the robot knows."""
    locate_transmitters: Callable[[], Mapping[str, Transmitter]] = dict
    """Returns the positions of transmitters by name ("target" is one), if the mapper estimates them. Call it only where
    it is needed: the covariances take milliseconds."""
    received: Sequence[Measurement] = ()
    """Measurements of the target that other robots of a team have taken, since the last decision."""
    measure_robots: Callable[[], Mapping[str, Measurement]] = dict
    """Returns the radio measurements of the other robots of a team by name, at the last occasion. Call it only where it
    is needed: a measurement takes milliseconds."""

    @property
    def pose(self) -> Float[np.ndarray, "3"]:
        """Estimated pose: x [m], y [m], yaw [rad] in `map`."""
        return self.map.pose

    def require_measurement(self) -> Measurement:
        """The radio measurement, for policies that need one.

        Raises:
            ValueError: If there is no radio.
        """
        if self.measurement is None:
            raise ValueError("This policy needs radio measurements, but the robot has no radio.")
        return self.measurement
