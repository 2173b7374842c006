"""Furniture as cells up to the ceiling, by the kind of room, placed without blocking passages.

A piece is a few convex polygons in plan, drawn at random each time, in sizes that shops sell. The number of each
depends on the room's kind and size; the numbers were chosen so that furnished plans resemble scanned homes
(`python -m tests.benchmarks plans`), not taken from a survey.

A piece is tried at a few random places, along a wall, in a corner or freely. It stays where it overlaps nothing, does
not reach into doorways, and leaves the places of a disk of the passages' width connected to all doors of the room. If
no such place is found, it is left out.
"""

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from robosim.generator.canvas import Canvas, Polygon, Rect, Window, fits, points_along
from robosim.generator.layout import Layout, Opening

Piece = list[Polygon]
"""Polygons [m] in the piece's frame: x along the wall, middle at 0; y into the room, wall at 0."""

Maker = Callable[[np.random.Generator], Piece]


class Entry(NamedTuple):
    """Frequency and placement of a kind of piece in a room."""

    piece: str
    """Name of the piece, of which a maker draws a random one."""
    place: str
    """"wall", "corner" or "free"."""
    each: float = 0.0
    """Chance that a room has one."""
    per_10_m2: float = 0.0
    """Mean number of additional ones for each 10 m2 of floor."""

    def draw_count(self, rng: np.random.Generator, area_m2: float, density: float) -> int:
        """A random number of pieces for a room; `density` scales the mean."""
        n = int(rng.random() < self.each * density)
        return n + int(rng.poisson(self.per_10_m2 * area_m2 / 10 * density))


def entries(kind: str) -> list[Entry]:
    """Furniture of a kind of room in the order in which it is placed: large pieces first."""
    return _STRUCTURE + movables(kind)


def structure(kind: str) -> list[Entry]:
    """The entries that are part of the building: stubs of wall, and columns."""
    return _STRUCTURE


def movables(kind: str) -> list[Entry]:
    """The entries that are not part of the building; halls have no small ones."""
    return _BY_KIND[kind] + (_SMALL if kind != "great hall" else [])


def turn(angle: float) -> Float[np.ndarray, "2 2"]:
    """Rotation of the plane."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def box(width_m: float, depth_m: float, x_m: float = 0.0, y_m: float = 0.0) -> Polygon:
    """A rectangle with its middle at x and its near side at y."""
    return Rect(x_m - width_m / 2, y_m, x_m + width_m / 2, y_m + depth_m).polygon()


def disk(diameter_m: float, x_m: float = 0.0, y_m: float = 0.0) -> Polygon:
    """Sixteen corners of a disk with its middle at x and its near side at y."""
    angle = np.arange(16) * np.pi / 8
    return np.column_stack([np.cos(angle), 1 + np.sin(angle)]) * (diameter_m / 2) + (x_m, y_m)


def _sized(width_m: tuple[float, float], depth_m: tuple[float, float]) -> Maker:
    """Maker of boxes, such as wardrobes, shelves and counters."""
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
    return (box(0.45, 0.5) - (0, 0.25)) @ turn(rng.uniform(-0.5, 0.5)).T + seat + rng.uniform(-0.12, 0.12, 2)


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
    """Draw a small, irregular piece."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, 6))
    radius = rng.uniform(0.5, 1.0, 2) * rng.uniform(0.1, 0.45)
    return [np.column_stack([np.cos(angle), np.sin(angle)]) * radius + (0, radius[1] * rng.uniform(0, 0.9))]


#: Makers of pieces by name.
_MAKERS: dict[str, Maker] = {
    "bed": _bed,
    "sofa": _sofa,
    "table": _table,
    "desk": _desk,
    "desks": _desks,
    "counter": _counter,
    "plant": _plant,
    "column": _column,
    "clutter": _clutter,
    "armchair": _sized((0.7, 0.95), (0.75, 0.95)),
    "wardrobe": _sized((0.9, 2.6), (0.5, 0.7)),
    "shelf": _sized((0.6, 2.0), (0.25, 0.45)),
    "sideboard": _sized((0.9, 1.9), (0.4, 0.55)),
    "low table": _sized((0.6, 1.2), (0.5, 0.8)),
    "island": _sized((1.0, 2.2), (0.7, 1.1)),
    "stub": _sized((0.1, 0.2), (0.4, 1.3)),
    "tub": _sized((1.5, 1.8), (0.7, 0.85)),
    "basin": _sized((0.5, 1.4), (0.45, 0.6)),
    "toilet": _sized((0.4, 0.5), (0.65, 0.75)),
    "machine": _sized((0.6, 0.7), (0.6, 0.7)),
    "meeting table": _sized((1.8, 3.6), (1.0, 1.4)),
}

