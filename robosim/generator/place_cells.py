"""Placing furniture as cells, without blocking passages.

A piece is tried at a few random places, along a wall, in a corner or freely. It stays where it overlaps nothing, does
not reach into doorways, and leaves the places of a disk of the passages' width connected to all doors of the room. If
no such place is found, it is left out.
"""

from collections.abc import Callable

import cv2
import numpy as np

from robosim.generator.canvas import Canvas, Rect, Window, fits, points_along
from robosim.generator.furniture_cells import Entry, Piece, box, entries, turn
from robosim.generator.layout import Layout, Opening

#: Places that are tried for a piece before it is left out.
TRIES = 5
#: Share of a room's places that furniture leaves at least.
LEAST_SHARE = 0.15
#: Depth of floor before a door that stays empty [m].
DOORWAY_M = 0.6


def furnish(
    canvas: Canvas,
    layout: Layout,
    rng: np.random.Generator,
    *,
    density: float,
    passage_m: float,
    things: Callable[[str], list[Entry]] = entries,
) -> None:
    """Place furniture, `things` of a kind of room, in the rooms of a building on a canvas.

    `density` is the share of the usual furniture, above 1 for crowded rooms. Passages of `passage_m` stay free.
    """
    for i, room in enumerate(layout.rooms):
        space = Space(canvas, layout, i, passage_m)
        for opening in layout.openings:
            if opening.is_door and opening.rooms[0] == i and rng.random() < 0.4 * min(density, 1.0):
                space.put(_door_leaf(rng, opening), keep_doorways=False)
        for entry in things(room.kind):
            for _ in range(entry.draw_count(rng, room.floor.area, density)):
                _place(space, room.floor, entry, rng)


class Space:
    """The cells of one room, in which pieces may be placed. Arrays cover the room's window."""

    def __init__(self, canvas: Canvas, layout: Layout, i: int, passage_m: float) -> None:
        own = [layout.rooms[i].floor.polygon()] + [floor for room, floor in layout.recesses if room == i]
        openings = [opening for opening in layout.openings if i in opening.rooms]
        holes = [opening.hole.polygon() for opening in openings]
        thresholds = [opening.threshold(DOORWAY_M).polygon() for opening in openings]
        self._canvas = canvas
        self._radius = passage_m / 2 / canvas.resolution_m
        self._window = canvas.window(np.vstack(own + holes), passage_m)
        self._free = canvas.free[self._window]  # a view: what is made solid here is so on the canvas
        self._region = canvas.cells(own, self._window) & self._free
        self._doorways = canvas.cells(thresholds, self._window)
        self._gates = [canvas.cells([hole], self._window) & self._free for hole in holes]
        self._places = fits(self._free, self._radius) & np.logical_or.reduce([self._region, *self._gates])
        self._n_parts = _parts(self._places)[0]
        self._least_places = LEAST_SHARE * self._places.sum()

    def put(self, piece: Piece, *, keep_doorways: bool = True) -> bool:
        """Make a piece's cells solid if that is allowed; whether it was."""
        window = self._canvas.window(np.vstack(piece))
        near = _relative(window, self._window)
        if near is None:
            return False
        cells = self._canvas.cells(piece, window)
        free, region = self._free[near], self._region[near]
        taken = cells & region & free
        if not taken.any() or (cells & free & ~region).any():
            return False
        if (cells & region & ~free).sum() > 0.1 * cells.sum():
            return False
        if keep_doorways and (taken & self._doorways[near]).any():
            return False
        solid = np.zeros(self._free.shape, bool)
        solid[near] = taken
        places = self._places_without(solid, near)
        if not self._passable(places):
            return False
        free[taken] = False
        self._places = places
        return True

    def _places_without(self, solid: np.ndarray, near: Window) -> np.ndarray:
        """Places of a disk of the passages' width that additional solid cells would leave."""
        reach = int(self._radius) + 2
        rows, columns = (slice(max(side.start - reach, 0), side.stop + reach) for side in near)
        places = self._places.copy()
        places[rows, columns] &= fits(~solid[rows, columns], self._radius)
        return places

    def _passable(self, places: np.ndarray) -> bool:
        """Whether all doors lead to one part of the room, without new parts, and enough of it is left."""
        n_parts, parts = _parts(places)
        if n_parts > self._n_parts or places.sum() < max(self._least_places, 1):
            return False
        through = [set(parts[gate & places].tolist()) for gate in self._gates]
        return all(through) and len(set().union(*through)) <= 1


def _parts(places: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of 4-connected parts, and the part of each place, from 1."""
    n, parts = cv2.connectedComponents(places.astype(np.uint8), connectivity=4)
    return n - 1, parts


def _relative(window: Window, outer: Window) -> Window | None:
    """A window relative to one that holds it; None if it does not."""
    slices = []
    for inner, wide in zip(window, outer, strict=True):
        if inner.start < wide.start or inner.stop > wide.stop:
            return None
        slices.append(slice(inner.start - wide.start, inner.stop - wide.start))
    return slices[0], slices[1]


def _place(space: Space, floor: Rect, entry: Entry, rng: np.random.Generator) -> None:
    """Try to put a piece somewhere along a wall, into a corner or freely into a room."""
    piece = entry.make(rng)
    extent = np.ptp(np.vstack(piece), axis=0)
    for _ in range(TRIES):
        if entry.place == "free":
            angle = rng.integers(4) * np.pi / 2 + (rng.uniform(-0.8, 0.8) if rng.random() < 0.3 else 0.0)
            middle = [rng.uniform(floor.x0, floor.x1), rng.uniform(floor.y0, floor.y1)]
            placed = [(polygon - (0, extent[1] / 2)) @ turn(angle).T + middle for polygon in piece]
        else:
            side = int(rng.choice(4, p=np.array(floor.size * 2) / (2 * sum(floor.size))))
            length = floor.size[side % 2]
            if length < extent[0]:
                continue
            along = rng.uniform(extent[0] / 2, length - extent[0] / 2)
            if entry.place == "corner":
                along = extent[0] / 2 if rng.random() < 0.5 else length - extent[0] / 2
            placed = [
                points_along(floor, side, polygon[::-1, 0] + along, -polygon[::-1, 1]) for polygon in piece
            ]
        if space.put(placed):
            return


def _door_leaf(rng: np.random.Generator, opening: Opening) -> Piece:
    """A door that stands open in the first of its rooms."""
    x0, y0 = opening.hole[:2]
    angle = rng.uniform(1.3, 2.6)  # from closed
    leaf = box(opening.width_m, 0.06, x_m=opening.width_m / 2)
    if opening.along_x:  # the first room lies below: hinge at the left, turning clockwise
        return [leaf @ turn(-angle).T + (x0, y0 + 0.05)]
    return [leaf @ turn(np.pi / 2 + angle).T + (x0 + 0.05, y0)]
