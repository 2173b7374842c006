"""The storeys of a building's mesh: large level surfaces that face up, with walls above them.

Heights are found where most upward-facing area lies within a decimetre or so. Tables, beds and steps are
too small, and whatever lies less than a storey above or below a larger surface is taken for a part of the
same storey. A roof faces up too, but no walls stand on it.
Left out: split levels less than a storey apart are one storey, of which only the larger part counts.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.plans.formats.mesh_raster import blocks

#: Surfaces less steep than this are floors, ceilings or table tops (cosine of 45 degrees).
LEVEL_COSINE = 0.7
#: Heights within this belong to one floor, scanned with noise [m].
_SPREAD_M = 0.1
#: Storeys are at least this far apart [m].
_STOREY_M = 1.8
#: The smallest floor, as a share of the largest one.
_SMALLEST_SHARE = 0.2
#: More are none of a building.
_MOST_STOREYS = 300


@dataclass(frozen=True, kw_only=True)
class Storey:
    """One floor of a building."""

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


def find_storeys(triangles: Float[np.ndarray, "n 3 3"], low_m: float, high_m: float) -> list[Storey]:
    """Floors of a mesh with z upwards, the lowest first.

    Args:
        triangles: Corners [m], counter-clockwise seen from the front.
        low_m: Height above a floor from which on walls are measured [m].
        high_m: Height up to which they are [m].

    Raises:
        ValueError: If there are more than any building has.
    """
    heights, areas, walls = _surfaces(triangles)
    order = np.argsort(heights)
    heights, areas = heights[order], areas[order]
    before = np.concatenate([[0.0], np.cumsum(areas)])
    around = _within(before, heights, heights, _SPREAD_M)
    storeys: list[Storey] = []
    left = np.ones(len(heights), bool)
    while left.any():
        best = int(np.argmax(np.where(left, around, -1.0)))
        if around[best] <= (_SMALLEST_SHARE * storeys[0].area_m2 if storeys else 0.0):
            break
        height = _weighted_median(heights, areas, heights[best])
        walls_m = walls.length_m(height + low_m, height + high_m)
        if len(storeys) == _MOST_STOREYS:
            raise ValueError(f"more than {_MOST_STOREYS} storeys")
        storeys.append(Storey(height_m=height, area_m2=float(around[best]), walls_m=walls_m))
        left &= np.abs(heights - heights[best]) >= _STOREY_M
    return sorted(storeys, key=lambda storey: storey.height_m)


def _within(
    before: Float[np.ndarray, " n1"],
    heights: Float[np.ndarray, " n"],
    at: Float[np.ndarray, " m"],
    spread_m: float,
) -> Float[np.ndarray, " m"]:
    """Area at heights less than a spread from given ones, out of running sums of sorted heights."""
    last = np.searchsorted(heights, at + spread_m, side="right")
    return before[last] - before[np.searchsorted(heights, at - spread_m, side="left")]


def _weighted_median(heights: Float[np.ndarray, " n"], areas: Float[np.ndarray, " n"], at: float) -> float:
    """Height that halves the area within a spread of `at`."""
    near = np.abs(heights - at) <= _SPREAD_M
    sums = np.cumsum(areas[near])
    return float(heights[near][np.searchsorted(sums, sums[-1] / 2)])


class _Walls(NamedTuple):
    """Surfaces that are not level."""

    area_m2: Float[np.ndarray, " n"]
    low_m: Float[np.ndarray, " n"]
    high_m: Float[np.ndarray, " n"]

    def length_m(self, low: float, high: float) -> float:
        """Length of walls between two heights: their area there over the height."""
        shared = np.clip(np.minimum(self.high_m, high) - np.maximum(self.low_m, low), 0, None)
        tall = np.maximum(self.high_m - self.low_m, 1e-9)
        return float((self.area_m2 * shared / tall).sum() / (high - low))


def _surfaces(
    triangles: Float[np.ndarray, "n 3 3"],
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], _Walls]:
    """Heights and areas of what faces up, and the walls."""
    heights, areas, walls = [], [], []
    for block in blocks(triangles):
        normals = np.cross(block[:, 1] - block[:, 0], block[:, 2] - block[:, 0])
        length = np.linalg.norm(normals, axis=1)
        cosine = np.divide(normals[:, 2], length, out=np.zeros_like(length), where=length > 0)
        up, wall = cosine > LEVEL_COSINE, np.abs(cosine) < LEVEL_COSINE
        heights.append(block[up, :, 2].mean(axis=1))
        areas.append(normals[up, 2] / 2)
        z = block[wall, :, 2]
        walls.append(np.stack([length[wall] / 2, z.min(axis=1), z.max(axis=1)]))
    return np.concatenate(heights), np.concatenate(areas), _Walls(*np.concatenate(walls, axis=1))
