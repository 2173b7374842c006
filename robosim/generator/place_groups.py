"""Furniture of true height, by the kind of room, placed without blocking passages.

The pieces are those of `robosim.generator.furniture_cells`, here as meshes (`robosim.plans.furnishings.pieces`),
several for a table with its chairs. A group is tried at a few random places by the same rules, as if all of it stood on
the floor. It also keeps a distance of a cell to the walls, which may stand half a cell off the drawn ones, and a gap to
other pieces.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool

from robosim.generator.canvas import Canvas, Polygon, Rect
from robosim.generator.furniture_cells import Entry, Space, movables, turn
from robosim.generator.layout import Layout
from robosim.plans.furnishings.furnishing import Furnishing
from robosim.plans.furnishings.pieces import make_piece


class Part(NamedTuple):
    """Piece of a group, in the group's frame: x along the wall, y into the room."""

    piece: str
    """Key of `robosim.plans.furnishings.pieces.PIECES`."""
    sizes: dict[str, Any]
    """Sizes of the piece, `width_m` and `depth_m` among them."""
    x_m: float
    y_m: float
    """Middle of the piece [m]; the wall is at 0."""
    yaw: float = 0.0
    """Rotation of the piece [rad]; at 0 its back is at the wall."""

    def outline(self) -> Polygon:
        """Rectangle of the piece on the floor [m]."""
        width, depth = self.sizes["width_m"], self.sizes.get("depth_m", self.sizes["width_m"])
        corners = Rect(-width / 2, -depth / 2, width / 2, depth / 2).polygon()
        return corners @ turn(self.yaw).T + (self.x_m, self.y_m)


Group = list[Part]
Maker = Callable[[np.random.Generator], Group]


def _one(piece: str, **ranges: tuple[float, float]) -> Maker:
    """Maker of single pieces with sizes from ranges."""

    def make(rng: np.random.Generator) -> Group:
        sizes = {name: round(float(rng.uniform(*limits)), 3) for name, limits in ranges.items()}
        return [Part(piece, sizes, 0.0, sizes.get("depth_m", sizes["width_m"]) / 2)]

    return make


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


#: Makers of groups by the name of the piece in plans of cells; others are left out.
_MAKERS: dict[str, Maker] = {
    "table": _dining,
    "meeting table": _dining,
    "desk": _desk,
    "desks": _desk,
    "bed": _one(
        "bed", width_m=(0.9, 1.8), depth_m=(2.0, 2.15), height_m=(0.42, 0.58), clearance_m=(0.15, 0.3)
    ),
    "sofa": _one("sofa", width_m=(1.5, 2.3), depth_m=(0.85, 0.95), height_m=(0.75, 0.9)),
    "armchair": _one("sofa", width_m=(0.8, 0.95), depth_m=(0.8, 0.9), height_m=(0.75, 0.95)),
    "wardrobe": _one("cupboard", width_m=(0.9, 2.4), depth_m=(0.55, 0.65), height_m=(1.9, 2.3)),
    "shelf": _one("shelf", width_m=(0.6, 1.6), depth_m=(0.25, 0.4), height_m=(0.9, 2.1)),
    "sideboard": _one("cupboard", width_m=(0.9, 1.8), depth_m=(0.4, 0.5), height_m=(0.55, 0.95)),
    "low table": _one(
        "table", width_m=(0.7, 1.2), depth_m=(0.5, 0.8), height_m=(0.38, 0.48), leg_m=(0.04, 0.06)
    ),
    "counter": _one("cupboard", width_m=(1.5, 3.0), depth_m=(0.58, 0.66), height_m=(0.88, 0.94)),
    "machine": _one("cupboard", width_m=(0.6, 0.65), depth_m=(0.6, 0.65), height_m=(0.85, 1.85)),
    "tub": _one("cupboard", width_m=(1.5, 1.8), depth_m=(0.7, 0.8), height_m=(0.5, 0.6)),
    "basin": _one("cupboard", width_m=(0.5, 1.2), depth_m=(0.42, 0.55), height_m=(0.8, 0.9)),
    "toilet": _one("cupboard", width_m=(0.38, 0.42), depth_m=(0.6, 0.7), height_m=(0.42, 0.8)),
    "plant": _one("plant", width_m=(0.3, 0.6), height_m=(0.5, 1.6)),
}

#: Pieces keep this far from each other at least, and a cell from walls [m].
GAP_M = 0.02
#: Places that are tried for a group before it is left out.
TRIES = 20
#: From the drawn wall to what stands at it [m].
_BEHIND_M = 0.08


