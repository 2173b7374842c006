"""Bearings of static sources, as a radio measures them."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from robosim.support.checks import Range, checked


@dataclass(frozen=True, kw_only=True, eq=False)
@checked
class Bearing:
    """Where a source appears from where the robot is.

    In line of sight that is the source itself. A reflected path comes from its mirror image, a diffracted one from a
    corner: such origins are static too, at unknown positions.
    """

    source: str
    """Name of the source."""
    bearing_rad: Annotated[float, Range(-2 * math.pi, 2 * math.pi, "rad")]
    """Azimuth in the robot's frame [rad]."""
    sigma_rad: Annotated[float, Range(1e-6, math.pi, "rad")]
    """Standard deviation of that [rad], of one measurement."""
    range_m: Annotated[float, Range(1e-3, 1e6, "m")]
    """About how far away the source appears [m]."""
    sigma_log_range: Annotated[float, Range(1e-4, 10)]
    """Standard deviation of the natural logarithm of that."""
    direct: Annotated[float, Range(0, 1)] = 1.0
    """Probability that it is the source itself, in line of sight."""
    beyond_m: Annotated[float | None, Range(-1e6, 1e6, "m")] = None
    """How much farther this path came than the first of the same source [m]: delays are compared better than measured
    alone. None for the first."""
    sigma_m: Annotated[float, Range(1e-4, 1e3, "m")] = 0.05
    """Standard deviation of that [m]."""
    shared_rad: Annotated[float, Range(0, math.pi, "rad")] = 0.0
    """Standard deviation of an error that bearings share while the path comes from one direction [rad], in addition to
    `sigma_rad`: that of paths which can hardly be separated."""
    shared_log_range: Annotated[float, Range(0, 10)] = 0.0
    """Standard deviation of an error that the logarithms of all distances of one place share, in addition to
    `sigma_log_range`, unless they are outliers, as after a reflection that took power."""
    apart_rad: Annotated[float, Range(0, math.pi, "rad")] = 0.0
    """The receiver cannot separate paths whose azimuths differ by less [rad], and lengths by less than `apart_m`."""
    apart_m: Annotated[float, Range(0, 1e6, "m")] = 0.0
    """Difference of path lengths below which the receiver cannot separate paths [m]."""
    place_xy: Float[np.ndarray, "2"] | None = None
    """Position of the source in `map` [m], if known."""
