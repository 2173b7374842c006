"""The robot's body in MuJoCo: a differential drive with a camera on a mast.

Two driven wheels on the axle through the centre, a caster before and one behind it, the centre of mass
low between them. Wheels touch the floor as spheres: one point each, where cylinders scrub on an edge and
turn up to 14 degrees short in a full turn. Each wheel has a velocity servo; the rotor's inertia, as felt
through the gear, is what keeps a stiff servo stable at steps of 5 ms, since MuJoCo solves contacts
without the servo's damping.

Walls see the hull as a sphere of the hull's radius at the height of the centre of mass: against upright
walls its outline is a circle of exactly that radius however the body tilts, a push goes through the
centre of mass, and there is no edge to climb on. (An upright capsule leans out when the
body tilts; a cylinder sank 5 cm into corners of boxes in MuJoCo 4.0.0.) A hull with an outline is a plate at that
height.
What is placed in a building stops the hull's circle wherever anything of it is lower than the robot (`height_m`): the
robot is an upright cylinder to it, though its mast is slimmer.
Left out: suspension, motor electronics, the mast's mass.
"""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import shapely
import tyro
from jaxtyping import Float

from robosim.robot.motion import SpeedProfile
from robosim.robot.physics import FLOOR, WALL, PhysicsConfig
from robosim.support.checks import RADIUS_M, Range, checked
from robosim.support.files import write_json
from robosim.support.from_dict import from_dict
from robosim.support.text_in import parse_json, parse_yaml
from robosim_support.reading import reading
from slam.hull import Hull, Outline
from slam.mapping.odometry import OdometryConfig

#: Time constant of a wheel that takes up its speed [s]. A stiffer servo overshoots at steps of 5 ms.
SERVO_LAG_S = 0.015
#: Half the height of the camera's housing on the mast, and upper edge of the deck, in radii of the hull.
_CAMERA_R, _DECK_R = 0.15, 1.3
#: Half the height of a hull with an outline where it meets walls: it is a plate, so that pushes hardly tilt it [m].
_PLATE_M = 0.01
_BLUE, _ORANGE = (0.25, 0.45, 0.7, 1), (0.9, 0.35, 0.1, 1)
#: Push of the wheels at which the motors stall, as a part of the robot's weight.
STALL_GRIP = 0.5


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
        return max(self.mast_m + _CAMERA_R * self.radius_m, _DECK_R * self.radius_m)

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
    if not (np.isfinite(corners).all() and outline.contains_properly(shapely.Point(0, 0))):
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


def read_robot(path: Path) -> RobotConfig:
    """A robot from a YAML or JSON file of fields such as `radius_m: 0.25`; FileError if it is damaged."""
    with reading(path, "a robot", "Give fields of RobotConfig, such as radius_m: 0.25") as file:
        parse = parse_json if path.suffix == ".json" else parse_yaml
        return from_dict(RobotConfig, parse(file.read()))


def write_robot(path: Path, robot: RobotConfig) -> None:
    """Write a robot as JSON for `read_robot`."""
    write_json(path, asdict(robot))


def robot_of_radius(radius_m: float) -> RobotConfig:
    """The robot that has a name and a hull of this radius, or else the small one with such a hull."""
    for robot in (TURTLEBOT, LOCOBOT):
        if robot.radius_m == radius_m:
            return robot
    return RobotConfig(radius_m=radius_m, track_m=min(RobotConfig().track_m, 1.6 * radius_m))


def add_robot(spec: mujoco.MjSpec, robot: RobotConfig, physics: PhysicsConfig) -> None:
    """Add the robot to a model, standing at the origin and looking along +x.

    Its joints are `robot` (free), `left` and `right`; the latter are also actuators: wheel speeds [rad/s].
    The sensor `touch` says how many contacts the hull has with walls, and the distance [m] of the deepest.
    """
    geom, com_m, hull = mujoco.mjtGeom, 0.5 * robot.radius_m, robot.hull
    body = spec.worldbody.add_body(name="robot")
    body.add_freejoint(name="robot")
    body.explicitinertial = True
    body.mass, body.ipos = robot.mass_kg, (0, 0, com_m)
    body.inertia = (0.4 * robot.mass_kg * hull.turning_m**2,) * 3
    shape: dict[str, Any] = {"type": geom.mjGEOM_SPHERE, "pos": (0, 0, com_m), "size": (robot.radius_m, 0, 0)}
    if robot.outline_m:
        shape = _prism(spec, "hull", hull.corners, com_m - _PLATE_M, com_m + _PLATE_M)
    body.add_geom(
        name="hull",
        contype=0,
        conaffinity=WALL,
        condim=3 if physics.wall_friction > 0 else 1,
        friction=(physics.wall_friction, 0, 0),
        priority=1,
        group=3,
        **shape,
        **physics.hard,
    )
    caster_m = 0.15 * robot.radius_m
    for name, x in (("front", hull.ahead_m), ("back", -hull.behind_m)):
        body.add_geom(
            name=name,
            type=geom.mjGEOM_SPHERE,
            pos=(0.75 * x, 0, caster_m),
            size=(caster_m, 0, 0),
            rgba=(0.8, 0.8, 0.8, 1),
            contype=0,
            conaffinity=FLOOR,
            condim=1,
            priority=1,
            # Softer than the wheels, which are to carry most of the weight.
            solref=(2 * physics.timestep_s, 1.0),
            solimp=(0.9, 0.95, 0.001, 0.5, 2.0),
        )
    for name, side in (("left", 1), ("right", -1)):
        _add_wheel(spec, body, name, side, robot, physics)
    _add_looks(spec, body, robot)
    touch = spec.add_sensor(
        name="touch", type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_GEOM, objname="hull"
    )
    data = mujoco.mjtConDataField
    touch.intprm[:3] = (
        1 << int(data.mjCONDATA_FOUND) | 1 << int(data.mjCONDATA_DIST),
        1,
        1,
    )  # least distance


