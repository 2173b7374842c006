"""Layers of a wall from a YAML file, for walls that no table has.

    name: insulated
    layers:                  # from face to face, the same from both sides
      - {material: plasterboard, thickness_m: 0.013}
      - {relative_permittivity: 1.2, conductivity_spm: 0.01, thickness_m: 0.06}
      - {material: plasterboard, thickness_m: 0.013}
    scattering: 0.3          # coefficient S of its faces, if the tracer scatters
    lobe: 4                  # exponent of the scattered lobe

Only `layers` are needed.
"""

from pathlib import Path

from robosim.support.from_dict import from_dict
from robosim.support.reading import reading
from robosim.support.text_in import check_object, parse_yaml
from wireless.em.materials import Material


def read_material(path: Path) -> Material:
    """A wall of layers from a YAML file; its name is the file's if the file has none in it."""
    remedy = "Give layers from face to face, such as layers: [{material: glass, thickness_m: 0.006}]."
    with reading(path, "the layers of a wall", remedy) as file:
        return from_dict(Material, {"name": path.stem, **check_object(parse_yaml(file.read()))})
