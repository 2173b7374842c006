"""Robots from descriptions in URDF and MJCF.

MuJoCo reads both (`robosim.robot.description`). x points ahead and z upwards, in the robot's own frame where a file
turns it around z in the world. The wheels are the hinges around y whose bodies are round and reach down to the floor,
one on each side (`robosim.robot.driven_wheels`); where there are more of the same size, such as of a skid-steered base,
the robot turns on an axle in their middle. The hull is the convex outline of all that collides, from above: a disk, if
it is one to 2 %. The mass is the sum of what the file states.
`robosim.robot.described_sensors` lists what counts as a camera or lidar. What a description does not state is listed
in a warning: speeds, and what kind of sensors there are.

A robot with one wheel on each side and its centre of mass between them is simulated with its own masses, inertias and
wheels (`attach_model`). Contacts are those of `robosim.robot.body`: wheels are spheres, a sphere before and one behind
stands for all casters, and walls meet the outline. Inertias that violate A + B >= C are balanced. Other joints are
fixed, whatever their limits: what hangs on them counts by mass and outline. Left out: steered, mecanum and
omnidirectional wheels, which are errors; xacro, which must be expanded; bodies of MJCF that do not hang on the robot.
"""

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from robosim.camera.model import CameraConfig
from robosim.lidar import LidarConfig
from robosim.robot.described_sensors import Extent, Sensor, find_camera, find_lidar
from robosim.robot.description import (
    COLLIDING,
    NO_MASS_KG,
    Description,
    balance_inertias,
    load_description,
    warnings_as,
)
from robosim.robot.driven_wheels import Sides, Wheel, face_ahead, find_wheels
from robosim.robot.physics_engine import mujoco
from robosim.robot.robots import RobotConfig
from robosim.support.reading import FileError, naming, reading
from slam.hull import Hull, Outline
from slam.robot import convex_outline

logger = logging.getLogger(__name__)

#: An outline is simplified by this [m], and is a disk if it is one to this share.
_SIMPLER_M, _ROUND = 0.002, 0.02
#: Most offset of a sensor to the side that is left out without a note [m].
_SIDE_M = 0.05
#: Farthest place of a part [m], and greatest mass of one [kg].
_MOST_M, _MOST_KG = 100.0, 10_000.0
_REMEDY = "Give URDF or MJCF of a differential drive, xacro expanded, meshes (binary STL, OBJ) where it says they are"
#: Corners of circles.
_CORNERS = 64
#: What is taken where a description does not state it: a lidar, and the field of view of a camera [deg].
_SOME_LIDAR, _SOME_HFOV_DEG = "rplidar-a1", 90.0


class Model(NamedTuple):
    """What a description states."""

    wheels: Sides
    """On the left and on the right."""
    axle: Float[np.ndarray, "3"]
    """Middle of the axle on the floor, in the frame of the description [m]."""
    outline_m: Outline
    """Around the middle of the axle."""
    height_m: float
    masses_kg: dict[str, float]
    """Masses by link, of links that have one [kg]."""
    mass_kg: float
    """Of all but the driven wheels."""
    com_m: Float[np.ndarray, "3"]
    """Centre of that mass, from the middle of the axle on the floor [m]."""
    fixed_joints: tuple[str, ...]
    """Joints that could move."""
    camera: Sensor | None
    lidar: Sensor | None
    """Sensors, with places from the middle of the axle on the floor [m]."""
    notes: tuple[str, ...]
    """Assumptions, each with its option."""
    root: str
    """The body that the others hang on."""
    root_place: Float[np.ndarray, "3"]
    root_quat_wxyz: Float[np.ndarray, "4"]
    """Where it is in the frame of the description [m], and how it is turned."""

    def report(self) -> dict[str, Any]:
        """Report what is read and assumed, as plain values."""
        sides = zip(("left", "right"), self.wheels, strict=True)
        sensors = {"camera": self.camera, "lidar": self.lidar}
        return {
            "wheels": [{"side": side, **wheel._asdict()} for side, wheels in sides for wheel in wheels],
            "masses_kg": self.masses_kg,
            "total_mass_kg": sum(self.masses_kg.values()),
            "fixed_joints": self.fixed_joints,
            "sensors": {
                kind: each and {"name": each.name, "place_m": each.place, "hfov_deg": each.hfov_deg}
                for kind, each in sensors.items()
            },
            "assumed": [*self.notes, *unstated(self)],
        }


