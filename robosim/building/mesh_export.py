"""A building in files for other programs: meshes, and scenes for Mitsuba, Sionna RT and DiffeRT.

Mesh files are in the `map` frame, metres, z up. GLB is y-up by its standard (glTF 2.0, section 3.4): there a
point (x, y, z) of `map` becomes (x, z, -y), as viewers expect.

A Mitsuba scene is an XML file with one PLY file per radio material (z up, as in Sionna RT's own scenes) and a
BSDF of the plugin `itu-radio-material` for each, of Recommendation ITU-R P.2040, which Sionna RT registers with
Mitsuba and DiffeRT reads by itself. The two programs know slabs of these materials only: a half-space becomes a slab
too thick to be seen through, layers become the slab of their outer material that reflects most like them, drywall
becomes plasterboard, whose newer fit is 2.73 instead of 2.94. `itu_slab` computes what that changes.

Left out: textures; coordinates are stored with 32 bits, as these formats do.
"""

import difflib
import xml.etree.ElementTree as ET
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Complex, Float
from scipy.constants import speed_of_light

from robosim.building.extrusion import KINDS, PLACED, Faces
from robosim.support.files import whole_file
from wireless.em.fresnel import fresnel
from wireless.em.materials import WALLS, Material, wall_row

#: Colour of each kind of face (red, green, blue, opacity), in the order of `KINDS`.
KIND_COLOURS = np.array(
    [
        [214, 209, 196, 255],
        [143, 107, 77, 255],
        [238, 238, 242, 255],
        [94, 129, 172, 255],
        [166, 124, 82, 255],
    ],
    np.uint8,
)

SUFFIXES = (".glb", ".ply", ".obj", ".stl")

#: Names of materials in Recommendation ITU-R P.2040 that differ from ours.
ITU_TYPES = {"drywall": "plasterboard"}
#: Thickness of a slab that stands for a half-space [m], and those that layers are compared with.
THICK_M = 1.0
SLABS_M = np.arange(2, 301) / 1000
#: Angles of incidence at which walls are compared [rad].
INCIDENCE_RAD = np.radians(np.arange(0, 86, 5))

