"""Mitsuba 3 scenes with radio materials, such as those of Sionna RT and of `robosim plan`, as meshes for the tracer.

Shapes are PLY and OBJ files, rectangles and cubes, placed by matrices, translations, rotations and scales; files that
`<include>` names are parts of the scene. What a scene states of a material counts more than its name: `radio-material`
has its own permittivity and conductivity, `itu-radio-material` a type of ITU-R P.2040, both a thickness (0.1 m if the
scene does not say) and a scattering coefficient, which counts where the tracer scatters. Other materials are those of
ITU-R P.2040 by their names, itu_TYPE or mat-itu_TYPE, as in older scenes. Units are metres, z points upwards.
Left out: lights, sensors, the cross-polarisation of scattering, and anything but shapes and materials.
"""

import io
import logging
import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import trimesh
from jaxtyping import Float, Int
from trimesh.exchange.ply import load_ply
from trimesh.util import append_faces

from robosim.support.reading import MOST_BYTES, FileError, reading
from wireless.em.materials import MATERIALS, Layer, Material
from wireless.tracing.mesh_check import check_mesh, surfaces_digest
from wireless.tracing.scene_size import check_size

logger = logging.getLogger(__name__)

#: Thickness of a slab that the scene does not give [m], as in Sionna RT.
THICK_M = 0.1
#: Most bytes of a mesh file of a large scene.
_LARGEST_BYTES = 1 << 40
_REMEDY = "Give a Mitsuba 3 scene with shapes and ITU radio materials."
_AXES = ("x", "y", "z")
#: Smaller scenes are said to be in other units [m].
_SMALL_M = 1.0
#: Types of radio materials, and their properties; those of the second line change nothing, or are said to be left out.
_RADIO = ("radio-material", "itu-radio-material", "radio_material", "itu_radio_material")
_PROPERTIES = ("type", "relative_permittivity", "conductivity", "thickness", "scattering_coefficient")
_LEFT_OUT = ("xpd_coefficient", "scattering_pattern", "alpha_r", "alpha_i", "lambda_", "color")
#: Vertices [m] of a mesh, and vertices of its faces.
_Arrays = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]
#: Header of the PLY files of Sionna RT, and of others whose faces are triangles.
_TRIANGLES = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment[^\n]*\n)*"
    rb"element vertex (\d+)\nproperty (float|double) x\nproperty \2 y\nproperty \2 z\n"
    rb"element face (\d+)\nproperty list uchar (u?)int vertex_ind(?:ex|ices)\nend_header\n"
)


class MitsubaScene(NamedTuple):
    """A mesh with a material of each face."""

    mesh: trimesh.Trimesh
    materials: tuple[str | Material, ...]
    face_material: Int[np.ndarray, " n_faces"]
    """Index into `materials`."""
    shapes: tuple[tuple[str, int, str], ...] = ()
    """Name, number of triangles and material of each shape."""
    notes: tuple[str, ...] = ()
    """What was assumed."""
    floor_ceiling: bool = True
    """All surfaces reflect, level ones too."""
    name: str = "scene"
    """Name in reports and files."""

    @property
    def digest(self) -> str:
        """A text that changes with any vertex, face or material."""
        return surfaces_digest(self.mesh, self.face_material, self.materials)


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


