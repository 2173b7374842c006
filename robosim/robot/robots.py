"""Robots: size, abilities and sensors, from a file or by name (`robosim.robot.named`).

All are differential drives with a camera. `robosim.robot.body` makes a body of them for MuJoCo.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float

from robosim.camera.depth_noise import DepthNoise
from robosim.camera.model import CameraConfig
from robosim.lidar import LidarConfig
from robosim.parts import LidarPart
from robosim.robot.motion import SpeedProfile
from robosim.robot.odometry import NoiseModel
from robosim.support.checks import Range, checked
from slam.hull import Outline
from slam.robot import Robot

#: Time constant of a wheel that takes up its speed [s]. A stiffer servo overshoots at steps of 5 ms.
SERVO_LAG_S = 0.015
#: Half the height of the camera's housing on the mast, and upper edge of the deck, in radii of the hull.
CAMERA_R, DECK_R = 0.15, 1.3
#: Push of the wheels at which the motors stall, as a part of the robot's weight.
STALL_GRIP = 0.5
#: Sensors are no farther outside of the hull [m].
_OUTSIDE_M = 0.5


@dataclass(frozen=True, kw_only=True)
@checked
class RobotConfig(Robot):
    """A robot as it is simulated: sizes, abilities, sensors and errors; by default like a small TurtleBot."""

    camera: Annotated[
        CameraConfig | None, tyro.conf.AvoidSubcommands, tyro.conf.arg(name="image", prefix_name=False)
    ] = field(default_factory=CameraConfig)
    """Pictures, optics and mount of its camera. None: it has no camera."""
    lidar: Annotated[LidarPart, tyro.conf.arg(prefix_name=False)] = "none"
    """2D lidar with the camera or, without one, instead of it: rplidar-a1, lds-01, ust-10lx, ring-64, rangers-4 or
    vl53l5cx."""
    laser: Annotated[LidarConfig, tyro.conf.arg(prefix_name=False)] = field(default_factory=LidarConfig)
    """Mount of the lidar, and scale of its errors."""
    noise: Annotated[NoiseModel, tyro.conf.arg(prefix_name=False)] = field(default_factory=NoiseModel)
    """Actuation and odometry noise."""
    depth_noise: Annotated[DepthNoise, tyro.conf.arg(prefix_name=False)] = field(default_factory=DepthNoise)
    """Noise of the depth camera."""
    mass_kg: Annotated[float, Range(0.01, 10_000, "kg")] = 2.0
    """Mass of all but the wheels [kg]."""
    wheel_radius_m: Annotated[float, Range(0.001, 1, "m")] = 0.033
    """Radius of the driven wheels [m]."""
    rotor_inertia_kgm2: Annotated[float, Range(1e-9, 100, "kg m2")] = 0.0005
    """Inertia of a motor's rotor as felt at the wheel [kg m^2]."""
    model: Annotated[Path | None, tyro.conf.Suppress] = None
    """URDF or MJCF file with the masses and wheels that MuJoCo simulates. None: a body of the sizes above."""

    def __post_init__(self) -> None:
        super().__post_init__()
        mounts = {"camera": self.camera, "laser": None if self.lidar == "none" else self.laser}
        for name, mount in mounts.items():
            if mount is not None and mount.height_m > self.mast_m:
                option = "image" if name == "camera" else name
                raise ValueError(
                    f"{name}.height_m is {mount.height_m:g}, but mast_m, the robot's height, is {self.mast_m:g} m. Set "
                    f"{name}.height_m (--{option}.height-m) lower, or mast_m (--robot.mast-m) higher."
                )
            if mount is not None and abs(mount.ahead_m) > self.hull.turning_m + _OUTSIDE_M:
                reach = f"the hull reaches {self.hull.turning_m:g} m"
                raise ValueError(f"{name}.ahead_m is {mount.ahead_m:g}, but {reach}. Set it lower.")
        if self.lidar == "none" and self.laser != LidarConfig():
            raise ValueError("laser is set, but lidar is 'none'. Name the lidar, such as --lidar rplidar-a1.")

    @property
    def height_m(self) -> float:
        """Height of the whole robot [m], with the camera on its mast: what hangs higher does not stop it."""
        return max(self.mast_m + CAMERA_R * self.hull.radius_m, DECK_R * self.hull.radius_m)

    @property
    def hull_m(self) -> tuple[float, float, Outline]:
        """Radius and height [m] of the upright cylinder, or prism with an outline, that the robot is to obstacles."""
        return self.hull.radius_m, self.height_m, self.outline_m

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
        factor = min(1.0, self.max_speed_mps / rim) if rim > 0 else 1.0
        if self.max_turn_rate_radps is not None and w_radps:
            factor = min(factor, self.max_turn_rate_radps / abs(w_radps))
        return factor * v_mps, factor * w_radps

    def profile(self, displacement: Float[np.ndarray, "3"]) -> SpeedProfile:
        """Fastest motion along a displacement dx [m], dy [m], dyaw [rad] that is within reach of the wheels."""
        dx, dy, turn = (float(component) for component in displacement)
        length_m = math.hypot(dx, dy) + abs(turn) * self.track_m / 2
        speed_mps = self.max_speed_mps
        if self.max_turn_rate_radps is not None and turn:
            speed_mps = min(speed_mps, self.max_turn_rate_radps * length_m / abs(turn))
        return SpeedProfile.fastest(length_m, speed_mps=speed_mps, accel_mps2=self.max_accel_mps2)


#: With the radius of the published agent.
TURTLEBOT = RobotConfig()
#: With the radius of a LoCoBot.
LOCOBOT = RobotConfig(
    radius_m=0.18, mass_kg=6.5, wheel_radius_m=0.035, track_m=0.23, rotor_inertia_kgm2=0.002
)


def robot_of_radius(radius_m: float) -> RobotConfig:
    """The robot that has a name and a hull of this radius, or else the small one with such a hull."""
    for robot in (TURTLEBOT, LOCOBOT):
        if robot.hull.radius_m == radius_m:
            return robot
    return RobotConfig(radius_m=radius_m, track_m=min(RobotConfig().track_m, 1.6 * radius_m))
