"""Floors of a building's mesh: large level surfaces below free air, with walls above them.

A floor is a height with much level area within a decimetre or so that has free air above, whatever its orientation:
many files have faces of any orientation, and closed boxes for rooms. Undersides of slabs have no air above them.
Surfaces that cover little of the mesh are no floor, such as the ground below walls alone. Tables, beds and steps are
too small, and surfaces less than a storey above or below a larger one belong to the same storey. A roof has air above
it too, but no walls stand on it.
Left out: split levels less than a storey apart are one storey, of which only the larger part counts.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float, Int

from robosim.plans.formats.raster import AT_ONCE, blocks
from robosim.support.ray_casting import make_ray_scene

#: Surfaces less steep than this are floors, ceilings or table tops (cosine of 45 degrees).
LEVEL_COSINE = 0.7
#: Heights within this belong to one floor, scanned with noise [m].
_SPREAD_M = 0.1
#: Storeys are at least this far apart [m].
_STOREY_M = 1.8
#: The smallest floor, as a share of the largest one.
_SMALLEST_SHARE = 0.2
#: Least share of the convex hull of its own corners, and of that of the mesh, that a floor covers: the ground that
#: walls stand on covers a seventh of the former, a table far less of the latter.
_LEAST_OF_OWN, _LEAST_OF_ALL = 0.25, 0.1
#: Points from which rays go up: per square metre, and in all; and their height above the surface [m].
_RAYS_PER_M2, _MOST_RAYS, _OFF_M = 10.0, 200_000, 0.01
#: Most storeys of a building.
_MOST_STOREYS = 300


@dataclass(frozen=True, kw_only=True)
class MeshFloor:
    """One floor of a building in a mesh."""

    height_m: float
    """Height of the floor, in the mesh's own coordinates [m]."""
    area_m2: float
    """Area of the floor [m2]."""
    walls_m: float
    """Length of the walls above it, both sides counted [m]."""

    @property
    def has_walls(self) -> bool:
        """Whether walls stand on it: at least a quarter of what a square room of its area has."""
        return self.walls_m >= self.area_m2**0.5


def find_floors(triangles: Float[np.ndarray, "n 3 3"], low_m: float, high_m: float) -> list[MeshFloor]:
    """Floors of a mesh with z upwards, the lowest first; walls are measured between two heights above a floor [m]."""
    level, walls = _surfaces(triangles)
    order = np.argsort(triangles[level, :, 2].mean(axis=1), kind="stable")
    level = level[order]
    heights, air = triangles[level, :, 2].mean(axis=1), area_below_air(triangles, level, high_m)
    a, b = triangles[level, 1] - triangles[level, 0], triangles[level, 2] - triangles[level, 0]
    facing = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    first = np.searchsorted(heights, heights - _SPREAD_M, side="left")
    last = np.searchsorted(heights, heights + _SPREAD_M, side="right")
    sums = (np.append(0.0, np.cumsum(area)) for area in (air, np.maximum(facing, 0), np.maximum(-facing, 0)))
    around, up, down = (before[last] - before[first] for before in sums)
    whole = shapely.MultiPoint(triangles[:, :, :2].reshape(-1, 2)).convex_hull.area
    storeys: list[MeshFloor] = []
    left = air > 0
    while left.any():
        best = int(np.argmax(np.where(left, around, -1.0)))
        if around[best] <= (_SMALLEST_SHARE * storeys[0].area_m2 if storeys else 0.0):
            break
        near = np.abs(heights - heights[best]) <= _SPREAD_M
        left &= np.abs(heights - heights[best]) >= _STOREY_M
        hull_m2 = shapely.MultiPoint(triangles[level[near], :, :2].reshape(-1, 2)).convex_hull.area
        if around[best] < max(_LEAST_OF_OWN * hull_m2, _LEAST_OF_ALL * whole):
            continue
        air_near = np.cumsum(air[near])
        height = float(heights[near][np.searchsorted(air_near, air_near[-1] / 2)])  # halves the area
        walls_m = _walls_m(walls, height + low_m, height + high_m)
        if len(storeys) == _MOST_STOREYS:
            raise ValueError(f"more than {_MOST_STOREYS} storeys")
        storeys.append(MeshFloor(height_m=height, area_m2=float(max(up[best], down[best])), walls_m=walls_m))
    return sorted(storeys, key=lambda floor: floor.height_m)


def area_below_air(
    triangles: Float[np.ndarray, "n 3 3"], which: Int[np.ndarray, " k"], high_m: float
) -> Float[np.ndarray, " k"]:
    """Area of some triangles with nothing above them up to a height, seen from above [m2].

    Rays go up from points spread over each triangle, about one per tenth of a square metre, at most `_MOST_RAYS`.
    """
    corner = triangles[which]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    per_m2 = min(_RAYS_PER_M2, _MOST_RAYS / max(float(area.sum()), 1e-9))
    n_rays = np.maximum(np.ceil(area * per_m2), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(which)), n_rays)
    # Evenly spread: multiples of the plastic number's powers (M. Roberts' R2 sequence), folded into the triangle.
    share = np.outer(np.arange(len(owner)) + 0.5, [0.7548776662, 0.5698402910]) % 1
    share = np.where(share.sum(axis=1, keepdims=True) > 1, 1 - share, share)
    middle = triangles.reshape(-1, 3).mean(axis=0)
    origin = corner[owner, 0] - middle + share[:, :1] * a[owner] + share[:, 1:] * b[owner]
    origin[:, 2] += _OFF_M
    scene = make_ray_scene(triangles - middle)
    upwards = np.tile(np.array([0, 0, 1], np.float32), (len(origin), 1))
    free = scene.run(origin.astype(np.float32), upwards, output=True)["tfar"] > high_m
    return area * np.bincount(owner, free, len(which)) / n_rays


def _surfaces(
    triangles: Float[np.ndarray, "n 3 3"],
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, "3 k"]]:
    """Mask of level triangles; area [m2], lowest and highest point [m] of the walls."""
    level, walls = [], []
    for first, block in zip(itertools.count(0, AT_ONCE), blocks(triangles), strict=False):
        normals = np.cross(block[:, 1] - block[:, 0], block[:, 2] - block[:, 0])
        length = np.linalg.norm(normals, axis=1)
        cosine = np.abs(np.divide(normals[:, 2], length, out=np.zeros_like(length), where=length > 0))
        level.append(first + np.flatnonzero(cosine > LEVEL_COSINE))
        wall = cosine < LEVEL_COSINE
        z = block[wall, :, 2]
        walls.append(np.stack([length[wall] / 2, z.min(axis=1), z.max(axis=1)]))
    return np.concatenate(level), np.concatenate(walls, axis=1)


def _walls_m(walls: Float[np.ndarray, "3 k"], low: float, high: float) -> float:
    """Length of walls between two heights: their area there over the height [m]."""
    area_m2, low_m, high_m = walls
    shared = np.clip(np.minimum(high_m, high) - np.maximum(low_m, low), 0, None)
    return float((area_m2 * shared / np.maximum(high_m - low_m, 1e-9)).sum() / (high - low))