#: From `map` (z up) to glTF (y up).
T_GLTF_MAP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def export_mesh(building: Faces, path: Path) -> Path:
    """Write the mesh of a building as GLB, PLY, OBJ or STL, by the path's suffix, whole or not at all.

    GLB and OBJ have an object for each kind of face, and for each placed thing, with its colour; PLY has coloured faces
    on shared vertices; STL has no colours.
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
            colours = KIND_COLOURS[building.face_kind]
            if building.furnishings:
                colours_of_faces = [
                    np.tile((*furnishing.colour, 255), (len(furnishing.bodies.faces), 1))
                    for furnishing in building.furnishings
                ]
                colours[building.face_kind == PLACED] = np.concatenate(colours_of_faces)
            content.visual = trimesh.visual.ColorVisuals(content, face_colors=colours)
    with whole_file(path) as partial:
        content.export(partial, file_type=suffix[1:])
    return path


class ItuSlab(NamedTuple):
    """A slab of a material of Recommendation ITU-R P.2040 that stands for one of ours."""

    itu_type: str
    thickness_m: float
    off_db: float
    """Root mean square difference of reflections, for both polarisations and incidence to 85 degrees [dB]."""


@lru_cache
def itu_slab(material: str | Material, frequency_hz: float) -> ItuSlab:
    """The slab that reflects most like a wall at a carrier frequency; a wall without layers is a half-space.

    Raises:
        ValueError: If its outer layer is of no material of the table, or none that was measured at this frequency.
    """
    layers = WALLS.get(material) if isinstance(material, str) else material
    outer = material if layers is None else layers.layers[0].material
    if not isinstance(outer, str):
        raise ValueError(
            f"the outer layer of {str(material)!r} has a permittivity of its own, which a Mitsuba scene of ITU "
            "materials has no form for. Export a building of materials by name."
        )
    itu_type = ITU_TYPES.get(outer, outer)
    wanted = _reflected_db(wall_row(material, frequency_hz), frequency_hz)
    best = ItuSlab(itu_type, THICK_M, np.inf)
    for thickness_m in SLABS_M if layers is not None else (THICK_M,):
        row = wall_row(itu_type, frequency_hz, float(thickness_m))
        off_db = float(np.sqrt(np.mean((_reflected_db(row, frequency_hz) - wanted) ** 2)))
        if off_db < best.off_db:
            best = ItuSlab(itu_type, float(thickness_m), off_db)
    return best


def _reflected_db(row: Complex[np.ndarray, " l"], frequency_hz: float) -> Float[np.ndarray, "n 2"]:
    """Power that a wall reflects at each incidence, TE and TM, of which less than -40 dB counts as that."""
    wavenumber = 2 * np.pi * frequency_hz / speed_of_light
    ratios = np.array([fresnel(np.cos(angle), row, wavenumber)[:2] for angle in INCIDENCE_RAD])
    return 20 * np.log10(np.maximum(np.abs(ratios), 0.01))


def export_mitsuba(building: Faces, path: Path, *, frequency_hz: float = 28e9) -> Path:
    """Write a building as a Mitsuba 3 scene with ITU radio materials, and its meshes in the folder `meshes` next to it.

    Each file appears whole or not at all, the XML last: where there is one, all its meshes are there.

    Args:
        building: What to write.
        path: XML file, or folder in which to write `scene.xml`; the XML file is returned.
        frequency_hz: Frequency at which the walls reflect alike [Hz].

    Raises:
        ValueError: If the building has a material that no ITU material can stand for.
    """
    slabs = {str(material): itu_slab(material, frequency_hz) for material in building.materials}
    path = Path(path)
    xml = path if path.suffix.lower() == ".xml" else path / "scene.xml"
    xml.unlink(missing_ok=True)
    root = ET.Element("scene", version="2.1.0")
    for name, slab in slabs.items():
        bsdf = ET.SubElement(root, "bsdf", type="itu-radio-material", id=f"mat-{name}")
        ET.SubElement(bsdf, "string", name="type", value=slab.itu_type)
        ET.SubElement(bsdf, "float", name="thickness", value=f"{slab.thickness_m:g}")
    for name in slabs:
        mesh_name = f"meshes/{name}.ply"
        with whole_file(xml.parent / mesh_name) as partial:
            building.of_material(name).export(partial, file_type="ply")
        # Sionna RT has one list of names for shapes and materials.
        shape = ET.SubElement(root, "shape", type="ply", id=f"mesh-{name}_surfaces")
        ET.SubElement(shape, "string", name="filename", value=mesh_name)
        ET.SubElement(shape, "boolean", name="face_normals", value="true")
        ET.SubElement(shape, "ref", id=f"mat-{name}", name="bsdf")
    ET.indent(root)
    with whole_file(xml) as partial:
        ET.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
    return xml


def _scene(building: Faces) -> trimesh.Scene:
    """The faces of each kind as an object by the kind's name, in its colour; each placed thing as one of its own."""
    scene = trimesh.Scene()
    parts = [(kind, building.submesh(kind), KIND_COLOURS[n]) for n, kind in enumerate(KINDS[:PLACED])]
    for number, furnishing in enumerate(building.furnishings, 1):
        mesh = trimesh.Trimesh(furnishing.bodies.vertices, furnishing.bodies.faces, process=False)
        parts.append((f"{number} {furnishing.name}", mesh, np.array([*furnishing.colour, 255], np.uint8)))
    for name, shape, colour in parts:
        if len(shape.faces):
            shape.visual = trimesh.visual.ColorVisuals(
                shape, vertex_colors=np.tile(colour, (len(shape.vertices), 1))
            )
            scene.add_geometry(shape, node_name=name, geom_name=name)
    return scene
