"""Furniture of true height, by the kind of room: the same pieces as in `robosim.generator.furniture_cells`.

There they are cells up to the ceiling, here meshes (`robosim.plans.furnishings.pieces`), several for a table with its
chairs, in sizes that shops sell.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from robosim.generator.furniture_cells import Entry, turn
from robosim.generator.rect import Polygon, Rect


class Part(NamedTuple):
    """One piece of a group, in the group's frame: x along the wall, y into the room."""

    piece: str
    """One of `robosim.plans.furnishings.pieces.PIECES`."""
    sizes: dict[str, Any]
    """Its sizes, `width_m` and `depth_m` among them."""
    x_m: float
    y_m: float
    """Its middle [m]; the wall is at 0."""
    yaw: float = 0.0
    """Its rotation [rad]; its back is at the wall without."""

    def outline(self) -> Polygon:
        """Its rectangle on the floor [m]."""
        width, depth = self.sizes["width_m"], self.sizes.get("depth_m", self.sizes["width_m"])
        corners = Rect(-width / 2, -depth / 2, width / 2, depth / 2).polygon()
        return corners @ turn(self.yaw).T + (self.x_m, self.y_m)


Group = list[Part]
Maker = Callable[[np.random.Generator], Group]


def entries(kind: str) -> list[Entry]:
    """Furniture of a kind of room in the order in which it is placed: large pieces first."""
    return _BY_KIND[kind] + _SMALL


def _one(piece: str, **ranges: tuple[float, float]) -> Maker:
    """Maker of single pieces with sizes from ranges."""

    def make(rng: np.random.Generator) -> Group:
        sizes = {name: round(float(rng.uniform(*limits)), 3) for name, limits in ranges.items()}
        return [_at_wall(piece, sizes)]

    return make


def _at_wall(piece: str, sizes: dict[str, Any]) -> Part:
    return Part(piece, sizes, 0.0, sizes.get("depth_m", sizes["width_m"]) / 2)


def _chair(rng: np.random.Generator, x: float, y: float, yaw: float) -> Part:
    """A chair, a little askew."""
    x, y = x + rng.uniform(-0.03, 0.03), y + rng.uniform(-0.05, 0.05)
    return Part("chair", {"width_m": 0.42, "depth_m": 0.42}, x, y, yaw + rng.uniform(-0.3, 0.3))


def _dining(rng: np.random.Generator) -> Group:
    """A table with chairs on both sides."""
    width, depth = round(rng.uniform(1.2, 2.0), 3), round(rng.uniform(0.75, 0.95), 3)
    n = int(width / 0.6)
    away = 0.33  # from the table's edge to a chair's middle, so that none stands in another
    group = [Part("table", {"width_m": width, "depth_m": depth, "height_m": 0.74}, 0.0, away + depth / 2)]
    for k in range(n):
        x = (k - (n - 1) / 2) * 0.6
        for y, yaw in ((0.0, 0.0), (2 * away + depth, np.pi)):
            if rng.random() < 0.85:
                group.append(_chair(rng, x, y, yaw))
    return group


def _desk(rng: np.random.Generator) -> Group:
    width, depth = round(rng.uniform(1.1, 1.7), 3), round(rng.uniform(0.6, 0.8), 3)
    table = {"width_m": width, "depth_m": depth, "height_m": 0.73, "leg_m": 0.05}
    return [Part("table", table, 0.0, depth / 2), _chair(rng, rng.uniform(-0.2, 0.2), depth + 0.32, np.pi)]


_BED = _one("bed", width_m=(0.9, 1.8), depth_m=(2.0, 2.15), height_m=(0.42, 0.58), clearance_m=(0.15, 0.3))
_SOFA = _one("sofa", width_m=(1.5, 2.3), depth_m=(0.85, 0.95), height_m=(0.75, 0.9))
_ARMCHAIR = _one("sofa", width_m=(0.8, 0.95), depth_m=(0.8, 0.9), height_m=(0.75, 0.95))
_WARDROBE = _one("cupboard", width_m=(0.9, 2.4), depth_m=(0.55, 0.65), height_m=(1.9, 2.3))
_SHELF = _one("shelf", width_m=(0.6, 1.6), depth_m=(0.25, 0.4), height_m=(0.9, 2.1))
_SIDEBOARD = _one("cupboard", width_m=(0.9, 1.8), depth_m=(0.4, 0.5), height_m=(0.55, 0.95))
_LOW_TABLE = _one("table", width_m=(0.7, 1.2), depth_m=(0.5, 0.8), height_m=(0.38, 0.48), leg_m=(0.04, 0.06))
_COUNTER = _one("cupboard", width_m=(1.5, 3.0), depth_m=(0.58, 0.66), height_m=(0.88, 0.94))
_MACHINE = _one("cupboard", width_m=(0.6, 0.65), depth_m=(0.6, 0.65), height_m=(0.85, 1.85))
_TUB = _one("cupboard", width_m=(1.5, 1.8), depth_m=(0.7, 0.8), height_m=(0.5, 0.6))
_BASIN = _one("cupboard", width_m=(0.5, 1.2), depth_m=(0.42, 0.55), height_m=(0.8, 0.9))
_TOILET = _one("cupboard", width_m=(0.38, 0.42), depth_m=(0.6, 0.7), height_m=(0.42, 0.8))
_PLANT = _one("plant", width_m=(0.3, 0.6), height_m=(0.5, 1.6))
_BOX = _one("cupboard", width_m=(0.25, 0.5), depth_m=(0.2, 0.45), height_m=(0.2, 0.6))

_SMALL = [Entry(_PLANT, "corner", per_10_m2=0.25), Entry(_BOX, "wall", per_10_m2=0.6)]
_BY_KIND = {
    "bedroom": [
        Entry(_BED, "wall", each=1),
        Entry(_WARDROBE, "corner", each=1),
        Entry(_SIDEBOARD, "wall", each=0.7),
        Entry(_desk, "wall", each=0.5),
    ],
    "living": [
        Entry(_SOFA, "wall", each=1, per_10_m2=0.15),
        Entry(_LOW_TABLE, "free", each=0.7),
        Entry(_SIDEBOARD, "wall", each=1),
        Entry(_ARMCHAIR, "wall", per_10_m2=0.5),
        Entry(_SHELF, "wall", per_10_m2=0.8),
        Entry(_dining, "free", per_10_m2=0.25),
    ],
    "dining": [
        Entry(_dining, "free", each=1),
        Entry(_SIDEBOARD, "wall", each=1),
        Entry(_SHELF, "wall", each=0.5),
    ],
    "kitchen": [
        Entry(_COUNTER, "corner", each=1),
        Entry(_COUNTER, "wall", each=0.6),
        Entry(_MACHINE, "corner", each=1),
        Entry(_dining, "free", per_10_m2=0.4),
    ],
    "bath": [
        Entry(_TUB, "corner", each=1),
        Entry(_BASIN, "wall", each=1),
        Entry(_TOILET, "wall", each=1),
        Entry(_MACHINE, "corner", each=0.4),
    ],
    "hall": [Entry(_SHELF, "wall", per_10_m2=0.8)],
    "storage": [Entry(_SHELF, "wall", each=1, per_10_m2=1.5)],
    "office": [Entry(_desk, "wall", each=1, per_10_m2=0.8), Entry(_SHELF, "wall", each=1)],
    "meeting": [Entry(_dining, "free", each=1), Entry(_SIDEBOARD, "wall", each=1)],
    "open office": [Entry(_desk, "free", per_10_m2=0.9), Entry(_SHELF, "wall", per_10_m2=0.8)],
}
