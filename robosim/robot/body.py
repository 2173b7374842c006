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
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.robot.model_file import attach_model, model_of
from robosim.robot.physics import FLOOR, WALL, PhysicsConfig
from robosim.robot.physics_engine import mujoco
from robosim.robot.robots import CAMERA_R, RobotConfig

#: Half the height of a hull with an outline where it meets walls: it is a plate, so that pushes hardly tilt it [m].
_PLATE_M = 0.01
#: Mass of the body that an imported robot is attached to, as a part of the robot's.
_LITTLE = 1e-3
_BLUE, _ORANGE = (0.25, 0.45, 0.7, 1), (0.9, 0.35, 0.1, 1)


def add_robot(spec: mujoco.MjSpec, robot: RobotConfig, physics: PhysicsConfig) -> None:
    """Add the robot to a model, standing at the origin and looking along +x.

    Its joints are `robot` (free), `left` and `right`; the latter are also actuators: wheel speeds [rad/s].
    The sensor `touch` says how many contacts the hull has with walls, and the distance [m] of the deepest.
    """
    imported = None if robot.model is None else model_of(robot.model)
    com = np.array([0.0, 0.0, 0.5 * robot.hull.radius_m]) if imported is None else imported.com_m
    ahead_m, aside_m, com_m = com.tolist()
    body = spec.worldbody.add_body(name="robot")
    body.add_freejoint(name="robot")
    body.explicitinertial = True
    # Those of an imported robot are in the bodies attached.
    body.mass = robot.mass_kg if imported is None else _LITTLE * robot.mass_kg
    body.ipos = (0, 0, com_m)
    body.inertia = (0.4 * body.mass * robot.hull.turning_m**2,) * 3
    # Casters of an imported robot carry half of its weight at most, so that its wheels do not slip.
    casters_m = max(0.75 * robot.hull.inner_m, 2 * abs(ahead_m))
    _add_hull(spec, body, robot, physics, com_m, casters_m, aside_m)
    if robot.model is None or imported is None:
        for name, side in (("left", 1), ("right", -1)):
            _add_wheel(spec, body, name, side, robot, physics)
            _add_servo(spec, name, name, 1.0, robot)
        _add_looks(spec, body, robot)
    else:
        wheels = attach_model(spec, body, robot.model, imported, robot.rotor_inertia_kgm2)
        for name, wheel in zip(("left", "right"), wheels, strict=True):
            joint = spec.joint(wheel.joint)
            _add_tread(joint.parent, name, joint.pos, robot, physics, joint.frame)
            _add_servo(spec, name, wheel.joint, wheel.turns, robot)
    touch = spec.add_sensor(
        name="touch", type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_GEOM, objname="hull"
    )
    data = mujoco.mjtConDataField
    touch.intprm[:3] = (
        1 << int(data.mjCONDATA_FOUND) | 1 << int(data.mjCONDATA_DIST),
        1,
        1,
    )  # least distance


def _add_hull(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    robot: RobotConfig,
    physics: PhysicsConfig,
    com_m: float,
    casters_m: float,
    aside_m: float,
) -> None:
    """Add what walls meet, and the casters."""
    geom, hull = mujoco.mjtGeom, robot.hull
    shape: dict[str, Any] = {
        "type": geom.mjGEOM_SPHERE,
        "pos": (0, 0, com_m),
        "size": (robot.hull.radius_m, 0, 0),
    }
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
    caster_m = 0.15 * robot.hull.radius_m
    # As far from the axle to the front as to the back, in line with the centre of mass: robots lean to no side.
    for name, x in (("front", casters_m), ("back", -casters_m)):
        body.add_geom(
            name=name,
            type=geom.mjGEOM_SPHERE,
            pos=(x, aside_m, caster_m),
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
    _add_tread(wheel, name, (0, 0, 0), robot, physics)
    wheel.add_geom(
        name=f"{name}_tyre",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(r, 0.12 * robot.hull.radius_m, 0),
        quat=(math.sqrt(0.5), math.sqrt(0.5), 0, 0),
        rgba=(0.1, 0.1, 0.1, 1),
        contype=0,
        conaffinity=0,
        mass=0,
    )


def _add_tread(
    wheel: mujoco.MjsBody,
    name: str,
    place: Any,
    robot: RobotConfig,
    physics: PhysicsConfig,
    frame: mujoco.MjsFrame | None = None,
) -> None:
    """Add the sphere with which a wheel touches the floor, at a place of its body, or of a frame in it [m]."""
    sphere = wheel.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=place,
        size=(robot.wheel_radius_m, 0, 0),
        mass=0,
        contype=0,
        conaffinity=FLOOR,
        condim=3,
        friction=(physics.floor_friction, 0, 0),
        priority=1,
        group=3,
        **physics.hard,
    )
    if frame is not None:
        sphere.set_frame(frame)


