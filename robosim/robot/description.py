"""Descriptions of robots in URDF and MJCF, checked and loaded by MuJoCo.

MuJoCo follows includes without end, makes any number of copies, waits for named pipes, and gives links of a URDF file
without `<inertial>` the mass of their collision shapes in water. So files, copies and numbers are checked before it
reads them, and a URDF file is reduced to links, their inertials and collision geometry, and joints that can turn;
links without inertials have no mass.
Sensors of Gazebo are listed with the link that each, or its pose by `relative_to`, refers to.
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from robosim.robot.physics_engine import mujoco
from robosim.support.reading import one_line, reading

#: Most elements of MJCF with all includes and copies, and most cells of a texture or height field.
_MOST_ELEMENTS, _MOST_CELLS = 20_000, 10_000_000
#: Mass and inertia of a link that states none: MuJoCo needs some [kg, kg m2].
NO_MASS_KG, _NO_INERTIA = 1e-9, 1e-12
#: Radius of gyration that replaces one that is zero or imaginary [m].
_GYRATION_M = 0.01
#: Group of the geoms that collide; the others are in group 2. None collides with what it is attached to.
COLLIDING = 1
_CAMERAS = re.compile(r"camera|depth|rgbd|kinect", re.IGNORECASE)
_LIDARS = re.compile(r"^(gpu_)?(ray|lidar|laser)$", re.IGNORECASE)


class SensorTag(NamedTuple):
    """A sensor of Gazebo in a URDF file."""

    name: str
    link: str
    is_camera: bool
    has_depth: bool
    poses: list[list[float]]
    """x, y, z [m], roll, pitch, yaw [rad] in the link, then in the frame of the pose before; it looks along x."""
    hfov_deg: float | None


class Description(NamedTuple):
    """A description as MuJoCo loads it."""

    spec: mujoco.MjSpec
    """Geoms that collide are in group `COLLIDING`, with neither contype nor conaffinity."""
    sensors: list[SensorTag]
    notes: list[str]
    """Assumptions, and faults of the file that do not prevent reading."""


def load_description(path: Path) -> Description:
    """Load a URDF or MJCF file.

    Raises:
        ValueError: If MuJoCo cannot read it, a number is NaN, files include each other, copies are too many, or it is
            xacro.
        FileError: If a file that it names is missing, or is no regular file.
    """
    root = _parse(path)
    notes: list[str] = []
    sensors: list[SensorTag] = []
    with warnings_as(notes):
        if root.tag == "robot":
            sensors = [tag for element in root.iter("gazebo") for tag in _sensor_tags(element)]
            strange = {tag.link for tag in sensors} - {link.get("name") for link in root.findall("link")}
            notes += [
                f"sensors are on {name!r}, which is no link: they are left out" for name in sorted(strange)
            ]
            spec = mujoco.MjSpec.from_string(_urdf(root, path, notes))
            for mesh in spec.meshes:
                mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # flat ones have no volume
            for body in spec.bodies:
                if not body.explicitinertial:
                    body.explicitinertial, body.mass, body.ipos = True, NO_MASS_KG, (0.0, 0.0, 0.0)
                    body.inertia = (_NO_INERTIA,) * 3
        else:
            _check_files(path, root, (path.resolve(),), path.parent)
            spec = mujoco.MjSpec.from_file(str(path))
            spec.memory = -1
            if spec.compiler.settotalmass > 0:
                raise ValueError("settotalmass is not supported, expected the masses of bodies or geoms")
            for number, each in enumerate((*spec.bodies, *spec.joints)):
                each.name = each.name or f"unnamed {number}"
            notes += _water(spec)
    low, high = spec.compiler.inertiagrouprange
    spec.compiler.inertiagrouprange = (0, 5)  # groups change here
    for geom in spec.geoms:
        if not low <= geom.group <= high:
            geom.mass = 0.0
        geom.group = COLLIDING if geom.contype or geom.conaffinity else 2
        geom.contype = geom.conaffinity = 0
    spec.compiler.discardvisual = False  # nothing collides here
    spec.compiler.fusestatic = False  # links without joints keep their names
    balance_inertias(spec)
    return Description(spec, sensors, notes)


def balance_inertias(spec: mujoco.MjSpec) -> None:
    """Replace principal moments of inertia that violate A + B >= C by their mean, as many descriptions need."""
    spec.compiler.balanceinertia = True


@contextmanager
def warnings_as(notes: list[str]) -> Iterator[None]:
    """Append MuJoCo's warnings, which it would print, to a list."""
    mujoco.set_mju_user_warning(notes.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)


def _parse(path: Path) -> ET.Element:
    """The root of an XML file; prefixes of names, which need no declaration in URDF, become a part of them."""
    with reading(path, "a description of a robot") as file:
        text = re.sub(r"<!--.*?-->", "", file.read().decode("utf-8-sig", "replace"), flags=re.DOTALL)
    if match := re.search(r"\$\{[^}]*\}|\$\([^)]*\)|<xacro:\w+", text):
        raise ValueError(
            f"{one_line(match[0])} is xacro, expected URDF: expand it with the program xacro first"
        )
    root = ET.fromstring(re.sub(r"(</?|\s)(?!xmlns)([\w.-]+):(?=[\w.-]+[\s=/>])", r"\1\2_", text))
    for element in root.iter():
        for key, value in element.attrib.items():
            if key not in ("name", "link", "joint") and re.search(r"(^|\s)[+-]?nan(\s|$)", value, re.I):
                raise ValueError(f"{key} of <{element.tag}> is {one_line(value)!r}, expected numbers")
    return root


