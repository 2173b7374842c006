"""Robots from descriptions in URDF and MJCF.

MuJoCo reads both. x points ahead and z upwards. The wheels are the hinges around y whose bodies reach down to the
floor, one on each side; where there are more of the same size, such as of a skid-steered base, the robot turns on an
axle in their middle. The hull is the convex outline of all that collides, from above: a disk, if it is one to 2 %.
Sensors are where a link, body, site or camera has such a name. What a description does not state is listed in a
warning: speeds, and what kind of sensors there are.

A robot with one wheel on each side is simulated with its own masses, inertias and wheels (`attach_model`). Contacts are
those of `robosim.robot.body`: wheels are spheres, a sphere before and one behind stands for all casters, and walls meet
the outline. Inertias that violate A + B >= C are balanced. Left out: other joints, which are fixed; steered, mecanum
and omnidirectional wheels; xacro, which must be expanded.
"""

import logging
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from robosim.camera.model import CameraConfig
from robosim.lidar import LidarConfig
from robosim.robot.physics_engine import mujoco
from robosim.robot.robots import RobotConfig
from robosim.support.reading import reading
from slam.hull import Hull, Outline
from slam.robot import convex_outline

logger = logging.getLogger(__name__)

#: Words in names of cameras and lidars.
_CAMERA, _LIDAR = re.compile(r"camera|realsense|kinect|oakd"), re.compile(r"lidar|laser|scan|hokuyo|velodyne")
#: How far wheels may be from the floor, and from each other in size and place [m].
_LEVEL_M = 0.01
#: An outline is simplified by this [m], and is a disk if it is one to this share.
_SIMPLER_M, _ROUND = 0.002, 0.02
#: Farthest place of a part [m].
_MOST_M = 100.0
#: Corners of circles.
_CORNERS = 64
#: What is taken where a description does not state it: a lidar, and the field of view of a camera [deg].
_SOME_LIDAR, _SOME_HFOV_DEG = "rplidar-a1", 90.0


class Wheel(NamedTuple):
    """A driven wheel."""

    joint: str
    place: Float[np.ndarray, "3"]
    """Its centre in the frame of the description [m]."""
    radius_m: float
    turns: float
    """1 if positive turns of the joint roll it ahead, else -1."""


class Model(NamedTuple):
    """What a description states."""

    wheels: tuple[list[Wheel], list[Wheel]]
    """On the left and on the right."""
    axle: Float[np.ndarray, "3"]
    """Middle of the axle on the floor, in the frame of the description [m]."""
    outline_m: Outline
    """Around the middle of the axle."""
    height_m: float
    mass_kg: float
    """Of all but the driven wheels."""
    com_m: float
    """Height of the centre of mass."""
    camera: Float[np.ndarray, "3"] | None
    lidar: Float[np.ndarray, "3"] | None
    hfov_deg: float | None
    """Places of sensors from the middle of the axle on the floor [m], and field of view."""


def read_model(path: Path) -> RobotConfig:
    """A robot from a URDF or MJCF file.

    Raises:
        FileError: If MuJoCo cannot read it, or it is no differential drive.
    """
    model = model_of(path)
    left, right = (np.mean([wheel.place[1] for wheel in side]) for side in model.wheels)
    wheel_radius_m = model.wheels[0][0].radius_m
    hull = Hull(max(abs(y) for _, y in model.outline_m), model.outline_m)
    is_round = hull.inner_m > (1 - _ROUND) * hull.turning_m
    missing = [f"speeds ({RobotConfig.max_speed_mps:g} m/s, --robot.max-speed-mps)"]
    sensors: dict[str, Any] = {}
    if model.camera is not None or model.lidar is not None:
        if model.camera is not None and model.hfov_deg is None:
            missing.append(f"the camera's field of view ({_SOME_HFOV_DEG:g} degrees, --image.hfov-deg)")
        if model.lidar is not None:
            missing.append(f"the kind of lidar ({_SOME_LIDAR}, --lidar)")
        heights_m = [_mount(place)["height_m"] for place in (model.camera, model.lidar) if place is not None]
        sensors = {"camera": None, "mast_m": max(model.height_m, *heights_m, 0.01)}
        if model.camera is not None:
            camera = CameraConfig(hfov_deg=model.hfov_deg or _SOME_HFOV_DEG)
            sensors["camera"] = replace(camera, **_mount(model.camera))
        if model.lidar is not None:
            sensors |= {"lidar": _SOME_LIDAR, "laser": LidarConfig(**_mount(model.lidar))}
    else:
        missing.append(f"sensors (a camera at {RobotConfig.mast_m:g} m, --image.height-m)")
    logger.warning("%s does not state %s. Give what differs.", path, " and ".join(missing))
    return RobotConfig(
        radius_m=hull.turning_m if is_round else None,
        outline_m=() if is_round else model.outline_m,
        mass_kg=model.mass_kg,
        wheel_radius_m=wheel_radius_m,
        track_m=float(left - right),
        # Of what rolls, as of the other robots.
        rotor_inertia_kgm2=0.2 * model.mass_kg * wheel_radius_m**2,
        **sensors,
        model=path.absolute() if len(model.wheels[0]) == 1 else None,
    )