def read_mitsuba(
    path: Path, materials: Mapping[str, Material | str] | None = None, *, allow_large: bool = False
) -> MitsubaScene:
    """Read a scene (.xml) and its meshes.

    Args:
        path: The scene.
        materials: Materials, as the tracer takes them, by the names that the scene gives them, instead of its own.
        allow_large: Whether it may be too large to be prepared for tracing, see `wireless.tracing.scene_size`.

    Raises:
        FileError: If a file is damaged, a shape or material is not understood, there is no shape, or it is too large.
    """
    replacements = dict(materials or {})
    with reading(path, "a Mitsuba scene", _REMEDY):
        try:
            root = _read_root(path, path.parent, ())
        except FileError as error:
            error.file = None  # of an included file: the message names both
            raise
        # The first value counts: an included file has those of parameters that are not set before.
        values = {each.get("name"): each.get("value", "") for each in reversed([*root.iter("default")])}
        for element in root.iter():
            for key, text in element.items():
                element.set(key, re.sub(r"\$(\w+)", lambda name: values.get(name[1], name[0]), text))
        for element in (*root.iter("bsdf"), *root.iter("shape")):
            named = Counter(filter(None, (each.get("name") for each in element)))
            for twice in [key for key, count in named.items() if count > 1][:1]:
                raise ValueError(f"{element.tag} {element.get('id')!r} has {twice!r} twice, expected it once")
        bsdfs: dict[str, ET.Element] = {}
        for bsdf in root.iter("bsdf"):
            if bsdfs.setdefault(bsdf.get("id", ""), bsdf) is not bsdf and bsdf.get("id"):
                raise ValueError(f"there are two materials {bsdf.get('id')!r}, expected one")
        names: list[str] = []
        shapes: list[tuple[str, int, str]] = []
        meshes: list[_Arrays] = []
        of_mesh: list[int] = []
        for number, shape in enumerate(root.iter("shape"), 1):
            name = shape.get("id") or f"number {number}"
            meshes.append(_arrays(shape, path.parent, name, allow_large))
            material = _material_name(shape, name, bsdfs)
            if material not in names:
                names.append(material)
            of_mesh.append(names.index(material))
            shapes.append((name, len(meshes[-1][1]), material))
        if not meshes:
            raise ValueError("there is no shape in it")
        if unknown := sorted(set(replacements) - set(names)):
            raise ValueError(f"there is no material {unknown[0]!r} in it, expected one of {', '.join(names)}")
        n_faces = np.array([count for _, count, _ in shapes])
        if not allow_large:
            check_size(int(n_faces.sum()))
        mesh = trimesh.Trimesh(*append_faces(*zip(*meshes, strict=True)), process=False)
        area_m2 = np.add.reduceat(mesh.area_faces, np.cumsum(n_faces) - n_faces)
        for wrong in np.flatnonzero(~(area_m2 > 0))[:1]:
            raise FileError(
                f"shape {shapes[wrong][0]} has an area of {area_m2[wrong]:g} m2. Check its mesh and its transforms."
            )
        check_mesh(mesh, 0.0)
        notes: list[str] = []
        if (span_m := float(mesh.extents.max())) < _SMALL_M:
            notes.append(f"the scene is {span_m:.3g} m large: are its meshes and places in metres?")
        made = [
            replacements[name] if name in replacements else _material(name, bsdfs.get(name), notes)
            for name in names
        ]
        scene = MitsubaScene(
            mesh=mesh,
            materials=tuple(made),
            face_material=np.repeat(of_mesh, n_faces),
            shapes=tuple(shapes),
            notes=tuple(notes),
            name=path.stem,
        )
    for note in notes:
        logger.log(logging.INFO if "thickness" in note else logging.WARNING, "%s: %s", path, note)
    return scene


def _read_root(path: Path, folder: Path, chain: tuple[Path, ...]) -> ET.Element:
    """The root of a scene in a folder, with the content of the files that it includes in their place."""
    with reading(path, "a Mitsuba scene", _REMEDY) as file:
        root = ET.parse(file).getroot()
    if root.tag != "scene":
        raise ValueError(f"it begins with <{root.tag}>, expected <scene>")
    if path.resolve() in chain:
        raise ValueError(f"{path} includes itself, expected no cycle")
    for element in root.iter("string") if path.parent != folder else ():
        here, there = (at / element.get("value", "") for at in (path.parent, folder))
        if element.get("name") == "filename" and here.exists() and not there.exists():
            element.set("value", str(here.absolute()))
    for number, element in reversed(list(enumerate(root))):
        if element.tag == "include":
            name = element.get("filename", "")
            other = next((at / name for at in (folder, path.parent) if (at / name).exists()), folder / name)
            root[number : number + 1] = list(_read_root(other, folder, (*chain, path.resolve())))
    return root


def _file_of(shape: ET.Element) -> str:
    """Name of the file of a shape; empty if it has none."""
    values = (child.get("value", "") for child in shape.findall("string") if child.get("name") == "filename")
    return next(values, "")