def _add_wheel(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    name: str,
    side: int,
    robot: RobotConfig,
    physics: PhysicsConfig,
) -> None:
    r = robot.wheel_radius_m
    wheel = body.add_body(name=name, pos=(0, side * robot.track_m / 2, r))
    wheel.explicitinertial = True
    wheel.ipos = (0, 0, 0)  # else MuJoCo takes the position of the body, and the wheel is unbalanced
    wheel.mass = 0.025 * robot.mass_kg
    wheel.inertia = (0.5 * wheel.mass * r**2,) * 3
    wheel.add_joint(
        name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0), armature=robot.rotor_inertia_kgm2
    )
    wheel.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=(r, 0, 0),
        contype=0,
        conaffinity=FLOOR,
        condim=3,
        friction=(physics.floor_friction, 0, 0),
        priority=1,
        group=3,
        **physics.hard,
    )
    wheel.add_geom(
        name=f"{name}_tyre",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(r, 0.12 * robot.radius_m, 0),
        quat=(math.sqrt(0.5), math.sqrt(0.5), 0, 0),
        rgba=(0.1, 0.1, 0.1, 1),
        contype=0,
        conaffinity=0,
        mass=0,
    )
    servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_velocity(kv=robot.servo_gain)
    servo.forcelimited, servo.forcerange = True, (-robot.stall_torque_nm, robot.stall_torque_nm)


def _prism(
    spec: mujoco.MjSpec, name: str, corners: Float[np.ndarray, "n 2"], low: float, high: float
) -> dict[str, Any]:
    """Shape of an upright prism between two heights [m]: a box where it is a rectangle along the axes, or a mesh."""
    least, most = corners.min(axis=0), corners.max(axis=0)
    if len(corners) == 4 and np.isin(corners, [least, most]).all():
        (x, y), (length, width) = (least + most) / 2, (most - least) / 2
        box = mujoco.mjtGeom.mjGEOM_BOX
        return {"type": box, "pos": (x, y, (low + high) / 2), "size": (length, width, (high - low) / 2)}
    vertices = np.vstack([np.insert(corners, 2, z, axis=1) for z in (low, high)])
    mesh = spec.add_mesh(name=name, uservert=vertices.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    return {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": name}


def _add_looks(spec: mujoco.MjSpec, body: mujoco.MjsBody, robot: RobotConfig) -> None:
    """What is drawn of the body, and collides with nothing."""
    R, top = robot.radius_m, robot.mast_m
    cylinder, box = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX
    looks: list[tuple[str, dict[str, Any], tuple[float, ...]]] = [
        ("base", {"type": cylinder, "pos": (0, 0, 0.65 * R), "size": (R, 0.25 * R, 0)}, (0.3, 0.3, 0.33, 1)),
        ("deck", {"type": cylinder, "pos": (0, 0, 1.15 * R), "size": (0.85 * R, 0.15 * R, 0)}, _BLUE),
    ]
    if robot.outline_m:
        corners = robot.hull.corners
        looks = [
            ("base", _prism(spec, "base", corners, 0.4 * R, 0.9 * R), (0.3, 0.3, 0.33, 1)),
            ("deck", _prism(spec, "deck", 0.85 * corners, R, 1.3 * R), _BLUE),
        ]
    half_m = max(top - R, 0.01) / 2
    looks += [
        (
            "mast",
            {"type": cylinder, "pos": (0, 0, top - half_m), "size": (0.1 * R, half_m, 0)},
            (0.7, 0.7, 0.7, 1),
        ),
        ("camera", {"type": box, "pos": (0, 0, top), "size": (0.15 * R, 0.4 * R, _CAMERA_R * R)}, _ORANGE),
    ]
    for name, shape, rgba in looks:
        body.add_geom(name=name, rgba=rgba, contype=0, conaffinity=0, mass=0, **shape)
