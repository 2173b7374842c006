"""Robots that are sold, as their makers describe them.

turtlebot3_*  ROBOTIS e-Manual, TurtleBot3, Specifications: sizes, masses, speeds. Wheels, hull and sensors: the
              collision geometry and joints of turtlebot3_description (turtlebot3_burger.urdf,
              turtlebot3_waffle.urdf), in base_footprint. Camera of the waffle: Intel RealSense R200, data sheet: 59
              degrees of depth.
create3       iRobot Create 3 documentation, Hardware: diameter, and speed with safety features. Wheels:
              irobot_create_description (create3.urdf.xacro, wheel.urdf.xacro). It has no sensors to map with: it
              carries the reference's camera.
turtlebot4    Create 3 with what turtlebot4_description (turtlebot4.urdf.xacro, standard) mounts on it. User manual,
              Features: mass and height. Camera: Luxonis OAK-D Pro, documentation: 72 degrees of its stereo pair.
jackal        Clearpath Jackal UGV, data sheet: size, mass, speed. Wheels: jackal_description (jackal.urdf.xacro);
              limits: jackal_control (control.yaml). A Hokuyo on the front mount (hokuyo_ust10.urdf.xacro). Its four
              wheels skid as it turns; here it turns on an axle in the middle, as its odometry is calibrated to show.

Left out: offsets of cameras to the side (up to 5 cm), the part of a lidar's view that a robot's own posts hide, noise
of these robots' odometry: that of the configuration holds.
"""

from robosim.camera.model import CameraConfig
from robosim.lidar import LidarConfig
from robosim.robot.robots import RobotConfig
from slam.hull import Outline


def _rectangle(behind_m: float, ahead_m: float, half_width_m: float) -> Outline:
    return (
        (-behind_m, -half_width_m),
        (ahead_m, -half_width_m),
        (ahead_m, half_width_m),
        (-behind_m, half_width_m),
    )


TURTLEBOT3_BURGER = RobotConfig(
    outline_m=_rectangle(0.102, 0.038, 0.089),
    mass_kg=0.943,
    wheel_radius_m=0.033,
    track_m=0.16,
    mast_m=0.192,
    max_speed_mps=0.22,
    max_turn_rate_radps=2.84,
    camera=None,
    lidar="lds-01",
    laser=LidarConfig(ahead_m=-0.032, height_m=0.182),
)
TURTLEBOT3_WAFFLE = RobotConfig(
    outline_m=_rectangle(0.197, 0.073, 0.153),
    mass_kg=1.743,
    wheel_radius_m=0.033,
    track_m=0.288,
    mast_m=0.141,
    max_speed_mps=0.26,
    max_turn_rate_radps=1.82,
    camera=CameraConfig(ahead_m=0.069, height_m=0.117, hfov_deg=59.0),
    lidar="lds-01",
    laser=LidarConfig(ahead_m=-0.064, height_m=0.132),
)
CREATE3 = RobotConfig(
    radius_m=0.171,
    mass_kg=2.3,
    wheel_radius_m=0.03575,
    track_m=0.233,
    max_speed_mps=0.306,
    max_turn_rate_radps=1.9,
    rotor_inertia_kgm2=0.002,
)
TURTLEBOT4 = RobotConfig(
    radius_m=0.171,
    mass_kg=3.7,
    wheel_radius_m=0.03575,
    track_m=0.233,
    mast_m=0.351,
    max_speed_mps=0.306,
    max_turn_rate_radps=1.9,
    rotor_inertia_kgm2=0.002,
    camera=CameraConfig(ahead_m=-0.06, height_m=0.244, hfov_deg=72.0),
    lidar="rplidar-a1",
    laser=LidarConfig(ahead_m=-0.04, height_m=0.193),
)
JACKAL = RobotConfig(
    outline_m=_rectangle(0.254, 0.254, 0.215),
    mass_kg=15.1,
    wheel_radius_m=0.098,
    track_m=0.37559,
    mast_m=0.3,
    max_speed_mps=2.0,
    max_turn_rate_radps=4.0,
    rotor_inertia_kgm2=0.02,
    camera=None,
    lidar="ust-10lx",
    laser=LidarConfig(ahead_m=0.12, height_m=0.297),
)
