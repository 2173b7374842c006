"""A planar laser scanner (2D lidar) on a robot: its beams and errors, and the interface of all lidars."""

from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.support.checks import LEVEL, Range, checked
from slam.sensing.laser import LaserScan


@dataclass(frozen=True, kw_only=True)
@checked
class LidarConfig:
    """Mounting of a lidar, and scale of its errors."""

    height_m: Annotated[float, Range(0.001, 100, "m")] = 0.2
    """Height of the beams above the floor [m]."""
    level: Annotated[float, LEVEL] = 1.0
    """Scale of its errors and of the part of beams that return nothing: 0 none, 1 as in its data sheet."""


@dataclass(frozen=True, kw_only=True)
@checked
class LidarModel:
    """A kind of lidar: its fan of beams and their errors; by default an RPLIDAR A1."""

    beams: Annotated[int, Range(3, 100_000, "beams")] = 360
    """Beams of a turn."""
    fov_deg: Annotated[float, Range(1, 360, "degrees")] = 360.0
    """Angle from the first to the last beam [deg]; 360 for all around."""
    min_range_m: Annotated[float, Range(0, 1000, "m")] = 0.15
    """Nearer surfaces are not measured [m]."""
    max_range_m: Annotated[float, Range(0.01, 1000, "m")] = 12.0
    """Farther surfaces are not measured [m]."""
    sigma_m: Annotated[float, Range(0, 10, "m")] = 0.002
    """Least standard deviation of a range [m]."""
    sigma_share: Annotated[float, Range(0, 1)] = 0.005
    """Standard deviation as a part of the range, where that is more."""
    missing: Annotated[float, Range(0, 1)] = 0.01
    """Part of the beams that return nothing at random."""
    grazing_deg: Annotated[float, Range(1, 90, "degrees")] = 85.0
    """Surfaces met at more than this from their normal return nothing [deg]."""

    def __post_init__(self) -> None:
        if not self.min_range_m < self.max_range_m:
            raise ValueError(
                f"min_range_m is {self.min_range_m} and max_range_m {self.max_range_m}, expected the first below the "
                "other."
            )

    @property
    def bearing_rad(self) -> Float[np.ndarray, " n"]:
        """Directions of the beams in the robot's frame [rad], rising."""
        half = np.radians(self.fov_deg) / 2
        if self.fov_deg == 360.0:
            return np.linspace(-half, half, self.beams, endpoint=False)
        return np.linspace(-half, half, self.beams)

    def sigma_at(self, range_m: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Standard deviation of ranges [m]."""
        return np.maximum(self.sigma_m, self.sigma_share * range_m)


@runtime_checkable
class Lidar(Protocol):
    """Interface of lidars."""

    def scan(self, pose: Float[np.ndarray, "3"], rng: np.random.Generator) -> LaserScan:
        """Measure at a true pose in `map`, x [m], y [m], yaw [rad], with noise from a generator."""

    def true_scan(self, pose: Float[np.ndarray, "3"]) -> LaserScan:
        """Measure without errors."""