def read_model(path: Path) -> RobotConfig:
    """A robot from a URDF or MJCF file; FileError if MuJoCo cannot read it, or it is no differential drive."""
    return robot_of(path, model_of(path))


def robot_of(path: Path, model: Model) -> RobotConfig:
    """A robot from what its file states; a warning lists what was assumed. FileError if a value is impossible."""
    left, right = (np.mean([wheel.place[1] for wheel in side]) for side in model.wheels)
    wheel_radius_m = model.wheels[0][0].radius_m
    hull = Hull(max(abs(y) for _, y in model.outline_m), model.outline_m)
    is_round = hull.inner_m > (1 - _ROUND) * hull.turning_m
    sensors: dict[str, Any] = {}
    with naming(path, "a robot", _REMEDY):
        if mounts := [_mount(each) for each in (model.camera, model.lidar) if each is not None]:
            heights_m = [mount["height_m"] for mount in mounts]
            sensors = {"camera": None, "mast_m": max(model.height_m, *heights_m, 0.01)}
            if model.camera is not None:
                hfov_deg = model.camera.hfov_deg
                camera = CameraConfig(hfov_deg=_SOME_HFOV_DEG if hfov_deg is None else hfov_deg)
                sensors["camera"] = replace(camera, **_mount(model.camera))
            if model.lidar is not None:
                sensors |= {"lidar": _SOME_LIDAR, "laser": LidarConfig(**_mount(model.lidar))}
        robot = RobotConfig(
            radius_m=hull.turning_m if is_round else None,
            outline_m=() if is_round else model.outline_m,
            mass_kg=model.mass_kg,
            wheel_radius_m=wheel_radius_m,
            track_m=float(left - right),
            # Of what rolls, as of the other robots.
            rotor_inertia_kgm2=0.2 * model.mass_kg * wheel_radius_m**2,
            **sensors,
            model=path.absolute()
            if len(model.wheels[0]) == 1 and abs(model.com_m[1]) < (left - right) / 2
            else None,
        )
    logger.warning(f"{path} does not state {' and '.join(unstated(model))}. Give what differs.")
    for note in model.notes:
        logger.warning(f"{path}: {note}")
    return robot


def unstated(model: Model) -> list[str]:
    """List the values that a description does not state, each with the default and its option."""
    missing = [f"speeds ({RobotConfig.max_speed_mps:g} m/s, --robot.max-speed-mps)"]
    if model.camera is None and model.lidar is None:
        missing.append(f"sensors (a camera at {RobotConfig.mast_m:g} m, --image.height-m)")
    if model.camera is not None and model.camera.hfov_deg is None:
        missing.append(f"the camera's field of view ({_SOME_HFOV_DEG:g} degrees, --image.hfov-deg)")
    if model.lidar is not None:
        missing.append(f"the kind of lidar ({_SOME_LIDAR}, --lidar)")
    return missing


def attach_model(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, path: Path, model: Model, armature_kgm2: float
) -> list[Wheel]:
    """Attach the bodies of a description to a body above the middle of the axle; returns the wheels, left and right.

    `model` is what `model_of` found in it. Names get the prefix "model/". Nothing of it collides.
    """
    child = load_description(path).spec
    balance_inertias(spec)
    root = next(each for each in child.bodies if each.name == model.root)
    wheels = [side[0] for side in model.wheels]
    names = {wheel.joint for wheel in wheels}
    for several in (
        child.actuators,
        child.sensors,
        child.keys,
        child.equalities,
        child.tendons,
        child.excludes,
    ):
        for element in list(several):
            child.delete(element)
    for joint in list(child.joints):
        if joint.name not in names:
            child.delete(joint)
    # Not by its own place and angles: MuJoCo forgets the frames that it is in.
    root.pos, root.quat = model.root_place - model.axle, model.root_quat_wxyz
    root.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    body.add_frame().attach_body(root, "model/", "")
    for wheel in wheels:
        joint = spec.joint(f"model/{wheel.joint}")
        joint.armature, joint.limited = armature_kgm2, mujoco.mjtLimited.mjLIMITED_FALSE
        joint.damping[:] = joint.frictionloss = 0.0  # the servo overcomes them
        joint.pos += wheel.tyre_m * joint.axis / np.linalg.norm(joint.axis)  # the wheel turns there as well
    return [wheel._replace(joint=f"model/{wheel.joint}") for wheel in wheels]


