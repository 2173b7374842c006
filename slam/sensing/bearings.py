"""Directions in which sources lie that stand still, as a radio tells them."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from slam.support.checks import check_number


@dataclass(frozen=True, kw_only=True, eq=False)
class Bearing:
    """Where a source appears from where the robot is.

    In line of sight that is the source itself. A reflected path comes from its mirror image, a diffracted one from a
    corner: those stand still too, but nobody knows where.
    """

    source: str
    """Name of what sends."""
    bearing_rad: float
    """Azimuth in the robot's frame [rad]."""
    sigma_rad: float
    """Standard deviation of that [rad], as one measurement tells it."""
    range_m: float
    """About how far away the source appears [m]."""
    sigma_log_range: float
    """Standard deviation of the natural logarithm of that."""
    direct: float = 1.0
    """Probability that it is the source itself, in line of sight."""
    beyond_m: float | None = None
    """How much farther this path came than the first of the same source [m]: delays are compared better than measured
    alone. None for the first."""
    sigma_m: float = 0.05
    """Standard deviation of that [m]."""
    shared_rad: float = 0.0
    """Standard deviation of an error that bearings have in common as long as the path comes from one direction [rad],
    beside `sigma_rad`: that of paths which can hardly be told apart."""
    shared_log_range: float = 0.0
    """Standard deviation of an error that the logarithms of all distances of one place have in common, beside
    `sigma_log_range`, unless they are wrong altogether, as off a wall that took power."""
    apart_rad: float = 0.0
    """Paths nearer to each other in azimuth than this [rad], and in length than `apart_m`, are one to the receiver."""
    apart_m: float = 0.0
    """The same of their lengths [m]."""
    place_xy: Float[np.ndarray, "2"] | None = None
    """Where the source stands in `map` [m], if that is known."""

    def __post_init__(self) -> None:
        check_number("bearing_rad", self.bearing_rad, -2 * math.pi, 2 * math.pi, "rad")
        check_number("sigma_rad", self.sigma_rad, 1e-6, math.pi, "rad")
        check_number("range_m", self.range_m, 1e-3, 1e6, "m")
        check_number("sigma_log_range", self.sigma_log_range, 1e-4, 10)
        check_number("direct", self.direct, 0, 1)
        if self.beyond_m is not None:
            check_number("beyond_m", self.beyond_m, -1e6, 1e6, "m")
        check_number("shared_rad", self.shared_rad, 0, math.pi, "rad")
        check_number("shared_log_range", self.shared_log_range, 0, 10)
        check_number("sigma_m", self.sigma_m, 1e-4, 1e3, "m")
        check_number("apart_rad", self.apart_rad, 0, math.pi, "rad")
        check_number("apart_m", self.apart_m, 0, 1e6, "m")