def _check_files(
    path: Path, element: ET.Element, chain: tuple[Path, ...], folder: Path, copies: int = 1
) -> int:
    """Check the files that an element of MJCF names, and how much it makes; returns the number of elements."""
    copies *= _product(element, "count")
    if element.tag in ("texture", "hfield"):
        cells = _product(element, "nrow", "ncol", "width", "height")
        if cells > _MOST_CELLS:
            raise ValueError(f"<{element.tag}> has {cells:g} cells, expected up to {_MOST_CELLS:g}")
    total = copies
    for name in filter(None, (element.get("file"), element.get("filename"))):
        compilers = [each.attrib for each in _parse(chain[0]).iter("compiler")]
        inner = [at.get(key, "") for at in compilers for key in ("meshdir", "assetdir", "texturedir")]
        folders = [at / each for at in (path.parent, folder) for each in ("", *inner)]
        file = next((at / name for at in folders if (at / name).exists()), None)
        if file is None:
            continue  # MuJoCo says so
        if element.tag not in ("include", "model"):
            with reading(file, f"a file of a <{element.tag}>"):
                continue
        if file.resolve() in chain:
            raise ValueError(f"<{element.tag}> of {one_line(name)!r} includes itself, expected no cycle")
        total += _check_files(file, _parse(file), (*chain, file.resolve()), folder, copies)
    for child in element:
        total += _check_files(path, child, chain, folder, copies)
    if total > _MOST_ELEMENTS:
        raise ValueError(f"<{element.tag}> makes {total:g} elements, expected up to {_MOST_ELEMENTS:g}")
    return total


def _product(element: ET.Element, *keys: str) -> int:
    """The product of all numbers in attributes, those below 1 as 1."""
    numbers = [
        value for key in keys for value in re.findall(r"[\d.]+(?:[eE][+-]?\d+)?", element.get(key, ""))
    ]
    return math.prod(max(1, int(min(float(value), 1e12))) for value in numbers)


def _water(spec: mujoco.MjSpec) -> list[str]:
    """A note of the bodies whose mass is that of their shape in water, MJCF's default."""
    names = [
        geom.parent.name or "a body"
        for geom in spec.geoms
        if not geom.parent.explicitinertial
        and geom.parent.name != "world"
        and math.isnan(geom.mass)
        and geom.density == 1000.0
    ]
    listed = ", ".join(dict.fromkeys(names))
    return [f"no mass of {listed} is stated: it is that of water, MJCF's default density"] if names else []


def _urdf(root: ET.Element, path: Path, notes: list[str]) -> str:
    """Links and joints of a URDF file as MuJoCo reads them."""
    robot = ET.Element("robot", name="robot")
    folders = [each.get("meshdir") for each in root.iter("compiler") if each.get("meshdir")]
    for link in root.findall("link"):
        reduced = ET.SubElement(robot, "link", name=link.get("name", ""))
        if (inertial := _inertial(link, notes)) is not None:
            reduced.append(inertial)
        for collision in link.findall("collision"):
            collision.attrib.clear()  # two of a name are an error in MuJoCo
            for mesh in collision.iter("mesh"):
                mesh.set("filename", _mesh_file(mesh.get("filename", ""), path, folders))
            reduced.append(collision)
    for joint in root.findall("joint"):
        reduced = ET.SubElement(robot, "joint", name=joint.get("name", ""), type="fixed")
        reduced.extend(each for each in joint if each.tag in ("origin", "parent", "child", "axis"))
        axis = joint.find("axis")
        can_turn = joint.get("type") in ("revolute", "continuous")
        if axis is not None and not any(_numbers(axis, "xyz")):
            reduced.remove(axis)
            can_turn = False
        if can_turn:
            limit = joint.find("limit")
            low, high = ((*_numbers(limit, key), 0.0)[0] for key in ("lower", "upper"))
            is_limited = joint.get("type") == "revolute" and low < high
            if low > high:
                notes.append(f"limits of joint {joint.get('name')}, {low:g} to {high:g}, do not count")
            reduced.set("type", "revolute" if is_limited else "continuous")
            if is_limited and limit is not None:
                ET.SubElement(reduced, "limit", lower=str(max(low, -1e3)), upper=str(min(high, 1e3)))
    return ET.tostring(robot, "unicode")


