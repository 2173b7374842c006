"""Robots: size, abilities and sensors, from a file or by name (`robosim.robot.named`).

All are differential drives with a camera. `robosim.robot.body` makes a body of them for MuJoCo.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import shapely
import tyro
from jaxtyping import Float

from robosim.parts import LidarPart
from robosim.robot.motion import SpeedProfile
from robosim.support.checks import RADIUS_M, Range, checked
from slam.hull import Hull, Outline
from slam.mapping.odometry import OdometryConfig

#: Time constant of a wheel that takes up its speed [s]. A stiffer servo overshoots at steps of 5 ms.
SERVO_LAG_S = 0.015
#: Half the height of the camera's housing on the mast, and upper edge of the deck, in radii of the hull.
CAMERA_R, DECK_R = 0.15, 1.3
#: Push of the wheels at which the motors stall, as a part of the robot's weight.
STALL_GRIP = 0.5


#: How far something is ahead of the middle of the axle, and its height [m].
Mount = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
@checked
class Sensors:
    """What a robot senses with, and from where."""

    camera_m: Annotated[Mount | None, Range(-10, 10, "m")] = None
    """Place of the camera [m]; None: it has no camera."""
    hfov_deg: Annotated[float, Range(1, 170, "degrees")] = 90.0
    """Horizontal field of view of the camera [deg]."""
    lidar: LidarPart = "none"
    """Kind of its lidar."""
    lidar_m: Annotated[Mount, Range(-10, 10, "m")] = (0.0, 0.2)
    """Place of the lidar [m]."""


@dataclass(frozen=True, kw_only=True)
@checked
class RobotConfig:
    """Size and abilities of the robot; by default like a small TurtleBot."""

    radius_m: Annotated[float, RADIUS_M] = 0.10
    """Radius of the hull [m]. Of a hull with an outline it is half the width, and set from it."""
    outline_m: Annotated[Outline, tyro.conf.Suppress] = ()
    """Corners of the hull, x ahead and y to the left of the middle of the axle [m]; it is their convex outline. None
    for a disk."""
    mass_kg: Annotated[float, Range(0.01, 10_000, "kg")] = 2.0
    """Mass of all but the wheels [kg]."""
    wheel_radius_m: Annotated[float, Range(0.001, 1, "m")] = 0.033
    """Radius of the driven wheels [m]."""
    track_m: Annotated[float, Range(0.001, 10, "m")] = 0.16
    """Distance between the wheels [m]."""
    rotor_inertia_kgm2: Annotated[float, Range(1e-9, 100, "kg m2")] = 0.0005
    """Inertia of a motor's rotor as felt at the wheel [kg m^2]."""
    mast_m: Annotated[float, Range(0.01, 10, "m")] = 1.25
    """Height of the camera [m], which is the robot's too: it drives under what hangs higher. Pictures follow the
    camera's own settings."""
    max_speed_mps: Annotated[float, Range(0.001, 10, "m/s")] = 0.5
    """Highest speed of a wheel [m/s]."""
    max_accel_mps2: Annotated[float, Range(0.001, 1000, "m/s2")] = 2.0
    """Highest acceleration of a wheel [m/s^2]; the kinematic physics ignores it."""
    max_turn_rate_radps: Annotated[float | None, Range(0.001, 100, "rad/s")] = None
    """Highest turn rate [rad/s]. None: what the wheels allow."""
    latency_s: Annotated[float, Range(0, 10, "s")] = 0.0
    """Time from a command of speeds until the wheels begin to follow it [s]. Discrete actions have none: they end where
    they are meant to."""
    sensors: Annotated[Sensors | None, tyro.conf.Suppress] = None
    """Camera and lidar that it comes with, for `SimulatorConfig.of_robot`. None: those of the configuration."""
    model: Annotated[Path | None, tyro.conf.Suppress] = None
    """URDF or MJCF file with the masses and wheels that MuJoCo simulates. None: a body of the sizes above."""
    odometry: Annotated[OdometryConfig | None, tyro.conf.Suppress] = None
    """What a calibration has found of its odometry, as `robosim calibrate` writes it into a robot's file. None: the
    robot is calibrated before its first episode, on an open floor."""

    def __post_init__(self) -> None:
        if self.outline_m:
            object.__setattr__(self, "outline_m", convex_outline(self.outline_m))
            object.__setattr__(self, "radius_m", max(abs(y) for _, y in self.outline_m))
        if self.track_m > 2 * self.radius_m:
            raise ValueError(
                f"track_m is {self.track_m:g}, expected at most the hull's width, {2 * self.radius_m:g} m: "
                "wheels outside of the hull would pass through walls."
            )

    @property
    def height_m(self) -> float:
        """Height of the whole robot [m], with the camera on its mast: what hangs higher does not stop it."""
        return max(self.mast_m + CAMERA_R * self.radius_m, DECK_R * self.radius_m)

    @property
    def hull_m(self) -> tuple[float, float, Outline]:
        """Radius and height [m] of the upright cylinder, or prism with an outline, that the robot is to obstacles."""
        return self.radius_m, self.height_m, self.outline_m

    @property
    def hull(self) -> Hull:
        """The hull from above."""
        return Hull(self.radius_m, self.outline_m)

    @property
    def turn_rate_radps(self) -> float:
        """Highest turn rate on the spot [rad/s]."""
        return min(self.max_turn_rate_radps or math.inf, 2 * self.max_speed_mps / self.track_m)

    @property
    def servo_gain(self) -> float:
        """Torque of a wheel's servo per error of its speed [N m s/rad], for the lag `SERVO_LAG_S`."""
        rolling = self.mass_kg / 2 * self.wheel_radius_m**2
        return (self.rotor_inertia_kgm2 + rolling) / SERVO_LAG_S

    @property
    def stall_torque_nm(self) -> float:
        """Torque at which a wheel's motor stalls [N m], before the wheel slips: MuJoCo's would hop."""
        return STALL_GRIP * self.mass_kg * 9.81 * self.wheel_radius_m / 2

    @property
    def stall_slip_mps(self) -> float:
        """Excess of a wheel's commanded speed over its own [m/s] at which its motor stalls."""
        return self.stall_torque_nm / self.servo_gain * self.wheel_radius_m

    def within_reach(self, v_mps: float, w_radps: float) -> tuple[float, float]:
        """The fastest speed and turn rate along the same arc within the limits of wheels and turn rate."""
        rim = abs(v_mps) + abs(w_radps) * self.track_m / 2
        part = min(1.0, self.max_speed_mps / rim) if rim > 0 else 1.0
        if self.max_turn_rate_radps is not None and w_radps:
            part = min(part, self.max_turn_rate_radps / abs(w_radps))
        return part * v_mps, part * w_radps

    def profile(self, displacement: Float[np.ndarray, "3"]) -> SpeedProfile:
        """Fastest motion along a displacement dx [m], dy [m], dyaw [rad] that is within reach of the wheels."""
        dx, dy, turn = displacement
        length_m = math.hypot(dx, dy) + abs(turn) * self.track_m / 2
        speed_mps = self.max_speed_mps
        if self.max_turn_rate_radps is not None and turn:
            speed_mps = min(speed_mps, self.max_turn_rate_radps * length_m / abs(turn))
        return SpeedProfile.fastest(length_m, speed_mps=speed_mps, accel_mps2=self.max_accel_mps2)


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


#: With the radius of the published agent.
TURTLEBOT = RobotConfig()
#: With the radius of a LoCoBot.
LOCOBOT = RobotConfig(
    radius_m=0.18, mass_kg=6.5, wheel_radius_m=0.035, track_m=0.23, rotor_inertia_kgm2=0.002
)


def robot_of_radius(radius_m: float) -> RobotConfig:
    """The robot that has a name and a hull of this radius, or else the small one with such a hull."""
    for robot in (TURTLEBOT, LOCOBOT):
        if robot.radius_m == radius_m:
            return robot
    return RobotConfig(radius_m=radius_m, track_m=min(RobotConfig().track_m, 1.6 * radius_m))
