"""Materials of walls: materials that a plan has cell by cell, and layers of a wall from a YAML file.

A wall has the material of the cells behind it. Walls are cut where that changes, so that each has one material. All
is in cell coordinates (column, row).

A file of layers is for walls that no table has:

    name: insulated
    layers:                  # from face to face, the same from both sides
      - {material: plasterboard, thickness_m: 0.013}
      - {relative_permittivity: 1.2, conductivity_spm: 0.01, thickness_m: 0.06}
      - {material: plasterboard, thickness_m: 0.013}
    scattering: 0.3          # coefficient S of its faces, if the tracer scatters
    lobe: 4                  # exponent of the scattered lobe

Only `layers` are needed.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float, Int

from robosim.building.extrusion import polygons_of, rings_of
from robosim.plans.floorplan import FloorPlan
from robosim.support.from_dict import from_dict
from robosim.support.reading import reading
from robosim.support.text_in import check_object, parse_yaml
from wireless.em.materials import Material

#: Samples of a wall per cell, and distances behind it [cells]: the first cell with a material counts.
_PLACES, _BEHIND = 4, (0.3, 0.6, 0.9)


def cut_at_materials(free: shapely.MultiPolygon, plan: FloorPlan) -> shapely.MultiPolygon:
    """Free polygons, outer rings counter-clockwise, with a corner wherever the material of a wall changes."""
    rings, owner = rings_of(free)
    points = []
    for ring in rings:
        pieces = []
        for a, b in pairwise(shapely.get_coordinates(ring)):
            count = max(1, round(_PLACES * float(np.hypot(*(b - a)))))
            along = (np.arange(count) + 0.5) / count
            kind = materials_behind(plan, a + along[:, None] * (b - a), b - a)
            cuts = (np.flatnonzero(np.diff(kind)) + 1) / count
            pieces.append(np.vstack([a, a + cuts[:, None] * (b - a)]))
        points.append(np.concatenate(pieces))
    return polygons_of(points, owner)


def materials_behind(
    plan: FloorPlan, points: Float[np.ndarray, "n 2"], along: Float[np.ndarray, "*n 2"]
) -> Int[np.ndarray, " n"]:
    """Number of the plan's material behind places on walls, 0 for none; free space is on the left of `along`."""
    assert plan.material is not None
    right = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    right = np.broadcast_to(right / np.linalg.norm(right, axis=-1, keepdims=True), points.shape)
    material = np.zeros(len(points), np.int64)
    ny, nx = plan.shape
    for far in _BEHIND:
        ix, iy = np.floor(points + far * right).astype(int).T
        inside = (ix >= 0) & (iy >= 0) & (ix < nx) & (iy < ny)
        here = np.zeros(len(points), np.int64)
        here[inside] = plan.material[iy[inside], ix[inside]]
        material = np.where(material == 0, here, material)
    return material


def read_material(path: Path) -> Material:
    """A wall of layers from a YAML file; its name is the file's if the file has none in it."""
    remedy = "Give layers from face to face, such as layers: [{material: glass, thickness_m: 0.006}]."
    with reading(path, "the layers of a wall", remedy) as file:
        return from_dict(Material, {"name": path.stem, **check_object(parse_yaml(file.read()))})