def _inertial(link: ET.Element, notes: list[str]) -> ET.Element | None:
    """The inertial of a link with an inertia that a body can have; None if its mass is zero."""
    name, inertial = link.get("name", ""), link.find("inertial")
    if inertial is None:
        return None
    mass_kg = (*_numbers(inertial.find("mass"), "value"), math.nan)[0]
    if not 0 <= mass_kg < math.inf:
        raise ValueError(f"the mass of link {name!r} is {mass_kg} kg, expected a number of 0 or more")
    if not mass_kg:
        return None
    inertia = inertial.find("inertia")
    if inertia is None:
        inertia = ET.SubElement(inertial, "inertia")
    xx, xy, xz, yy, yz, zz = (
        (*_numbers(inertia, key), 0.0)[0] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if not np.isfinite(tensor).all():
        raise ValueError(f"the inertia of link {name!r} is {tensor.tolist()}, expected finite numbers")
    value, axes = np.linalg.eigh(tensor)
    if value.min() <= 1e-12:
        notes.append(f"the inertia of {name} is zero or negative: {_GYRATION_M:g} m of gyration assumed")
        tensor = (axes * np.where(value <= 1e-12, mass_kg * _GYRATION_M**2, value)) @ axes.T
    for i, j, key in (
        (0, 0, "ixx"),
        (0, 1, "ixy"),
        (0, 2, "ixz"),
        (1, 1, "iyy"),
        (1, 2, "iyz"),
        (2, 2, "izz"),
    ):
        inertia.set(key, repr(float(tensor[i, j])))
    return inertial


def _numbers(element: ET.Element | None, key: str) -> list[float]:
    """Numbers of an attribute, or of the text of an element for the key ''."""
    text = "" if element is None else (element.get(key, "") if key else element.text or "")
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        raise ValueError(f"{key or element.tag} is {one_line(text)!r}, expected numbers") from None  # type: ignore[union-attr]


def _mesh_file(name: str, path: Path, folders: list[Any]) -> str:
    """A mesh of a URDF file: package://NAME/REST is in a folder NAME around it, or REST in a folder around it.

    FileError if it is missing, or no regular file.
    """
    rest = name.removeprefix("file://")
    _, is_package, rest_of = rest.partition("://")
    places = [path.parent / rest, *(path.parent / folder / rest for folder in folders)]
    if is_package:
        package, _, inner = rest_of.partition("/")
        around = path.absolute().parents
        places = [*(at / package / inner for at in around), *(at / inner for at in around)]
    file = next((place.absolute() for place in places if place.exists()), None)
    if file is None:
        raise ValueError(f"there is no mesh {one_line(name)}, neither next to it nor in its package")
    with reading(file, "a mesh"):
        return str(file)


def _sensor_tags(gazebo: ET.Element) -> Iterator[SensorTag]:
    """Cameras and lidars of a `<gazebo reference=LINK>` element."""
    for sensor in gazebo.iter("sensor"):
        kind = sensor.get("type", "")
        is_camera = bool(_CAMERAS.search(kind)) and "logical" not in kind
        if not gazebo.get("reference") or not (is_camera or _LIDARS.search(kind)):
            continue
        _check_sensor(sensor)
        for optics in (sensor.findall("camera") or [sensor]) if is_camera else [sensor]:
            poses = [_numbers(each.find("pose"), "") for each in dict.fromkeys((sensor, optics))]
            frames = [pose.get("relative_to") for pose in sensor.findall("pose")]
            hfov_rad = (*_numbers(optics.find("horizontal_fov"), ""), math.nan)[0]
            yield SensorTag(
                name=sensor.get("name") or str(gazebo.get("reference")),
                link=str(next(filter(None, frames), gazebo.get("reference"))),
                is_camera=is_camera,
                has_depth=bool(re.search("depth|rgbd|kinect", kind)),
                poses=[pose for pose in poses if len(pose) == 6],
                hfov_deg=None if math.isnan(hfov_rad) else math.degrees(hfov_rad),
            )


def _check_sensor(sensor: ET.Element) -> None:
    """Raise ValueError for a sensor that sees nothing: no pixels or samples, no field of view, or no range."""
    for element in sensor.iter():
        tag, is_size = element.tag, element.tag in ("width", "height", "samples", "horizontal_fov")
        if is_size and min(_numbers(element, ""), default=1) <= 0:
            raise ValueError(f"{tag} of sensor {sensor.get('name')} is {element.text}, expected more than 0")
        if tag == "pose" and (
            len(_numbers(element, "")) not in (0, 6) or element.get("degrees", "false") not in ("false", "0")
        ):
            raise ValueError(
                f"pose of sensor {sensor.get('name')} is {one_line(element.text or '')!r} with {element.attrib}, "
                "expected x, y, z [m], roll, pitch, yaw [rad]"
            )
        widest = 6.3 if tag in ("horizontal", "vertical") else math.inf
        for low, high in (("min_angle", "max_angle"), ("min", "max"), ("near", "far")):
            ends = [*_numbers(element.find(low), ""), *_numbers(element.find(high), "")]
            is_single = ends[1:] == ends[:1] and _numbers(element.find("samples"), "") == [1.0]
            if len(ends) == 2 and not (is_single or 0 < ends[1] - ends[0] <= widest):
                raise ValueError(f"<{tag}> of sensor {sensor.get('name')} is from {ends[0]:g} to {ends[1]:g}")