def model_of(path: Path) -> Model:
    """What a URDF or MJCF file states of a robot; FileError if it is no differential drive."""
    with reading(path, "a robot", _REMEDY):
        try:
            description = load_description(path)
        except FileError as error:
            error.file = None  # of a file that it names: the message names both
            raise
        spec = description.spec
        for each in (*spec.bodies, *spec.geoms, *spec.sites, *spec.joints):
            if not np.abs(each.pos).max() < _MOST_M:
                raise ValueError(
                    f"{each.name or 'a part'} is at {each.pos} m, expected places up to {_MOST_M:g} m"
                )
        with warnings_as(description.notes):
            compiled = spec.compile()
            data = mujoco.MjData(compiled)
            mujoco.mj_fwdPosition(compiled, data)
            description.notes.extend(face_ahead(compiled, data))
        return _facts(compiled, data, description)


def _facts(model: mujoco.MjModel, data: mujoco.MjData, description: Description) -> Model:
    """What a compiled description states."""
    mass = np.where(model.body_mass > 10 * NO_MASS_KG, model.body_mass, 0.0)
    for k in np.flatnonzero(~(model.body_mass <= _MOST_KG)):
        raise ValueError(
            f"the mass of {model.body(k).name} is {model.body_mass[k]:g} kg, expected up to {_MOST_KG:g} kg"
        )
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    solid = np.flatnonzero((model.geom_group == COLLIDING) & (model.geom_type != plane))
    if not len(solid):
        raise ValueError("nothing of it collides, expected collision geometry of wheels and hull")
    points = {int(k): _surface(model, data, int(k)) for k in solid}
    wheels = find_wheels(model, data, points)
    links = {int(model.joint(wheel.joint).bodyid[0]) for side in wheels for wheel in side}
    if len(roots := {int(model.body_rootid[k]) for k in links}) > 1:
        names = ", ".join(model.body(k).name for k in sorted(roots))
        raise ValueError(f"its wheels hang on {names}, which no joint connects, expected one robot")
    (root,) = roots
    bodies = {k for k in range(1, model.nbody) if model.body_rootid[k] == root}
    notes = list(description.notes)
    if strange := sorted({int(k) for k in model.body_rootid[1:]} - {root}):
        names = ", ".join(model.body(k).name for k in strange)
        notes.append(f"{names} do not hang on {model.body(root).name}: they are no part of the robot")
    every = np.vstack([each for k, each in points.items() if model.geom_bodyid[k] in bodies])
    turning = {k for k in bodies if model.body_weldid[k] in links}
    others = sorted(bodies - turning)
    masses_kg = {model.body(k).name: float(mass[k]) for k in sorted(bodies) if mass[k]}
    if not mass[others].sum() > 1e-6:
        raise ValueError("its links have no mass, expected inertials")
    if massless := [model.body(k).name for k in sorted(links) if not mass[k]]:
        notes.append(f"wheels {', '.join(massless)} state no mass: they have that of their motors alone")
    places = np.array([[wheel.place for wheel in side] for side in wheels])
    axle = places.mean(axis=(0, 1)) - [0.0, 0.0, wheels[0][0].radius_m]
    outline = shapely.MultiPoint(every[:, :2] - axle[:2]).convex_hull.simplify(_SIMPLER_M)
    size_m = float(np.linalg.norm(np.ptp(every, axis=0)))
    for k in np.flatnonzero(mass):
        gyration_m = math.sqrt(model.body_inertia[k].max() / mass[k])
        if max(gyration_m, float(np.linalg.norm(data.xipos[k] - every.mean(axis=0)))) > size_m:
            about = f"radius of gyration {gyration_m:.3g} m, centre at {data.xipos[k].round(3)} m"
            notes.append(f"inertia of {model.body(k).name} is that of mass outside of the robot: {about}")
    extent = Extent(bodies, every[:, :2].min(axis=0), every[:, :2].max(axis=0))
    camera, lidar = (
        find(model, data, extent, description.sensors, notes) for find in (find_camera, find_lidar)
    )
    for each in (camera, lidar):
        if each is not None and abs(aside_m := each.place[1] - axle[1]) > _SIDE_M:
            side = f"{abs(aside_m):.3g} m to the {'left' if aside_m > 0 else 'right'}"
            notes.append(f"{each.name} is {side} of the axle's middle: it is simulated in the middle")
    if turning.issuperset(model.geom_bodyid[k] for k in points if model.geom_bodyid[k] in bodies):
        notes.append("nothing but the wheels collides: the hull is their outline")
    com_m = mass[others] @ data.xipos[others] / mass[others].sum() - axle
    if abs(com_m[1]) >= (places[0, :, 1].mean() - places[1, :, 1].mean()) / 2:
        side = f"{abs(com_m[1]):.3g} m to the {'left' if com_m[1] > 0 else 'right'}"
        notes.append(
            f"its centre of mass is {side} of the axle's middle, beyond its wheels, where it would tip over: it is "
            "simulated in the middle"
        )
    rolling, free = {wheel.joint for side in wheels for wheel in side}, mujoco.mjtJoint.mjJNT_FREE
    return Model(
        wheels=wheels,
        axle=axle,
        outline_m=convex_outline(tuple(outline.exterior.coords[:-1])),
        height_m=float(every[:, 2].max() - axle[2]),
        masses_kg=masses_kg,
        mass_kg=float(mass[others].sum()),
        com_m=com_m,
        fixed_joints=tuple(
            model.joint(k).name
            for k in range(model.njnt)
            if model.jnt_bodyid[k] in bodies
            and model.jnt_type[k] != free
            and model.joint(k).name not in rolling
        ),
        camera=None if camera is None else camera._replace(place=camera.place - axle),
        lidar=None if lidar is None else lidar._replace(place=lidar.place - axle),
        notes=tuple(notes),
        root=model.body(root).name,
        root_place=data.xpos[root].copy(),
        root_quat_wxyz=data.xquat[root].copy(),
    )