def _add_servo(spec: mujoco.MjSpec, name: str, joint: str, turns: float, robot: RobotConfig) -> None:
    """Add the velocity servo of a wheel; `turns` is -1 for a joint that turns backwards."""
    servo = spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_velocity(kv=robot.servo_gain)
    servo.gear[0] = turns
    servo.forcelimited, servo.forcerange = True, (-robot.stall_torque_nm, robot.stall_torque_nm)


def _prism(
    spec: mujoco.MjSpec, name: str, corners: Float[np.ndarray, "n 2"], low: float, high: float
) -> dict[str, Any]:
    """Shape of an upright prism between two heights [m]: a box where it is a rectangle along the axes, or a mesh."""
    smallest, largest = corners.min(axis=0), corners.max(axis=0)
    if len(corners) == 4 and np.isin(corners, [smallest, largest]).all():
        (x, y), (length, width) = (smallest + largest) / 2, (largest - smallest) / 2
        box = mujoco.mjtGeom.mjGEOM_BOX
        return {"type": box, "pos": (x, y, (low + high) / 2), "size": (length, width, (high - low) / 2)}
    vertices = np.vstack([np.insert(corners, 2, z, axis=1) for z in (low, high)])
    mesh = spec.add_mesh(name=name, uservert=vertices.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    return {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": name}


def _add_looks(spec: mujoco.MjSpec, body: mujoco.MjsBody, robot: RobotConfig) -> None:
    """What is drawn of the body, and collides with nothing."""
    R, top = robot.hull.radius_m, robot.mast_m
    cylinder, box = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX
    visuals: list[tuple[str, dict[str, Any], tuple[float, ...]]] = [
        ("base", {"type": cylinder, "pos": (0, 0, 0.65 * R), "size": (R, 0.25 * R, 0)}, (0.3, 0.3, 0.33, 1)),
        ("deck", {"type": cylinder, "pos": (0, 0, 1.15 * R), "size": (0.85 * R, 0.15 * R, 0)}, _BLUE),
    ]
    if robot.outline_m:
        corners = robot.hull.corners
        visuals = [
            ("base", _prism(spec, "base", corners, 0.4 * R, 0.9 * R), (0.3, 0.3, 0.33, 1)),
            ("deck", _prism(spec, "deck", 0.85 * corners, R, 1.3 * R), _BLUE),
        ]
    half_m = max(top - R, 0.01) / 2
    visuals += [
        (
            "mast",
            {"type": cylinder, "pos": (0, 0, top - half_m), "size": (0.1 * R, half_m, 0)},
            (0.7, 0.7, 0.7, 1),
        ),
        ("camera", {"type": box, "pos": (0, 0, top), "size": (0.15 * R, 0.4 * R, CAMERA_R * R)}, _ORANGE),
    ]
    for name, shape, rgba in visuals:
        body.add_geom(name=name, rgba=rgba, contype=0, conaffinity=0, mass=0, **shape)
