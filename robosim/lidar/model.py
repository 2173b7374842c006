"""A planar laser scanner (2D lidar) on a robot: what it is, how it errs, and what every one does."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.support.checks import LEVEL, check_numbers
from slam.sensing.laser import LaserScan


@dataclass(frozen=True, kw_only=True)
class LidarConfig:
    """How a lidar is used."""

    height_m: float = 0.2
    """Height of the beams above the floor [m]."""
    level: float = 1.0
    """Scale of its errors and of the part of beams that return nothing: 0 none, 1 as its maker says."""

    def __post_init__(self) -> None:
        check_numbers(self, height_m=(0.001, 100, "m"), level=LEVEL)


@dataclass(frozen=True, kw_only=True)
class LidarModel:
    """A kind of lidar: its fan of beams, and how they err."""

    beams: int
    """Beams of a turn."""
    fov_deg: float
    """Angle from the first to the last beam [deg]; 360 for all around."""
    min_range_m: float
    """Nearer surfaces are not measured [m]."""
    max_range_m: float
    """Farther surfaces are not measured [m]."""
    sigma_m: float
    """Least standard deviation of a range [m]."""
    sigma_share: float
    """Standard deviation as a part of the range, where that is more."""
    missing: float
    """Part of the beams that return nothing for no reason."""
    grazing_deg: float = 85.0
    """Surfaces met at more than this from their normal return nothing [deg]."""

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
    """What every lidar does."""

    def scan(self, pose: Float[np.ndarray, "3"], rng: np.random.Generator) -> LaserScan:
        """Measure.

        Args:
            pose: True pose of the robot in `map`: x [m], y [m], yaw [rad].
            rng: Source of its noise.
        """

    def true_scan(self, pose: Float[np.ndarray, "3"]) -> LaserScan:
        """What it would measure if it did not err, for judging."""