def attach_model(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, path: Path, model: Model, armature_kgm2: float
) -> list[Wheel]:
    """Attach the bodies of a description to a body above the middle of the axle; returns the wheels, left and right.

    `model` is what `model_of` found in it. Names get the prefix "model/". Nothing of it collides.
    """
    child = _load(path)
    _mend_inertias(spec)
    roots = [one for one in child.bodies if one.parent is not None and one.parent.name == "world"]
    wheels = [side[0] for side in model.wheels]
    for geom in child.geoms:
        geom.contype = geom.conaffinity = 0
    names = {wheel.joint for wheel in wheels}
    for several in (
        child.actuators,
        child.sensors,
        child.keys,
        child.equalities,
        child.tendons,
        child.excludes,
    ):
        for one in list(several):
            child.delete(one)
    for joint in list(child.joints):
        if joint.name not in names:
            child.delete(joint)
    for root in roots:
        body.add_frame(pos=-model.axle).attach_body(root, "model/", "")
    for wheel in wheels:
        joint = spec.joint(f"model/{wheel.joint}")
        joint.armature, joint.limited = armature_kgm2, mujoco.mjtLimited.mjLIMITED_FALSE
        joint.damping[:] = joint.frictionloss = 0.0  # the servo overcomes them
    return [wheel._replace(joint=f"model/{wheel.joint}") for wheel in wheels]


def model_of(path: Path) -> Model:
    """What a URDF or MJCF file states of a robot; FileError if it is no differential drive."""
    remedy = "Give a URDF or MJCF file of a differential drive, xacro expanded, meshes where it says they are"
    with reading(path, "a robot", remedy) as file:
        text = re.sub(r"<!--.*?-->", "", file.read().decode("utf-8", "replace"), flags=re.DOTALL)
        if found := re.search(r"\$\{[^}]*\}|<xacro:\w+", text):
            raise ValueError(f"{found[0]} is xacro, expected URDF: expand it with the program xacro first")
        with _no_warnings():
            spec = _load(path)
            for one in (*spec.bodies, *spec.geoms, *spec.sites, *spec.joints):
                if not np.abs(one.pos).max() < _MOST_M:
                    raise ValueError(
                        f"{one.name or 'a part'} is at {one.pos} m, expected places up to {_MOST_M:g} m"
                    )
            compiled = spec.compile()
            data = mujoco.MjData(compiled)
            mujoco.mj_fwdPosition(compiled, data)
        return _facts(compiled, data)


@contextmanager
def _no_warnings() -> Iterator[None]:
    """MuJoCo prints its warnings, and goes on: here they are errors."""
    said: list[str] = []
    mujoco.set_mju_user_warning(said.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)
    if said:
        raise ValueError(said[0])


def _load(path: Path) -> mujoco.MjSpec:
    text = path.read_text("utf-8", "replace")
    if re.search(r"<robot\b", text):
        found = re.sub(r'filename="([^"]*)"', lambda match: f'filename="{_mesh_file(match[1], path)}"', text)
        spec = mujoco.MjSpec.from_string(found)
    else:
        spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False  # links without joints keep their names
    _mend_inertias(spec)
    return spec


def _mesh_file(name: str, path: Path) -> str:
    """A mesh of a URDF file: package://NAME/REST is in a folder NAME around it, or REST in a folder around it."""
    rest = name.removeprefix("file://")
    package, _, inner = rest.removeprefix("package://").partition("/")
    places = [path.parent / rest]
    if rest.startswith("package://"):
        around = path.absolute().parents
        places = [*(one / package / inner for one in around), *(one / inner for one in around)]
    return str(next((place.absolute() for place in places if place.is_file()), name))


def _mend_inertias(spec: mujoco.MjSpec) -> None:
    """Let inertias that no body has, of which many descriptions have some, become the mean of the three."""
    spec.compiler.balanceinertia = True


