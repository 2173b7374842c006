"""A wall's layers from a YAML file, for whoever has walls that are in no table.

name: insulated
layers:                  # from face to face, the same from both sides
- {material: plasterboard, thickness_m: 0.013}
- {relative_permittivity: 1.2, conductivity_spm: 0.01, thickness_m: 0.06}
- {material: plasterboard, thickness_m: 0.013}
"""

from pathlib import Path

from robosim.support.parts import restored
from robosim.support.reading import reading
from robosim.support.text_in import check_object, parse_yaml
from wireless.em.materials import Layer, Material


def read_material(path: Path) -> Material:
    """A wall of layers from a YAML file; without a name in it, it is called as the file.

    Raises:
        FileError: If the file is damaged, or a layer is none that a wall may have.
    """
    remedy = "Give layers from face to face, such as layers: [{material: glass, thickness_m: 0.006}]."
    with reading(path, "the layers of a wall", remedy) as file:
        keys = check_object(parse_yaml(file.read()), ("layers",))
        if unknown := set(keys) - {"name", "layers"}:
            raise ValueError(f"{min(map(str, unknown))!r} is no key of a wall, expected name and layers")
        if not isinstance(keys["layers"], list):
            raise ValueError("layers is no list")
        layers = tuple(restored(Layer, check_object(layer)) for layer in keys["layers"])
        return Material(str(keys.get("name", path.stem)), layers)
