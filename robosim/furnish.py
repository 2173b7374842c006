"""Furniture: what stands in a room, along its walls or freely, without barring anyone's way.

A piece is a handful of convex polygons, drawn anew each time (a table comes with its chairs). It is tried at
a few random places and stays where it overlaps nothing, keeps off doorways, and leaves the space of a disk
as wide as the passages to be kept (the hull and what is to be taken off) in one part that holds all doors of
the room. Small disorder goes along walls at the end: scans of lived-in homes have ragged outlines.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool

from robosim.canvas import Canvas, Window, fits
from robosim.layout import Layout, Opening, Polygon, Rect, Room, beside

#: Places that are tried for a piece before it is left out.
TRIES = 5
#: Depth of floor before a door that stays empty [m].
DOORWAY_M = 0.6

Piece = list[Polygon]
"""Polygons [m] in a piece's own frame: x along the wall with the middle at 0, y into the room with the wall at 0."""

Maker = Callable[[np.random.Generator], Piece]


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
        for maker, place, count in _programme(room):
            for _ in range(rng.poisson(count * density) if count != 1 else int(rng.random() < density)):
                _place(space, room.floor, maker, place, rng)


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
        self._n_parts = self._parts(self._free)[0]

    def _cells(self, polygons: list[Polygon]) -> np.ndarray:
        """Cells of some polygons, within the room's window."""
        cells = np.zeros(self._canvas.free.shape, bool)
        for polygon in polygons:
            window, mask = self._canvas.patch(polygon)
            cells[window] |= mask
        return cells[self._window]

    def _parts(self, free: np.ndarray) -> tuple[int, np.ndarray]:
        """Number of parts, and the parts, of the places where a disk as wide as the passages has room."""
        places = fits(free, self._radius) & self._inside
        n, parts = cv2.connectedComponents(places.astype(np.uint8), connectivity=4)
        return n - 1, parts

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
        n_parts, parts = self._parts(self._free & ~taken)
        through = [np.unique(parts[gate & (parts > 0)]) for gate in self._gates]
        if not 1 <= n_parts <= max(self._n_parts, 1) or len({int(p) for part in through for p in part}) > 1:
            return False
        if not all(len(part) for part in through):
            return False
        self._free[taken] = False
        return True


def _place(space: _Space, floor: Rect, maker: Maker, place: str, rng: np.random.Generator) -> None:
    """Try to put a piece somewhere along a wall, into a corner or freely into a room."""
    piece = maker(rng)
    extent = np.ptp(np.vstack(piece), axis=0)
    for _ in range(TRIES):
        if place == "free":
            angle = rng.integers(4) * np.pi / 2 + (rng.uniform(-0.8, 0.8) if rng.random() < 0.3 else 0.0)
            middle = [rng.uniform(floor.x0, floor.x1), rng.uniform(floor.y0, floor.y1)]
            moved = [(polygon - (0, extent[1] / 2)) @ _turn(angle).T + middle for polygon in piece]
        else:
            side = int(rng.choice(4, p=np.array(floor.size * 2) / (2 * sum(floor.size))))
            length = floor.size[side % 2]
            if length < extent[0]:
                continue
            along = rng.uniform(extent[0] / 2, length - extent[0] / 2)
            if place == "corner":
                along = extent[0] / 2 if rng.random() < 0.5 else length - extent[0] / 2
            moved = [beside(floor, side, polygon[::-1, 0] + along, -polygon[::-1, 1]) for polygon in piece]
        if space.put(moved):
            return


def _turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def box(width_m: float, depth_m: float, x_m: float = 0.0, y_m: float = 0.0) -> Polygon:
    """A rectangle with its middle at x and its near side at y."""
    return Rect(x_m - width_m / 2, y_m, x_m + width_m / 2, y_m + depth_m).polygon()


def disk(diameter_m: float, x_m: float = 0.0, y_m: float = 0.0) -> Polygon:
    """Sixteen corners of a disk with its middle at x and its near side at y."""
    angle = np.arange(16) * np.pi / 8
    return np.column_stack([np.cos(angle), 1 + np.sin(angle)]) * (diameter_m / 2) + (x_m, y_m)