def _facts(model: mujoco.MjModel, data: mujoco.MjData) -> Model:
    """What a compiled description states."""
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    solid = [
        k
        for k in range(model.ngeom)
        if (model.geom_contype[k] or model.geom_conaffinity[k]) and model.geom_type[k] != plane
    ]
    if not solid:
        raise ValueError("nothing of it collides, expected collision geometry of wheels and hull")
    points = {k: _surface(model, data, k) for k in solid}
    wheels = _driven(_hinges_on_floor(model, data, points))
    every = np.vstack(list(points.values()))
    driven = {model.joint(wheel.joint).bodyid[0] for side in wheels for wheel in side}
    of_others = [k for k in range(1, model.nbody) if k not in driven]
    mass = model.body_mass[of_others]
    if not mass.sum() > 0:
        raise ValueError("its links have no mass, expected inertials")
    places = np.array([[wheel.place for wheel in side] for side in wheels])
    axle = places.mean(axis=(0, 1)) - [0.0, 0.0, wheels[0][0].radius_m]
    outline = shapely.MultiPoint(every[:, :2] - axle[:2]).convex_hull.simplify(_SIMPLER_M)
    camera, hfov_deg = _place_of(_CAMERA, model, data), None
    if model.ncam:
        camera, hfov_deg = data.cam_xpos[0], float(model.cam_fovy[0])
    lidar = _place_of(_LIDAR, model, data)
    return Model(
        wheels=wheels,
        axle=axle,
        outline_m=convex_outline(tuple(outline.exterior.coords[:-1])),
        height_m=float(every[:, 2].max() - axle[2]),
        mass_kg=float(mass.sum()),
        com_m=float(mass @ data.xipos[of_others, 2] / mass.sum() - axle[2]),
        camera=None if camera is None else camera - axle,
        lidar=None if lidar is None else lidar - axle,
        hfov_deg=hfov_deg,
    )


def _hinges_on_floor(
    model: mujoco.MjModel, data: mujoco.MjData, points: dict[int, Float[np.ndarray, "_ 3"]]
) -> list[Wheel]:
    """Hinges around y whose bodies reach down to the floor."""
    floor_m = min(points_of[:, 2].min() for points_of in points.values())
    found = []
    for k in range(model.njnt):
        axis, place = data.xaxis[k], data.xanchor[k]
        own = [points[g] for g in points if model.geom_bodyid[g] == model.jnt_bodyid[k]]
        if model.jnt_type[k] != mujoco.mjtJoint.mjJNT_HINGE or abs(axis[1]) < 0.99 or not own:
            continue
        rim = np.vstack(own) - place
        if place[2] + rim[:, 2].min() < floor_m + _LEVEL_M:
            radius_m = float(np.hypot(rim[:, 0], rim[:, 2]).max())
            found.append(Wheel(model.joint(k).name, place.copy(), radius_m, float(np.sign(axis[1]))))
    return found


def _driven(hinges: list[Wheel]) -> tuple[list[Wheel], list[Wheel]]:
    """Those of the wheels that drive, the largest, on the left and on the right."""
    largest_m = max((wheel.radius_m for wheel in hinges), default=0.0)
    wheels = [wheel for wheel in hinges if wheel.radius_m > largest_m - _LEVEL_M]
    middle = np.mean([wheel.place[1] for wheel in wheels]) if wheels else 0.0
    left, right = (
        sorted(
            (wheel for wheel in wheels if side * (wheel.place[1] - middle) > 0), key=lambda one: one.place[0]
        )
        for side in (1, -1)
    )
    pairs = zip(left, right, strict=False)
    if not left or len(left) != len(right) or any(abs(a.place[0] - b.place[0]) > _LEVEL_M for a, b in pairs):
        names = ", ".join(f"{wheel.joint} at y = {wheel.place[1]:g} m" for wheel in hinges) or "none"
        raise ValueError(
            f"its wheels that turn around y on the floor are {names}, expected as many on the left as on the right, in "
            "pairs: x ahead, y to the left"
        )
    return left, right


def _place_of(
    name: re.Pattern[str], model: mujoco.MjModel, data: mujoco.MjData
) -> Float[np.ndarray, "3"] | None:
    """Place of the first body or site with a name; None if there is none."""
    for k in range(1, model.nbody):
        if name.search(model.body(k).name.lower()):
            return data.xpos[k].copy()
    for k in range(model.nsite):
        if name.search(model.site(k).name.lower()):
            return data.site_xpos[k].copy()
    return None


def _mount(place: Float[np.ndarray, "3"]) -> dict[str, Any]:
    """How far ahead a sensor is, and how high."""
    return {"ahead_m": round(float(place[0]), 6), "height_m": round(float(place[2]), 6)}


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
