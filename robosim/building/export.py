"""A building in files for other programs: meshes, and scenes for Mitsuba, Sionna RT and DiffeRT.

Mesh files are in the `map` frame, metres, z up. GLB is y-up by its standard (glTF 2.0, section 3.4): there a
point (x, y, z) of `map` becomes (x, z, -y), as viewers expect.

A Mitsuba scene is an XML file with one PLY file per radio material (z up, as in Sionna RT's own scenes) and a
BSDF ``mat-itu_NAME`` of the plugin `itu-radio-material` for each material of Recommendation ITU-R P.2040,
which Sionna RT registers with Mitsuba and DiffeRT reads by itself. Drywall becomes plasterboard, whose newer
fit is 2.73 instead of 2.94. Both programs take walls for slabs of the given thickness.

Left out: textures; coordinates are stored with 32 bits, as these formats do.
"""

import difflib
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import trimesh

from robosim.building.building import KINDS, Building
from robosim.support.files import whole_file

#: Colour of each kind of face (red, green, blue, opacity), in the order of `KINDS`.
KIND_COLOURS = np.array(
    [[214, 209, 196, 255], [143, 107, 77, 255], [238, 238, 242, 255], [94, 129, 172, 255]], np.uint8
)

SUFFIXES = (".glb", ".ply", ".obj", ".stl")

#: What our materials are called in Recommendation ITU-R P.2040, where they have another name.
ITU_TYPES = {"drywall": "plasterboard"}

#: From `map` (z up) to glTF (y up).
T_GLTF_MAP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def export_mesh(building: Building, path: Path) -> Path:
    """Write the mesh of a building as GLB, PLY, OBJ or STL, whole or not at all.

    GLB and OBJ have an object for each kind of face, with its colour; PLY has coloured faces on shared
    vertices; STL has no colours.

    Args:
        building: What to write.
        path: Where to; the suffix chooses the format.

    Returns:
        The path.

    Raises:
        ValueError: If the suffix is of no known format.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        near = difflib.get_close_matches(suffix, SUFFIXES, n=1)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise ValueError(f"path is {path}, expected a name that ends in {', '.join(SUFFIXES)}.{hint}")
    content: trimesh.Trimesh | trimesh.Scene
    if suffix in (".glb", ".obj"):
        content = _scene(building)
        if suffix == ".glb":
            content.apply_transform(T_GLTF_MAP)
    else:
        content = building.mesh.copy()
        if suffix == ".ply":
            content.visual = trimesh.visual.ColorVisuals(
                content, face_colors=KIND_COLOURS[building.face_kind]
            )
    with whole_file(path) as partial:
        content.export(partial, file_type=suffix[1:])
    return path


def export_mitsuba(building: Building, path: Path, *, thickness_m: float = 0.1) -> Path:
    """Write a building as a Mitsuba 3 scene with ITU radio materials, and its meshes in `meshes` beside it.

    Each file appears whole or not at all, the XML last: where there is one, all its meshes are there.

    Args:
        building: What to write.
        path: XML file, or folder in which to write `scene.xml`.
        thickness_m: Thickness of all walls, floors and ceilings, for the slab model of the programs that
            read the scene.

    Returns:
        The XML file.

    Raises:
        ValueError: If the thickness is not positive.
    """
    if not (np.isfinite(thickness_m) and thickness_m > 0):
        raise ValueError(f"thickness_m is {thickness_m}, expected a positive number of metres, such as 0.1.")
    path = Path(path)
    xml = path if path.suffix.lower() == ".xml" else path / "scene.xml"
    xml.unlink(missing_ok=True)
    root = ET.Element("scene", version="2.1.0")
    itu_types = {}
    for material in building.materials:
        if not isinstance(material, str):
            raise ValueError(
                f"the material {material.name!r} is made of layers, which a Mitsuba scene has no form for. Export a "
                "building of materials by name."
            )
        itu_types[material] = ITU_TYPES.get(material, material)
    for itu_type in dict.fromkeys(itu_types.values()):
        bsdf = ET.SubElement(root, "bsdf", type="itu-radio-material", id=f"mat-itu_{itu_type}")
        ET.SubElement(bsdf, "string", name="type", value=itu_type)
        ET.SubElement(bsdf, "float", name="thickness", value=f"{thickness_m:g}")
    for name, itu_type in itu_types.items():
        mesh_name = f"meshes/{name}.ply"
        with whole_file(xml.parent / mesh_name) as partial:
            building.of_material(name).export(partial, file_type="ply")
        shape = ET.SubElement(root, "shape", type="ply", id=f"mesh-{name}")
        ET.SubElement(shape, "string", name="filename", value=mesh_name)
        ET.SubElement(shape, "boolean", name="face_normals", value="true")
        ET.SubElement(shape, "ref", id=f"mat-itu_{itu_type}", name="bsdf")
    ET.indent(root)
    with whole_file(xml) as partial:
        ET.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
    return xml


def _scene(building: Building) -> trimesh.Scene:
    """The faces of each kind as an object by the kind's name, in its colour."""
    scene = trimesh.Scene()
    for number, kind in enumerate(KINDS):
        part = building.submesh(kind)
        if len(part.faces):
            colours = np.tile(KIND_COLOURS[number], (len(part.vertices), 1))
            part.visual = trimesh.visual.ColorVisuals(part, vertex_colors=colours)
            scene.add_geometry(part, node_name=kind, geom_name=kind)
    return scene
