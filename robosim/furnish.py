"""Putting furniture into rooms without barring anyone's way.

A piece is tried at a few random places, along a wall, in a corner or freely, and stays where it overlaps
nothing, keeps off doorways, and leaves the places of a disk as wide as the passages to be kept in one part
that leads through all doors of the room; where nothing of the kind is found it is left out.
"""

import cv2
import numpy as np

from robosim.canvas import Canvas, fits
from robosim.furniture import Entry, Piece, box, entries, turn
from robosim.layout import Layout, Opening, Polygon, Rect, beside

#: Places that are tried for a piece before it is left out.
TRIES = 5
#: Depth of floor before a door that stays empty [m].
DOORWAY_M = 0.6


def furnish(
    canvas: Canvas, layout: Layout, rng: np.random.Generator, *, density: float, passage_m: float
) -> None:
    """Put furniture into the rooms of a building that is painted already.

    Args:
        canvas: Cells to be made solid.
        layout: Rooms and openings that the canvas shows.
        rng: Source of all chance.
        density: Share of the usual furniture that is there; above 1 for crowded rooms.
        passage_m: Width that stays free on some way between any two places that have it now [m].
    """
    for i, room in enumerate(layout.rooms):
        space = _Space(canvas, layout, i, passage_m)
        for opening in layout.openings:
            if opening.is_door and opening.rooms[0] == i and rng.random() < 0.4 * min(density, 1.0):
                space.put(_door_leaf(rng, opening), keep_doorways=False)
        for entry in entries(room.kind):
            n = int(rng.random() < entry.each * density)
            n += int(rng.poisson(entry.per_10_m2 * room.floor.area / 10 * density))
            for _ in range(n):
                _place(space, room.floor, entry, rng)


class _Space:
    """The cells of one room, and what may still be made solid in it."""

    def __init__(self, canvas: Canvas, layout: Layout, i: int, passage_m: float) -> None:
        own = [layout.rooms[i].floor.polygon()] + [floor for room, floor in layout.recesses if room == i]
        openings = [opening for opening in layout.openings if i in opening.rooms]
        holes = [opening.hole.polygon() for opening in openings]
        self._canvas = canvas
        self._radius = passage_m / 2 / canvas.resolution_m
        self._window = canvas.window(np.vstack(own + holes), passage_m)
        self._free = canvas.free[self._window]  # a view: what is made solid here is so on the canvas
        self._region = self._cells(own) & self._free
        self._gates = [self._cells([hole]) & self._free for hole in holes]
        self._doorways = self._cells([opening.threshold(DOORWAY_M).polygon() for opening in openings])
        self._inside = np.logical_or.reduce([self._region, *self._gates])
        self._places = fits(self._free, self._radius) & self._inside
        self._n_parts = cv2.connectedComponents(self._places.astype(np.uint8), connectivity=4)[0]

    def _cells(self, polygons: list[Polygon]) -> np.ndarray:
        """Cells of some polygons, within the room's window."""
        cells = np.zeros(self._canvas.free.shape, bool)
        for polygon in polygons:
            window, mask = self._canvas.patch(polygon)
            cells[window] |= mask
        return cells[self._window]

    def put(self, piece: Piece, *, keep_doorways: bool = True) -> bool:
        """Make a piece's cells solid, if nothing speaks against it."""
        cells = self._cells(piece)
        taken = cells & self._region & self._free
        elsewhere = cells & self._free & ~self._region
        overlap = cells & self._region & ~self._free
        if not taken.any() or elsewhere.any() or overlap.sum() > 0.1 * cells.sum():
            return False
        if keep_doorways and (taken & self._doorways).any():
            return False
        places = self._places_beside(taken)
        n, parts = cv2.connectedComponents(places.astype(np.uint8), connectivity=4)
        through = [np.unique(parts[gate & places]) for gate in self._gates]
        if n > self._n_parts or len({int(p) for gate in through for p in gate}) > 1 or not places.any():
            return False
        if not all(len(gate) for gate in through):
            return False
        self._free[taken] = False
        self._places = places
        return True

    def _places_beside(self, taken: np.ndarray) -> np.ndarray:
        """Places of a disk as wide as the passages that some more solid cells would leave."""
        reach = int(self._radius) + 2
        rows, columns = np.flatnonzero(taken.any(axis=1)), np.flatnonzero(taken.any(axis=0))
        near = tuple(slice(max(int(i[0]) - reach, 0), int(i[-1]) + reach + 1) for i in (rows, columns))
        places = self._places.copy()
        places[near] &= fits(~taken[near], self._radius)
        return places


def _place(space: _Space, floor: Rect, entry: Entry, rng: np.random.Generator) -> None:
    """Try to put a piece somewhere along a wall, into a corner or freely into a room."""
    piece = entry.make(rng)
    extent = np.ptp(np.vstack(piece), axis=0)
    for _ in range(TRIES):
        if entry.place == "free":
            angle = rng.integers(4) * np.pi / 2 + (rng.uniform(-0.8, 0.8) if rng.random() < 0.3 else 0.0)
            middle = [rng.uniform(floor.x0, floor.x1), rng.uniform(floor.y0, floor.y1)]
            moved = [(polygon - (0, extent[1] / 2)) @ turn(angle).T + middle for polygon in piece]
        else:
            side = int(rng.choice(4, p=np.array(floor.size * 2) / (2 * sum(floor.size))))
            length = floor.size[side % 2]
            if length < extent[0]:
                continue
            along = rng.uniform(extent[0] / 2, length - extent[0] / 2)
            if entry.place == "corner":
                along = extent[0] / 2 if rng.random() < 0.5 else length - extent[0] / 2
            moved = [beside(floor, side, polygon[::-1, 0] + along, -polygon[::-1, 1]) for polygon in piece]
        if space.put(moved):
            return


def _door_leaf(rng: np.random.Generator, opening: Opening) -> Piece:
    """A door that stands open in the first of its rooms."""
    x0, y0 = opening.hole[:2]
    angle = rng.uniform(1.3, 2.6)  # from closed
    leaf = box(opening.width_m, 0.06, x_m=opening.width_m / 2)
    if opening.along_x:  # the first room lies below: hinge at the left, turning clockwise
        return [leaf @ turn(-angle).T + (x0, y0 + 0.05)]
    return [leaf @ turn(np.pi / 2 + angle).T + (x0 + 0.05, y0)]
