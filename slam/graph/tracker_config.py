"""Settings of the tracker."""

import math
from dataclasses import dataclass, field
from typing import Annotated

from robosim.support.checks import Range, checked
from slam.graph.submaps import OF_SUBMAP
from slam.matching.scan_matching import MatchConfig


@dataclass(frozen=True, kw_only=True)
@checked
class TrackerConfig:
    """Settings of the tracker."""

    cell_m: Annotated[float, Range(0.005, 0.5, "m")] = 0.05
    """Side of the cells of surfaces [m]."""
    submap_m: Annotated[float, Range(0.1, 1000, "m")] = 4.0
    """Distance after which a submap is closed [m]."""
    submap_scans: Annotated[int, Range(1, 100_000, "scans")] = 60
    """Scans after which it is closed, at the latest."""
    loops: bool = True
    """Whether loops are closed; without, poses do not change later."""
    radio: bool = True
    """Whether sources of a radio are landmarks."""
    walls: bool = True
    """Whether walls that are nearly parallel or perpendicular to others hold the yaw."""
    match: MatchConfig = field(default_factory=MatchConfig)
    """Settings of scan matching."""
    submap_error: Annotated[float, Range(0, 100)] = OF_SUBMAP
    """Least standard deviation of a fit of submaps, which are not quite rigid, relative to that of a point."""
    together_m: Annotated[float, Range(0.001, 10, "m")] = 0.05
    """Submaps are matched if their position relative to the current one is known to this [m]."""
    together_rad: Annotated[float, Range(1e-4, math.pi, "rad")] = math.radians(1.0)
    """Submaps are matched if their yaw relative to the current one is known to this [rad]."""
    drift_m: Annotated[float, Range(0, 10, "m")] = 0.01
    """Drift of matched poses, beyond the covariance of matches, per square root of a metre driven [m]."""
    drift_rad: Annotated[float, Range(0, math.pi, "rad")] = math.radians(0.03)
    """Drift of their yaw per square root of a metre driven [rad]."""
    drift_turn_rad: Annotated[float, Range(0, math.pi, "rad")] = math.radians(0.12)
    """Drift of their yaw per square root of a radian turned [rad]."""
    overlap: Annotated[int, Range(1, 1_000_000, "surfaces")] = 40
    """Surfaces that two submaps must both have seen to be fitted."""
    agreement: Annotated[float, Range(0, 1)] = 0.8
    """Part of the surfaces seen by both that must not contradict, where odometry is precise."""
    searched_agreement: Annotated[float, Range(0, 1)] = 0.9
    """Least agreement of a loop that had to be searched for."""