def _arrays(shape: ET.Element, folder: Path, name: str, allow_large: bool) -> _Arrays:
    """Vertices and faces of a shape, in the scene."""
    kind = shape.get("type")
    if kind in ("ply", "obj"):
        most_bytes = _LARGEST_BYTES if allow_large else MOST_BYTES
        try:
            with reading(folder / _file_of(shape), "a mesh of a scene", most_bytes=most_bytes) as content:
                arrays = _loaded(content.read(), kind)
        except FileError as error:
            raise FileError(f"shape {name}: {error}") from error
    elif kind == "rectangle":
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        arrays = corners, np.array([[0, 1, 2], [0, 2, 3]])
    elif kind == "cube":
        arrays = _arrays_of(trimesh.creation.box((2, 2, 2)))
    else:
        raise FileError(
            f"shape {name} is of type {kind!r}, expected ply, obj, rectangle or cube. Export it as a mesh."
        )
    if steps := [step for transform in shape.findall("transform") for step in transform]:
        mesh = trimesh.Trimesh(*arrays, process=False)
        for step in steps:
            mesh.apply_transform(_matrix(step, name))
        arrays = _arrays_of(mesh)
    return arrays


def _arrays_of(mesh: trimesh.Trimesh) -> _Arrays:
    """Vertices and faces of a mesh."""
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _loaded(content: bytes, kind: str) -> _Arrays:
    """Vertices and faces of a file; ValueError if there are no faces, or a vertex is missing or not finite."""
    if kind == "ply":
        vertices, faces = _triangles(content) or _polygons(content)
    else:
        vertices, faces = _obj(content)
    if not len(faces):
        raise ValueError("it has no faces, expected triangles")
    if not np.isfinite(vertices).all():
        raise ValueError("a vertex is not finite, expected numbers")
    if (least := faces.min()) < 0 or faces.max() >= len(vertices):
        wrong = least if least < 0 else faces.max()
        raise ValueError(f"a face has vertex {wrong}, expected 0 to {len(vertices) - 1}")
    return vertices, faces


def _obj(content: bytes) -> _Arrays:
    """Vertices and triangles of an OBJ file, whose negative numbers count back from the vertex before the face."""
    vertices: list[list[bytes]] = []
    faces: list[list[int]] = []
    for line in re.sub(rb"\\\r?\n", b" ", content).splitlines():
        kind, *words = line.partition(b"#")[0].split() or [b""]
        if kind == b"v":
            vertices.append(words[:3])
        elif kind == b"f":
            corner = [int(word.partition(b"/")[0]) for word in words]
            corner = [number - 1 if number >= 0 else len(vertices) + number for number in corner]
            faces += [[corner[0], *corner[k : k + 2]] for k in range(1, len(corner) - 1)]
    return np.array(vertices, float).reshape(-1, 3), np.array(faces, np.int64).reshape(-1, 3)


def _triangles(content: bytes) -> _Arrays | None:
    """Vertices and faces of a binary PLY file of nothing but triangles; None for any other."""
    # Scenes of cities have thousands of files, and `load_ply` takes half a millisecond for each.
    header = _TRIANGLES.match(content)
    if header is None:
        return None
    n_vertices, number, n_faces, unsigned = header.groups()
    corner = np.dtype(("<f8" if number == b"double" else "<f4", 3))
    face = np.dtype([("n", "u1"), ("corner", "<u4" if unsigned else "<i4", 3)])
    middle = header.end() + int(n_vertices) * corner.itemsize
    if len(content) != middle + int(n_faces) * face.itemsize:
        return None
    vertices = np.frombuffer(content, corner.base, 3 * int(n_vertices), header.end()).reshape(-1, 3)
    faces = np.frombuffer(content, face, offset=middle)
    return (vertices.astype(float), faces["corner"].astype(np.int64)) if (faces["n"] == 3).all() else None


def _polygons(content: bytes) -> _Arrays:
    """Vertices and faces of any PLY file, which may be text; ValueError if it lacks faces."""
    header, _, data = content.partition(b"end_header")
    counts = {name: int(count) for name, count in re.findall(rb"element\s+(\w+)\s+(\d+)", header)}
    lines = sum(bool(line.strip()) for line in data.splitlines())
    if b"format ascii" in header and lines < sum(counts.values()):
        raise ValueError(f"it announces {sum(counts.values())} vertices and faces, but has {lines} lines")
    # Without the colours, which `trimesh.load_mesh` copies several times.
    arrays = load_ply(io.BytesIO(content))
    mesh = trimesh.Trimesh(arrays.get("vertices"), arrays.get("faces"), process=False)
    if 0 < len(mesh.faces) < counts.get(b"face", 0):
        raise ValueError(f"it announces {counts[b'face']} faces, but has {len(mesh.faces)}")
    return _arrays_of(mesh)


