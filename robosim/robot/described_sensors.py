"""Cameras and lidars of a description: what it declares as such counts more than names.

In this order: sensors of Gazebo, cameras of MJCF that are fixed on the robot, frames called after an optical frame, and
links, bodies or sites called after a camera or lidar. Names of what holds a sensor (mount, bracket, screw) are none.
Candidates less than `_SAME_M` apart are one sensor. Of several, one that looks ahead is taken, the first in the file,
and a note names the others.
"""

import math
import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robosim.robot.description import SensorTag
from robosim.robot.physics_engine import mujoco

_CAMERA = re.compile(
    r"camera|realsense|kinect|oakd|oak_d|rgbd|optical_frame|(^|[/_-])(zed|astra|d4[0-9]5i?)([/_-]|$)"
)
_LIDAR = re.compile(r"lidar|laser|scan|hokuyo|velodyne|(^|[/_-])(urg|sick|ouster)([/_-]|$)")
#: Parts of names of what holds a sensor, and of what does so if it follows the sensor's name.
_HOLDER = re.compile(
    r"(^|[/_-])(stand_?off|(un)?mount(ing|ed)?|screw|bracket|holder|plate|post|pole|mast|stand|support|adapter|cable|"
    r"cover|guard|arm|tower|bolt|nut|tilt|pan|gimbal)s?\d*([/_-]|$)"
)
_BASE = re.compile(r"[/_-](base|bottom|top|body|housing|case)([/_-]|$)")
#: Candidates that are one sensor, and how far one may be outside of the outline [m].
_SAME_M, _OUTSIDE_M = 0.1, 0.5
#: Least cosine of the angle from straight ahead at which a camera looks ahead.
_AHEAD = 0.9
#: Least such cosine of a camera that is simulated without a note.
_LEVEL = 0.99


class Sensor(NamedTuple):
    """A sensor on the robot."""

    name: str
    place: Float[np.ndarray, "3"]
    """In the frame of the description [m]."""
    view: Float[np.ndarray, "3"]
    """Direction in which it looks."""
    rank: float
    """How certain it is that it is one; less is more certain."""
    hfov_deg: float | None = None


class Extent(NamedTuple):
    """Extent of the robot: its bodies, and the rectangle around them."""

    bodies: set[int]
    low: Float[np.ndarray, "2"]
    high: Float[np.ndarray, "2"]
    """Corners of the rectangle [m]."""


def find_camera(
    model: mujoco.MjModel, data: mujoco.MjData, robot: Extent, tags: list[SensorTag], notes: list[str]
) -> Sensor | None:
    """The robot's camera; None if there is none. Notes of what was assumed are appended."""
    candidates = [each for each in _tagged(model, data, tags) if each.rank < 1]
    for k in range(model.ncam):
        is_fixed = model.cam_mode[k] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED
        is_perspective = model.cam_projection[k] == mujoco.mjtProjection.mjPROJ_PERSPECTIVE
        if model.cam_bodyid[k] in robot.bodies and is_fixed and is_perspective:
            view = -data.cam_xmat[k].reshape(3, 3)[:, 2]
            name = model.camera(k).name or f"camera {k}"
            candidates.append(Sensor(name, data.cam_xpos[k].copy(), view, 1, _hfov_deg(model, k)))
    candidates += _named(_CAMERA, model, data, robot.bodies, notes)
    camera = _choose("camera", candidates, robot, notes)
    if camera is not None and not camera.view[0] > _LEVEL:
        notes.append(f"camera {camera.name} does not look straight ahead: it is simulated as if it did")
    return camera


def find_lidar(
    model: mujoco.MjModel, data: mujoco.MjData, robot: Extent, tags: list[SensorTag], notes: list[str]
) -> Sensor | None:
    """The robot's lidar; None if there is none. Notes of what was assumed are appended."""
    candidates = [each for each in _tagged(model, data, tags) if each.rank >= 1]
    return _choose("lidar", candidates + _named(_LIDAR, model, data, robot.bodies, notes), robot, notes)