def _sized(width_m: tuple[float, float], depth_m: tuple[float, float]) -> Maker:
    """Maker of boxes: wardrobes, shelves, counters and all else that is one."""
    return lambda rng: [box(rng.uniform(*width_m), rng.uniform(*depth_m), y_m=-0.02)]


def _bed(rng: np.random.Generator) -> Piece:
    width = rng.uniform(0.9, 2.0)
    stands = [
        box(0.45, 0.4, x_m=side * (width / 2 + 0.25), y_m=-0.02) for side in (-1, 1) if rng.random() < 0.5
    ]
    return [box(width, rng.uniform(1.95, 2.2), y_m=-0.02), *stands]


def _sofa(rng: np.random.Generator) -> Piece:
    width = rng.uniform(1.5, 2.6)
    wing = [box(0.9, rng.uniform(1.4, 2.0), x_m=(width - 0.9) / 2, y_m=-0.02)] if rng.random() < 0.3 else []
    return [box(width, 0.95, y_m=-0.02), *wing]


def _table(rng: np.random.Generator) -> Piece:
    """A table with chairs that were not pushed back neatly."""
    if rng.random() < 0.3:
        diameter = rng.uniform(0.8, 1.4)
        angles = np.arange(4) * np.pi / 2 + rng.uniform(0, np.pi / 2)
        seats = np.column_stack([np.cos(angles), np.sin(angles)]) * (diameter / 2 + 0.1) + (0, diameter / 2)
        return [disk(diameter), *(_chair(rng, seat) for seat in seats)]
    width, depth = rng.uniform(1.0, 2.2), rng.uniform(0.75, 1.0)
    n = int(width / 0.65)
    x = (np.arange(n) - (n - 1) / 2) * width / n
    seats = np.vstack([np.column_stack([x, np.full(n, -0.1)]), np.column_stack([x, np.full(n, depth + 0.1)])])
    return [box(width, depth), *(_chair(rng, seat) for seat in seats if rng.random() < 0.85)]


def _chair(rng: np.random.Generator, seat: np.ndarray) -> Polygon:
    return (box(0.45, 0.5) - (0, 0.25)) @ _turn(rng.uniform(-0.5, 0.5)).T + seat + rng.uniform(-0.12, 0.12, 2)


def _desk(rng: np.random.Generator) -> Piece:
    width, depth = rng.uniform(1.0, 1.7), rng.uniform(0.6, 0.8)
    return [box(width, depth, y_m=-0.02), _chair(rng, np.array([rng.uniform(-0.2, 0.2), depth + 0.15]))]


def _desks(rng: np.random.Generator) -> Piece:
    """Two rows of desks, face to face, with their chairs."""
    n, depth = int(rng.integers(1, 4)), 1.5
    seats = [np.array([(k - (n - 1) / 2) * 1.5, y]) for k in range(n) for y in (-0.25, depth + 0.25)]
    return [box(1.5 * n, depth), *(_chair(rng, seat) for seat in seats if rng.random() < 0.8)]


def _counter(rng: np.random.Generator) -> Piece:
    """A kitchen counter, at times around a corner."""
    width = rng.uniform(1.5, 3.5)
    arm = [box(0.6, rng.uniform(1.2, 2.2), x_m=(width - 0.6) / 2, y_m=-0.02)] if rng.random() < 0.5 else []
    return [box(width, rng.uniform(0.58, 0.68), y_m=-0.02), *arm]


def _plant(rng: np.random.Generator) -> Piece:
    return [disk(rng.uniform(0.25, 0.6), y_m=rng.uniform(0, 0.1))]


def _column(rng: np.random.Generator) -> Piece:
    width = rng.uniform(0.2, 0.5)
    return [disk(width)] if rng.random() < 0.5 else [box(width, width * rng.uniform(0.7, 1.4))]


