"""A wall's layers from a YAML file, for whoever has walls that are in no table.

    name: insulated
    layers:                  # from face to face, the same from both sides
      - {material: plasterboard, thickness_m: 0.013}
      - {relative_permittivity: 1.2, conductivity_spm: 0.01, thickness_m: 0.06}
      - {material: plasterboard, thickness_m: 0.013}
    scattering: 0.3          # coefficient S of its faces, if the tracer scatters
    lobe: 4                  # exponent of the scattered lobe

Only `layers` are needed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robosim.support.parts import restored
from robosim.support.reading import reading
from robosim.support.text_in import check_object, parse_yaml
from wireless.em.materials import Layer, Material

#: What may be said of a wall besides its layers.
ROUGHNESS = ("scattering", "lobe")


def read_material(path: Path) -> Material:
    """A wall of layers from a YAML file; without a name in it, it is called as the file.

    Raises:
        FileError: If the file is damaged, or a layer is none that a wall may have.
    """
    remedy = "Give layers from face to face, such as layers: [{material: glass, thickness_m: 0.006}]."
    with reading(path, "the layers of a wall", remedy) as file:
        keys = check_object(parse_yaml(file.read()), ("layers",))
        known = ("name", "layers", *ROUGHNESS)
        if unknown := set(keys) - set(known):
            raise ValueError(f"{min(map(str, unknown))!r} is no key of a wall, expected {', '.join(known)}")
        if not isinstance(keys["layers"], list):
            raise ValueError("layers is no list")
        layers = tuple(restored(Layer, check_object(layer)) for layer in keys["layers"])
        scattering, lobe = (_number(keys, name) for name in ROUGHNESS)
        if lobe is not None and lobe != int(lobe):
            raise ValueError(f"lobe is {lobe}, expected a whole number")
        name = str(keys.get("name", path.stem))
        return Material(name, layers, scattering, None if lobe is None else int(lobe))


def _number(keys: Mapping[str, Any], name: str) -> float | None:
    """A finite number of a key, or a complaint; None without it."""
    value = keys.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
        raise ValueError(f"{name} is {str(value)[:40]!r}, expected a number")
    return value