def _matrix(step: ET.Element, name: str) -> Float[np.ndarray, "4 4"]:
    """One step of a transform."""
    if step.tag == "matrix":
        matrix = np.array(step.get("value", "").replace(",", " ").split(), float).reshape(4, 4)
        if not (np.isfinite(matrix).all() and (matrix[3] == (0, 0, 0, 1)).all()):
            raise FileError(f"shape {name} has a matrix of last row {matrix[3]}, expected 0 0 0 1.")
        return matrix
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


def _material_name(shape: ET.Element, name: str, bsdfs: dict[str, ET.Element]) -> str:
    """The name of a shape's material; a material without a name inside of a shape gets that of the shape."""
    for each in (*shape.findall("ref"), *shape.findall("bsdf")):
        if each.tag == "bsdf":
            material = each.get("id") or f"of {name}"
            bsdfs[material] = each
            return material
        if each.get("id") and each.get("name", "bsdf") == "bsdf":
            return str(each.get("id"))
    raise FileError(f"shape {name} has no material. Give it one by <ref id=.../>.")


def _material(name: str, bsdf: ET.Element | None, notes: list[str]) -> Material:
    """A material of a scene: what it states or, for others than radio materials, what its name means."""
    nested = () if bsdf is None else bsdf.iter("bsdf")
    radio = next((each for each in nested if each.get("type") in _RADIO), None)
    stated = radio if radio is not None else bsdf if bsdf is not None else ()
    values = {each.get("name", ""): each.get("value", "") for each in stated}
    plain = name.removeprefix("mat-")
    if (
        radio is None
    ):  # as in Sionna RT, a material by its name states a thickness and, as mat-itu_NAME, its type
        used = ("thickness", "type") if plain.startswith("itu") else ("thickness",)
        values = {key: value for key, value in values.items() if key in used}
    if wrong := sorted(set(values) - {*_PROPERTIES, *_LEFT_OUT}):
        raise FileError(
            f"material {name!r} has {wrong[0]!r}, expected only {', '.join((*_PROPERTIES, *_LEFT_OUT))}."
        )
    scattering = float(values["scattering_coefficient"]) if "scattering_coefficient" in values else None
    if scattering:
        notes.append(f"material {name} scatters (S = {scattering:g}) only if the tracer does (--scattering)")
        if "xpd_coefficient" in values or values.get("scattering_pattern", "lambertian") != "lambertian":
            notes.append(f"xpd_coefficient and scattering_pattern of material {name} are left out")
    thickness_m = float(values.get("thickness", THICK_M))
    if "thickness" not in values:
        notes.append(f"material {name} states no thickness: {THICK_M:g} m")
    if "relative_permittivity" in values or (radio is not None and "itu" not in radio.get("type", "")):
        layer = Layer(
            thickness_m=thickness_m,
            relative_permittivity=float(values.get("relative_permittivity", 1)),
            conductivity_spm=float(values.get("conductivity", 0)),
        )
        return Material(name, (layer,), scattering=scattering)
    if "conductivity" in values:
        raise FileError(f"material {name!r} has a conductivity without relative_permittivity, expected both.")
    kind = (values.get("type") or plain.removeprefix("itu_")).replace("-", "_")
    if kind not in MATERIALS:
        raise FileError(
            f"material {name!r} is {kind!r}, expected one of ITU-R P.2040: {', '.join(MATERIALS)}. Give "
            f"--scene-material {name}=concrete, materials={{{name!r}: 'concrete'}} or another one."
        )
    if radio is None and bsdf is not None and not plain.startswith("itu"):
        notes.append(f"material {name} is no radio material: its name makes it {kind} of ITU-R P.2040")
    return Material(name, (Layer(thickness_m=thickness_m, material=kind),), scattering=scattering)
