"""Materials that the command line gives to a Mitsuba scene, and the report of what is read of it."""

from pathlib import Path
from typing import Any

from rich.table import Table

from robosim.commands.output import console, emit_result
from robosim.parts import MATERIAL
from wireless.em.materials import MATERIALS, WALLS, Layer, Material
from wireless.tracing.mitsuba_scene import THICK_M, read_mitsuba


def scene_materials(words: tuple[str, ...]) -> dict[str, str | Material]:
    """Materials by their names in a scene, of words NAME=MATERIAL; those of ITU-R P.2040 are slabs of `THICK_M`.

    ValueError if a word is none, or there is no such material.
    """
    materials: dict[str, str | Material] = {}
    for word in words:
        name, equals, material = word.rpartition("=")
        if not equals or not name or name in materials:
            raise ValueError(
                f"scene_material is {word!r}, expected NAME=MATERIAL, each name once, such as m1=glass."
            )
        if material in MATERIALS:
            materials[name] = Material(name, (Layer(thickness_m=THICK_M, material=material),))
        else:
            materials[name] = WALLS.get(material) or MATERIAL.make(material, field="scene_material")
    return materials


def inspect_scene(
    path: Path, materials: dict[str, str | Material], frequency_hz: float, *, allow_large: bool
) -> None:
    """Print shapes, triangles, and the permittivity, conductivity and thickness of materials at a frequency.

    FileError or ValueError if the scene cannot be read, or a material is unknown at this frequency.
    """
    scene = read_mitsuba(path, materials, allow_large=allow_large)
    properties: dict[str, dict[str, Any]] = {}
    names = dict.fromkeys(material for _, _, material in scene.shapes)
    for name, material in zip(names, scene.materials, strict=True):
        assert isinstance(material, Material)
        values = *material.properties(frequency_hz), sum(layer.thickness_m for layer in material.layers)
        keys = "relative_permittivity", "conductivity_spm", "thickness_m"
        properties[name] = dict(zip(keys, values, strict=True)) | {"scattering": material.scattering}
    shapes = [{"shape": shape, "triangles": n, "material": name} for shape, n, name in scene.shapes]
    result = {
        "scene": path.stem,
        "frequency_hz": frequency_hz,
        "bounds_m": scene.mesh.bounds,
        "shapes": shapes,
    }
    emit_result(result | {"materials": properties, "assumed": scene.notes})
    table = Table("shape", "triangles", "material", "permittivity", "conductivity [S/m]", "thickness [m]")
    for shape, n, name in scene.shapes:
        table.add_row(shape, str(n), name, *(f"{value:.4g}" for value in [*properties[name].values()][:3]))
    console.print(table)
    low, high = scene.mesh.bounds.round(3)
    console.print(f"{path.stem} from {low} to {high} m, at {frequency_hz / 1e9:g} GHz")
    for note in scene.notes:
        console.print(f"Assumed: {note}")
