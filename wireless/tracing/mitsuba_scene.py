"""Mitsuba 3 scenes with radio materials, such as those of Sionna RT and of `robosim plan`, as meshes for the tracer.

Shapes are PLY and OBJ files, rectangles and cubes, placed by matrices, translations, rotations and scales. Materials
are `itu-radio-material` (a slab of a material of ITU-R P.2040, 0.1 m thick if the scene does not say), or are named
itu_TYPE or mat-itu_TYPE, as in older scenes. Units are metres, z points upwards.
Left out: lights, sensors, scattering of materials, and anything but shapes and materials.
"""

import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import trimesh
from jaxtyping import Float, Int

from robosim.support.reading import FileError, reading
from wireless.em.materials import MATERIALS, Layer, Material

#: Thickness of a slab that the scene does not give [m], as in Sionna RT.
_THICK_M = 0.1
_REMEDY = "Give a Mitsuba 3 scene with shapes and ITU radio materials."
_AXES = ("x", "y", "z")


class MitsubaScene(NamedTuple):
    """A mesh with a material of each face."""

    mesh: trimesh.Trimesh
    materials: tuple[str | Material, ...]
    face_material: Int[np.ndarray, " n_faces"]
    """Index into `materials`."""
    floor_ceiling: bool = True
    """All surfaces reflect, level ones too."""


def is_mitsuba(path: Path) -> bool:
    """Whether a file is a scene, by its content; each .xml file counts, to be rejected with the reason."""
    if path.suffix.lower() == ".xml":
        return True
    try:
        with reading(path, "a scene") as file:
            _, first = next(iter(ET.iterparse(file, events=("start",))))
            return bool(first.tag == "scene")
    except FileError:
        return False


def read_mitsuba(path: Path, materials: Mapping[str, Material | str] | None = None) -> MitsubaScene:
    """Read a scene (.xml) and its meshes.

    Args:
        path: The scene.
        materials: Materials, as the tracer takes them, by the names that the scene gives them, instead of its own.

    Raises:
        FileError: If a file is damaged, a shape or material is not understood, or there is no shape.
    """
    given = dict(materials or {})
    with reading(path, "a Mitsuba scene", _REMEDY) as file:
        root = ET.parse(file).getroot()
        if root.tag != "scene":
            raise ValueError(f"it begins with <{root.tag}>, expected <scene>")
        values = {f"${one.get('name')}": one.get("value", "") for one in root.iter("default")}
        for one in root.iter():
            one.attrib.update({key: values.get(value, value) for key, value in one.attrib.items()})
        bsdfs = {one.get("id", ""): one for one in root.findall("bsdf")}
        names: list[str] = []
        parts: list[trimesh.Trimesh] = []
        of_part: list[int] = []
        for number, shape in enumerate(root.iter("shape"), 1):
            name = shape.get("id") or f"number {number}"
            parts.append(_mesh(shape, path.parent, name))
            material = _material_name(shape, name)
            if material not in names:
                names.append(material)
            of_part.append(names.index(material))
        if not parts:
            raise ValueError("there is no shape in it")
        mesh = trimesh.util.concatenate(parts)
        assert isinstance(mesh, trimesh.Trimesh)
        return MitsubaScene(
            mesh=trimesh.Trimesh(mesh.vertices, mesh.faces, process=False),
            materials=tuple(_material(name, bsdfs.get(name), given) for name in names),
            face_material=np.repeat(of_part, [len(part.faces) for part in parts]),
        )


def _mesh(shape: ET.Element, folder: Path, name: str) -> trimesh.Trimesh:
    """The triangles of a shape, in the scene."""
    kind = shape.get("type")
    if kind in ("ply", "obj"):
        file = next(
            (one.get("value", "") for one in shape.findall("string") if one.get("name") == "filename"), ""
        )
        try:
            with reading(folder / file, "a mesh of a scene") as content:
                mesh = trimesh.load_mesh(io.BytesIO(content.read()), file_type=kind, process=False)
        except FileError as error:
            raise FileError(f"shape {name}: {error}") from error
    elif kind == "rectangle":
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    elif kind == "cube":
        mesh = trimesh.creation.box((2, 2, 2))
    else:
        raise FileError(
            f"shape {name} is of type {kind!r}, expected ply, obj, rectangle or cube. Export it as a mesh."
        )
    for transform in shape.findall("transform"):
        for step in transform:
            mesh.apply_transform(_matrix(step, name))
    return mesh


def _matrix(step: ET.Element, name: str) -> Float[np.ndarray, "4 4"]:
    """One step of a transform."""
    if step.tag == "matrix":
        return np.array(step.get("value", "").replace(",", " ").split(), float).reshape(4, 4)
    default = 1.0 if step.tag == "scale" else 0.0
    whole = [float(value) for value in step.get("value", "").replace(",", " ").split()]
    xyz = whole * 3 if len(whole) == 1 else whole or [float(step.get(axis, default)) for axis in _AXES]
    if step.tag == "translate":
        return np.asarray(trimesh.transformations.translation_matrix(xyz))
    if step.tag == "scale":
        return np.diag([*xyz, 1.0])
    if step.tag == "rotate":
        angle = math.radians(float(step.get("angle", 0)))
        return np.asarray(trimesh.transformations.rotation_matrix(angle, xyz))
    raise FileError(
        f"shape {name} has a transform <{step.tag}>, expected matrix, translate, rotate or scale."
    )


def _material_name(shape: ET.Element, name: str) -> str:
    """The name of a shape's material."""
    for one in (*shape.findall("ref"), *shape.findall("bsdf")):
        if one.get("id"):
            return str(one.get("id"))
    raise FileError(f"shape {name} has no material. Give it one by <ref id=.../>.")


def _material(name: str, bsdf: ET.Element | None, given: Mapping[str, Material | str]) -> str | Material:
    """A material by its name in the scene."""
    if name in given:
        return given[name]
    values: dict[str, str] = {}
    if bsdf is not None:
        values = {one.get("name", ""): one.get("value", "") for one in bsdf}
    kind = values.get("type") or name.removeprefix("mat-").removeprefix("itu_")
    kind = kind.replace("-", "_")
    if kind not in MATERIALS:
        raise FileError(
            f"material {name!r} is {kind!r}, expected one of ITU-R P.2040: {', '.join(MATERIALS)}. Give materials="
            f"{{{name!r}: 'concrete'}} or another one."
        )
    thickness_m = float(values.get("thickness", _THICK_M))
    return Material(name, (Layer(thickness_m=thickness_m, material=kind),))