def _choose(kind: str, candidates: list[Sensor], robot: Extent, notes: list[str]) -> Sensor | None:
    """The sensor of the most certain kind; notes name the others."""
    near = []
    for each in candidates:
        place = each.place[:2]
        if (place > robot.low - _OUTSIDE_M).all() and (place < robot.high + _OUTSIDE_M).all():
            near.append(each)
        else:
            notes.append(f"{each.name} is far outside of the hull: it is no {kind} of the robot")
    if not near:
        return None
    surest = [each for each in near if each.rank // 10 == min(near, key=lambda each: each.rank).rank // 10]
    chosen = min(surest, key=lambda each: (not each.view[0] > _AHEAD, each.rank))
    others = [each.name for each in surest if np.linalg.norm(each.place - chosen.place) > _SAME_M]
    if others:
        notes.append(f"of several {kind}s, {chosen.name} is taken, not {', '.join(dict.fromkeys(others))}")
    return chosen


def _tagged(model: mujoco.MjModel, data: mujoco.MjData, tags: list[SensorTag]) -> list[Sensor]:
    """Sensors of Gazebo: cameras have ranks below 1."""
    names = {model.body(k).name: k for k in range(model.nbody)}
    sensors = []
    for tag in tags:
        if tag.link not in names:
            continue
        k = names[tag.link]
        place, turn = data.xpos[k], data.xmat[k].reshape(3, 3)
        for pose in tag.poses:
            place = place + turn @ pose[:3]
            turn = turn @ Rotation.from_euler("xyz", pose[3:]).as_matrix()
        rank = 1.0 if not tag.is_camera else 0.0 if tag.has_depth else 0.5
        sensors.append(Sensor(tag.name, place.copy(), turn[:, 0], rank, tag.hfov_deg))
    return sensors


def _named(
    name: re.Pattern[str], model: mujoco.MjModel, data: mujoco.MjData, bodies: set[int], notes: list[str]
) -> list[Sensor]:
    """Bodies and sites of the robot called after a sensor; of a chain of links only the first and optical frames."""
    sensors: list[Sensor] = []
    chosen: set[int] = set()
    for k in sorted(bodies):
        text = model.body(k).name.lower()
        if not _is_sensor(name, text):
            continue
        turn = data.xmat[k].reshape(3, 3)
        if is_optical := "optical" in text:
            rank = 10.0 + 0.1 * ("depth" not in text) + 0.1 * ("infra" in text or "imager" in text)
        else:
            rank = 11.0
        above, ancestor = False, int(model.body_parentid[k])
        while ancestor:
            above, ancestor = above or ancestor in chosen, int(model.body_parentid[ancestor])
        if is_optical or not above:
            chosen.add(k)
            view = turn[:, 2] if is_optical else turn[:, 0]
            sensors.append(Sensor(model.body(k).name, data.xpos[k].copy(), view, rank))
    for k in range(model.nsite):
        if model.site_bodyid[k] in bodies and _is_sensor(name, model.site(k).name.lower()):
            view = data.site_xmat[k].reshape(3, 3)[:, 0]
            sensors.append(Sensor(model.site(k).name, data.site_xpos[k].copy(), view, 12.0))
    holders = [model.body(k).name for k in sorted(bodies) if name.search(model.body(k).name.lower())]
    if holders and not sensors:
        notes.append(f"{', '.join(holders)} are named after what holds a sensor: none counts as the sensor")
    return sensors


def _is_sensor(name: re.Pattern[str], text: str) -> bool:
    match = name.search(text)
    return match is not None and not _HOLDER.search(text) and not _BASE.search(text[match.end() :])


def _hfov_deg(model: mujoco.MjModel, k: int) -> float:
    """Horizontal field of view of an MJCF camera, whose `fovy` is the vertical one."""
    width_m, focal_m = model.cam_sensorsize[k][0], model.cam_intrinsic[k][0]
    if width_m > 0:
        return math.degrees(2 * math.atan(width_m / 2 / focal_m))
    width, height = model.cam_resolution[k]
    return math.degrees(2 * math.atan(math.tan(math.radians(model.cam_fovy[k]) / 2) * width / height))