_STRUCTURE = [
    Entry("stub", "wall", per_10_m2=0.55),
    Entry("column", "free", per_10_m2=0.08),
    Entry("column", "corner", each=0.25),
]
_SMALL = [Entry("plant", "corner", per_10_m2=0.4), Entry("clutter", "wall", per_10_m2=3.4)]
_BY_KIND = {
    "bedroom": [
        Entry("bed", "wall", each=1),
        Entry("wardrobe", "corner", each=1),
        Entry("sideboard", "wall", each=1),
        Entry("desk", "wall", each=0.5),
        Entry("wardrobe", "wall", per_10_m2=0.4),
    ],
    "living": [
        Entry("sofa", "wall", each=1),
        Entry("low table", "free", each=0.7),
        Entry("sideboard", "wall", each=1),
        Entry("sofa", "free", per_10_m2=0.17),
        Entry("armchair", "wall", per_10_m2=0.7),
        Entry("shelf", "wall", per_10_m2=1.2),
        Entry("table", "free", per_10_m2=0.2),
    ],
    "dining": [
        Entry("table", "free", each=1),
        Entry("sideboard", "wall", each=1),
        Entry("shelf", "wall", each=0.5),
    ],
    "kitchen": [
        Entry("counter", "corner", each=1),
        Entry("counter", "wall", each=0.6),
        Entry("island", "free", per_10_m2=0.3),
        Entry("table", "free", per_10_m2=0.3),
        Entry("machine", "corner", each=1),
    ],
    "bath": [
        Entry("tub", "corner", each=1),
        Entry("basin", "wall", each=1),
        Entry("toilet", "wall", each=1),
        Entry("machine", "corner", each=0.4),
    ],
    "hall": [Entry("shelf", "wall", per_10_m2=1.3)],
    "storage": [Entry("shelf", "wall", each=1, per_10_m2=2), Entry("machine", "corner", each=0.5)],
    "office": [
        Entry("desk", "wall", each=1, per_10_m2=0.8),
        Entry("shelf", "wall", each=1),
        Entry("armchair", "corner", each=0.4),
    ],
    "meeting": [Entry("meeting table", "free", each=1), Entry("sideboard", "wall", each=1)],
    "open office": [
        Entry("desks", "free", per_10_m2=0.9),
        Entry("shelf", "wall", per_10_m2=1),
        Entry("column", "free", per_10_m2=0.33),
    ],
    "classroom": [
        Entry("desks", "free", per_10_m2=1.6),
        Entry("sideboard", "wall", each=1),
        Entry("shelf", "wall", per_10_m2=0.5),
    ],
    "great hall": [Entry("island", "free", per_10_m2=0.5), Entry("shelf", "wall", per_10_m2=0.5)],
}


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
        floors = [layout.rooms[i].floor.polygon()] + [floor for room, floor in layout.recesses if room == i]
        openings = [opening for opening in layout.openings if i in opening.rooms]
        holes = [opening.hole.polygon() for opening in openings]
        thresholds = [opening.threshold(DOORWAY_M).polygon() for opening in openings]
        self._canvas = canvas
        self._radius = passage_m / 2 / canvas.resolution_m
        self._window = canvas.window(np.vstack(floors + holes), passage_m)
        self._free = canvas.free[self._window]  # a view: cells made solid here are so on the canvas
        self._region = canvas.cells(floors, self._window) & self._free
        self._doorways = canvas.cells(thresholds, self._window)
        gates = [canvas.cells([hole], self._window) & self._free for hole in holes]
        self._gates = [np.flatnonzero(gate) for gate in gates]
        self._places = fits(self._free, self._radius) & np.logical_or.reduce([self._region, *gates])
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
        through = [set(parts.ravel()[gate].tolist()) - {0} for gate in self._gates]
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
    piece = _MAKERS[entry.piece](rng)
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
