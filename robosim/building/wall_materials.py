"""Materials of walls, if a plan has them cell by cell: a wall has that of the cells behind it.

Walls are cut where that changes, so that each has one material. All is in cell coordinates (column, row).
"""

from itertools import pairwise

import numpy as np
import shapely
from jaxtyping import Float, Int

from robosim.building.rings import polygons_of, rings_of
from robosim.plans.floorplan import FloorPlan

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
    found = np.zeros(len(points), np.int64)
    ny, nx = plan.shape
    for far in _BEHIND:
        ix, iy = np.floor(points + far * right).astype(int).T
        inside = (ix >= 0) & (iy >= 0) & (ix < nx) & (iy < ny)
        here = np.zeros(len(points), np.int64)
        here[inside] = plan.material[iy[inside], ix[inside]]
        found = np.where(found == 0, here, found)
    return found
