"""Placing furniture of true height, without blocking passages.

A group is tried at a few random places by the rules of `robosim.generator.place_cells`, as if all of it stood on the
floor. It also keeps a distance of a cell to the walls, which may stand half a cell off those that were drawn, and a gap
to other pieces.
"""

import numpy as np
import shapely
from jaxtyping import Bool

from robosim.generator.canvas import Canvas
from robosim.generator.furniture_cells import Entry, turn
from robosim.generator.furniture_groups import Group, entries
from robosim.generator.layout import Layout
from robosim.generator.place_cells import Space
from robosim.generator.rect import Rect
from robosim.plans.furnishings.furnishing import Furnishing
from robosim.plans.furnishings.pieces import make_piece

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
    found: list[Furnishing] = []
    for i, room in enumerate(layout.rooms):
        space = Space(canvas, layout, i, passage_m)
        for entry in entries(room.kind):
            for _ in range(entry.draw_count(rng, room.floor.area, density)):
                found += _try(canvas, space, room_left, room.floor, entry, rng)
    return found


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
    group = entry.make(rng)
    corners = np.vstack([part.outline() for part in group])
    low, high = corners.min(axis=0), corners.max(axis=0)
    for _ in range(TRIES):
        where = _pose(low, high, floor, entry.place, rng)
        if where is None:
            continue
        origin, angle = where
        own = [part.outline() @ turn(angle).T + origin for part in group]
        outlines = [shapely.Polygon(polygon) for polygon in own]
        if left.holds(outlines) and space.put(own):
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
    for part in group:
        x, y = canvas.to_map(np.array([[part.x_m, part.y_m]]) @ turn(angle).T + origin)[0]
        yaw = float(np.arctan2(np.sin(canvas.yaw + angle + part.yaw), np.cos(canvas.yaw + angle + part.yaw)))
        made.append(make_piece(part.piece, at=(float(x), float(y)), yaw_rad=yaw, **part.sizes))
    return made