def place_pieces(
    canvas: Canvas,
    layout: Layout,
    rng: np.random.Generator,
    free: Bool[np.ndarray, "ny nx"],
    *,
    density: float,
    passage_m: float,
) -> list[Furnishing]:
    """Pieces for the rooms of a building without furniture; the canvas is left with their cells solid.

    `free` are the free cells of the plan; other arguments as for `furnish`.
    """
    room_left = _Room(canvas, free)
    pieces: list[Furnishing] = []
    for i, room in enumerate(layout.rooms):
        space = Space(canvas, layout, i, passage_m)
        for entry in movables(room.kind):
            if entry.piece not in _MAKERS:
                continue
            for _ in range(entry.draw_count(rng, room.floor.area, density)):
                pieces += _try(canvas, space, room_left, room.floor, entry, rng)
    return pieces


class _Room:
    """Floor that is not taken yet, in the building's own frame."""

    def __init__(self, canvas: Canvas, free: Bool[np.ndarray, "ny nx"]) -> None:
        self._canvas, self._free = canvas, free
        self._taken: list[shapely.Polygon] = []

    def holds(self, outlines: list[shapely.Polygon]) -> bool:
        """Whether outlines keep their distance to walls and to what is placed already."""
        for outline in shapely.buffer(outlines, self._canvas.resolution_m, join_style="mitre"):
            corners = shapely.get_coordinates(shapely.orient_polygons(outline))[:-1]
            window = self._canvas.window(corners)
            if (self._canvas.cells([corners], window) & ~self._free[window]).any():
                return False
        return not self._taken or not shapely.dwithin(shapely.union_all(outlines), self._taken, GAP_M).any()

    def take(self, outlines: list[shapely.Polygon]) -> None:
        """Mark outlines as taken."""
        self._taken += outlines


def _try(
    canvas: Canvas, space: Space, left: _Room, floor: Rect, entry: Entry, rng: np.random.Generator
) -> list[Furnishing]:
    """Try to place a group along a wall, into a corner or freely in a room; nothing if there is no place."""
    group = _MAKERS[entry.piece](rng)
    corners = np.vstack([piece.outline() for piece in group])
    low, high = corners.min(axis=0), corners.max(axis=0)
    for _ in range(TRIES):
        where = _pose(low, high, floor, entry.place, rng)
        if where is None:
            continue
        origin, angle = where
        footprints = [piece.outline() @ turn(angle).T + origin for piece in group]
        outlines = [shapely.Polygon(polygon) for polygon in footprints]
        if left.holds(outlines) and space.put(footprints):
            left.take(outlines)
            return _placed(canvas, group, origin, angle)
    return []


def _pose(
    low: np.ndarray, high: np.ndarray, floor: Rect, place: str, rng: np.random.Generator
) -> tuple[np.ndarray, float] | None:
    """A random place of a group's origin in the building's frame, and its rotation; None if it does not fit."""
    if place == "free":
        askew = rng.uniform(-0.8, 0.8) if rng.random() < 0.3 else 0.0
        angle = float(rng.integers(4) * np.pi / 2 + askew)
        middle = np.array([rng.uniform(floor.x0, floor.x1), rng.uniform(floor.y0, floor.y1)])
        return middle - (low + high) / 2 @ turn(angle).T, angle
    side = int(rng.choice(4, p=np.array(floor.size * 2) / (2 * sum(floor.size))))
    width, length = high[0] - low[0] + 2 * _BEHIND_M, floor.size[side % 2]
    if length < width:
        return None
    along = rng.uniform(width / 2, length - width / 2)
    if place == "corner":
        along = width / 2 if rng.random() < 0.5 else length - width / 2
    # Along a side of the room, counter-clockwise, the room is on the left: x and y of the group.
    angle = side * np.pi / 2
    start = floor.polygon()[side]
    local = np.array([along - (low[0] + high[0]) / 2, _BEHIND_M - low[1]])
    return start + local @ turn(angle).T, angle


def _placed(canvas: Canvas, group: Group, origin: np.ndarray, angle: float) -> list[Furnishing]:
    made = []
    for piece in group:
        x, y = canvas.to_map(np.array([[piece.x_m, piece.y_m]]) @ turn(angle).T + origin)[0]
        yaw = float(
            np.arctan2(np.sin(canvas.yaw + angle + piece.yaw), np.cos(canvas.yaw + angle + piece.yaw))
        )
        made.append(make_piece(piece.piece, at=(float(x), float(y)), yaw_rad=yaw, **piece.sizes))
    return made