def _clutter(rng: np.random.Generator) -> Piece:
    """Something small and irregular."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, 6))
    radius = rng.uniform(0.5, 1.0, 2) * rng.uniform(0.1, 0.35)
    return [np.column_stack([np.cos(angle), np.sin(angle)]) * radius + (0, radius[1] * rng.uniform(0, 0.9))]


def _door_leaf(rng: np.random.Generator, opening: Opening) -> Piece:
    """A door that stands open in the first of its rooms."""
    x0, y0, x1, y1 = opening.hole
    angle = rng.uniform(1.3, 2.6)  # from closed
    leaf = box(opening.width_m, 0.06) + (opening.width_m / 2, 0)
    if opening.along_x:  # the first room lies below: hinge at the left, turning clockwise
        return [leaf @ _turn(-angle).T + (x0, y0 + 0.05)]
    return [leaf @ _turn(np.pi / 2 + angle).T + (x0 + 0.05, y0)]


_ARMCHAIR = _sized((0.7, 0.95), (0.75, 0.95))
_WARDROBE = _sized((0.9, 2.6), (0.5, 0.7))
_SHELF = _sized((0.6, 2.0), (0.25, 0.45))
_SIDEBOARD = _sized((0.9, 1.9), (0.4, 0.55))
_LOW_TABLE = _sized((0.6, 1.2), (0.5, 0.8))
_ISLAND = _sized((1.0, 2.2), (0.7, 1.1))
_STUB = _sized((0.1, 0.2), (0.4, 1.3))
_TUB = _sized((1.5, 1.8), (0.7, 0.85))
_BASIN = _sized((0.5, 1.4), (0.45, 0.6))
_TOILET = _sized((0.4, 0.5), (0.65, 0.75))
_MACHINE = _sized((0.6, 0.7), (0.6, 0.7))
_MEETING_TABLE = _sized((1.8, 3.6), (1.0, 1.4))


def _programme(room: Room) -> list[tuple[Maker, str, float]]:
    """What stands in a room: piece, place, and how many on average; large things first."""
    area = room.floor.area
    items: dict[str, list[tuple[Maker, str, float]]] = {
        "bedroom": [(_bed, "wall", 1), (_WARDROBE, "corner", 1), (_SIDEBOARD, "wall", 1), (_desk, "wall", 0.5)],
        "living": [
            (_sofa, "wall", 1),
            (_LOW_TABLE, "free", 1),
            (_SIDEBOARD, "wall", 1),
            (_sofa, "free", area / 40),
            (_ARMCHAIR, "free", area / 20),
            (_SHELF, "wall", area / 15),
            (_table, "free", area / 40),
        ],
        "dining": [(_table, "free", 1), (_SIDEBOARD, "wall", 1), (_SHELF, "wall", 0.5)],
        "kitchen": [(_counter, "corner", 1), (_counter, "wall", 0.6), (_ISLAND, "free", area / 25), (_table, "free", area / 25), (_MACHINE, "corner", 1)],
        "bath": [(_TUB, "corner", 1), (_BASIN, "wall", 1), (_TOILET, "wall", 1), (_MACHINE, "corner", 0.4)],
        "hall": [(_SHELF, "wall", area / 8)],
        "storage": [(_SHELF, "wall", 1.5), (_MACHINE, "corner", 0.5)],
        "office": [(_desk, "wall", max(1.2, area / 9)), (_SHELF, "wall", 1), (_ARMCHAIR, "corner", 0.4)],
        "meeting": [(_MEETING_TABLE, "free", 1), (_SIDEBOARD, "wall", 1)],
        "open office": [(_desks, "free", area / 11), (_SHELF, "wall", area / 15), (_column, "free", area / 30)],
    }  # fmt: skip
    structure = [(_STUB, "wall", area / 30), (_column, "free", area / 80), (_column, "corner", 0.25)]
    small = [(_plant, "corner", area / 25), (_clutter, "wall", area / 4), (_clutter, "free", area / 60)]
    return structure + items[room.kind] + small
