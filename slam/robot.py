"""The robot: what navigation must know of it, stated once and passed whole to mapper, planner and controller."""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import shapely
import tyro

from robosim.support.checks import RADIUS_M, Range, check_number, checked
from slam.hull import Hull, Outline
from slam.odometry import OdometryConfig, Vector
from slam.sensing.projection import CameraModel

#: Radius of a hull without radius or outline [m].
DEFAULT_RADIUS_M = 0.10


@dataclass(frozen=True, kw_only=True)
@checked
class Robot:
    """Hull, limits, camera and errors of a differential drive; by default like a small TurtleBot.

    The mount of a lidar comes with each `slam.sensing.laser.LaserScan`.
    """

    radius_m: Annotated[float | None, RADIUS_M] = None
    """Radius of the hull [m]. None: 0.10, or half the width of the outline."""
    outline_m: Annotated[Outline, tyro.conf.Suppress] = ()
    """Corners of the hull, x ahead and y to the left of the middle of the axle [m]; it is their convex outline. None
    for a disk."""
    mast_m: Annotated[float, Range(0.01, 10, "m")] = 1.25
    """Height of the robot [m]: it drives under what hangs higher, and carries no sensor higher."""
    track_m: Annotated[float, Range(0.001, 10, "m")] = 0.16
    """Distance between the wheels [m]."""
    max_speed_mps: Annotated[float, Range(0.001, 10, "m/s")] = 0.5
    """Highest speed of a wheel [m/s]."""
    max_accel_mps2: Annotated[float, Range(0.001, 1000, "m/s2")] = 2.0
    """Highest acceleration of a wheel [m/s^2]; the kinematic physics ignores it."""
    max_turn_rate_radps: Annotated[float | None, Range(0.001, 100, "rad/s")] = None
    """Highest turn rate [rad/s]. None: what the wheels allow."""
    latency_s: Annotated[float, Range(0, 10, "s")] = 0.0
    """Time from a command of speeds until the wheels begin to follow it [s]. Discrete actions have none: they end where
    they are meant to."""
    camera: CameraModel | None = field(default_factory=CameraModel)
    """Optics and mount of the depth camera. None: it has no camera."""
    odometry: Annotated[OdometryConfig | None, tyro.conf.Suppress] = None
    """Errors of odometry and mean motions of actions, from a calibration. None: they are guessed."""

    def __post_init__(self) -> None:
        if self.outline_m:
            object.__setattr__(self, "outline_m", convex_outline(self.outline_m))
            check_number("the reach of outline_m", self.hull.turning_m, *RADIUS_M)
            if self.radius_m is not None and abs(self.radius_m - self.hull.radius_m) > 1e-9:
                raise ValueError(
                    f"radius_m is {self.radius_m:g}, but outline_m is {2 * self.hull.radius_m:g} m wide: "
                    f"{self.hull.radius_m:g} m to a side. Leave one of them out."
                )
        if self.track_m > 2 * self.hull.radius_m:
            raise ValueError(
                f"track_m is {self.track_m:g}, expected at most the hull's width, {2 * self.hull.radius_m:g} m: "
                "wheels outside of the hull would pass through walls."
            )

    @property
    def hull(self) -> Hull:
        """The hull from above."""
        if self.outline_m:
            return Hull(max(abs(y) for _, y in self.outline_m), self.outline_m)
        return Hull(DEFAULT_RADIUS_M if self.radius_m is None else self.radius_m)

    @property
    def turn_rate_radps(self) -> float:
        """Highest turn rate on the spot [rad/s]."""
        return min(self.max_turn_rate_radps or math.inf, 2 * self.max_speed_mps / self.track_m)

    @property
    def optics(self) -> CameraModel:
        """The camera; without one any, as no depth is measured."""
        return self.camera or CameraModel()

    @property
    def errors(self) -> OdometryConfig:
        """Errors of odometry, guessed without a calibration."""
        return self.odometry or OdometryConfig()

    @property
    def motions(self) -> tuple[Vector | None, ...]:
        """Mean displacement of each action, in the order of `MOVES`: x, y [m], yaw [rad]; None for nominal."""
        return tuple(error.motion for error in self.errors.of_actions)


def convex_outline(corners: Outline) -> Outline:
    """The convex outline of some corners, counter-clockwise.

    Raises:
        ValueError: If it does not enclose the middle of the axle.
    """
    outline = shapely.MultiPoint(corners).convex_hull
    if not (
        np.isfinite(corners).all() and outline.area > 0 and outline.contains_properly(shapely.Point(0, 0))
    ):
        raise ValueError(
            f"outline_m is {corners}, expected at least three corners around the middle of the axle, which is at 0, 0."
        )
    return tuple((x, y) for x, y in shapely.orient_polygons(outline).exterior.coords[:-1])