def _mount(sensor: Sensor) -> dict[str, Any]:
    """How far ahead a sensor is, and how high."""
    return {"ahead_m": round(float(sensor.place[0]), 6), "height_m": round(float(sensor.place[2]), 6)}


def _surface(model: mujoco.MjModel, data: mujoco.MjData, k: int) -> Float[np.ndarray, "n 3"]:
    """Points around a geom, whose convex hull it fills."""
    kind, size = model.geom_type[k], model.geom_size[k]
    geom = mujoco.mjtGeom
    angle = np.arange(_CORNERS) * 2 * math.pi / _CORNERS
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_CORNERS)])
    sphere = np.vstack([ring, ring[:, [2, 0, 1]], ring[:, [0, 2, 1]]])
    if kind == geom.mjGEOM_MESH:
        first = model.mesh_vertadr[model.geom_dataid[k]]
        local = model.mesh_vert[first : first + model.mesh_vertnum[model.geom_dataid[k]]]
    elif kind == geom.mjGEOM_BOX:
        local = size * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    elif kind == geom.mjGEOM_CYLINDER:
        local = np.vstack([size[0] * ring + [0, 0, z] for z in (-size[1], size[1])])
    elif kind == geom.mjGEOM_CAPSULE:
        local = np.vstack([size[0] * sphere + [0, 0, z] for z in (-size[1], size[1])])
    else:
        local = (size[0] if kind == geom.mjGEOM_SPHERE else size) * sphere
    return local @ data.geom_xmat[k].reshape(3, 3).T + data.geom_xpos[k]
