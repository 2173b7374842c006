"""The rooms of an invented building and the openings between them, as geometry without furniture.

A rectangle is cut into rooms by straight cuts, the largest piece first, often after a corridor has been laid
through it; some pieces are left out, which gives L-, U- and T-shaped buildings and solid blocks. What is
left is joined by a spanning tree of openings, cheapest where one would expect a door (onto the corridor, the
living room), and a few more for loops. Bays and alcoves are added and corners cut, so that walls slant.
All is convex polygons in the building's own frame, in metres, with most walls along its axes.

Reference for rooms by cutting rectangles: Marson and Musse, "Automatic real-time generation of floor plans
based on squarified treemaps algorithm", Int. J. Computer Games Technology (2010). Here cuts are drawn at
random rather than packed, since training wants variety, not the best plan.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Polygon = Float[np.ndarray, "_ 2"]
"""Corners (x, y) [m] of a convex polygon, counter-clockwise."""

#: Wall left standing beside a door, at least [m].
JAMB_M = 0.08
#: Kinds of room that are often one open space.
SOCIAL = {"living", "dining", "kitchen", "hall", "open office"}


class Rect(NamedTuple):
    """A rectangle along the axes [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size(self) -> tuple[float, float]:
        """Extent along x and y [m]."""
        return self.x1 - self.x0, self.y1 - self.y0

    @property
    def area(self) -> float:
        """Area [m2]."""
        return self.size[0] * self.size[1]

    def grown(self, margin_m: float) -> "Rect":
        """The rectangle with every side moved outwards."""
        return Rect(self.x0 - margin_m, self.y0 - margin_m, self.x1 + margin_m, self.y1 + margin_m)

    def meets(self, other: "Rect") -> bool:
        """Whether the two have more than a border in common."""
        return self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1

    def polygon(self) -> Polygon:
        """Its corners."""
        x0, y0, x1, y1 = self
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)


@dataclass(frozen=True, kw_only=True)
class Style:
    """What distinguishes homes from offices."""

    aspect: tuple[float, float]
    """Long over short side of the building, least and most."""
    corridor_chance: float
    """How often a building of four rooms or more has a corridor."""
    corridor_m: tuple[float, float]
    """Width of corridors."""
    narrowest_m: float
    """Smallest side of a room, between wall axes."""
    uneven: float
    """Spread of room sizes: standard deviation of their logarithm."""
    left_out: float
    """Largest share of pieces that are no rooms."""
    loops: float
    """Chance of a second door where two rooms are neighbours."""
    open_plan: float
    """Chance that two social rooms share a wide opening instead of a door."""
    recess: float
    """Chance of an alcove or bay, for each free side of a room."""
    slanted: float
    """Chance of a slanted wall, for each room."""
    crowding: float
    """How many pieces the usual furniture is, relative to the lists of pieces."""


HOME = Style(
    aspect=(1.0, 1.8),
    corridor_chance=0.5,
    corridor_m=(0.9, 1.5),
    narrowest_m=1.5,
    uneven=0.65,
    left_out=0.35,
    loops=0.35,
    open_plan=0.8,
    recess=0.15,
    slanted=0.1,
    crowding=1.5,
)
OFFICE = Style(
    aspect=(1.0, 2.5),
    corridor_chance=1.0,
    corridor_m=(1.6, 2.4),
    narrowest_m=2.4,
    uneven=0.35,
    left_out=0.1,
    loops=0.05,
    open_plan=0.3,
    recess=0.05,
    slanted=0.04,
    crowding=0.75,
)
STYLES = {"home": HOME, "office": OFFICE}


@dataclass(frozen=True, kw_only=True)
class Room:
    """A room: its floor before bays are added and corners cut, and what it is for."""

    floor: Rect
    kind: str


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A door or a wide opening in the wall between two rooms."""

    rooms: tuple[int, int]
    """The two rooms, the one with the lower coordinate first."""
    hole: Rect
    """What is taken out of the wall; it reaches a little into both rooms."""
    along_x: bool
    """Whether the wall runs along x."""
    width_m: float
    """Clear width."""

    @property
    def is_door(self) -> bool:
        """Whether a door leaf would fit."""
        return self.width_m <= 1.1

    def threshold(self, depth_m: float) -> Rect:
        """Floor in front of the opening on both sides, to be kept free."""
        x0, y0, x1, y1 = self.hole
        return (
            Rect(x0, y0 - depth_m, x1, y1 + depth_m)
            if self.along_x
            else Rect(x0 - depth_m, y0, x1 + depth_m, y1)
        )


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A building without furniture."""

    rooms: list[Room]
    openings: list[Opening]
    recesses: list[tuple[int, Polygon]]
    """Alcoves and bays: the room that they widen, and their floor."""
    wedges: list[tuple[int, Polygon]]
    """Solid wedges with a slanted side: the room that they narrow, and their plan."""

    def bounds(self) -> Rect:
        """Around all floor."""
        corners = np.vstack(
            [room.floor.polygon() for room in self.rooms] + [floor for _, floor in self.recesses]
        )
        return Rect(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())


def lay_out(
    rng: np.random.Generator,
    *,
    area_m2: float,
    rooms: int,
    door_m: tuple[float, float],
    style: Style,
) -> Layout:
    """Invent the rooms of a building.

    Args:
        rng: Source of all chance.
        area_m2: Floor area of all rooms together, without bays, before furniture [m2].
        rooms: Number of rooms, corridors included. A few less come out where the area is too small for them.
        door_m: Clear width of doors, least and most [m].
        style: Kind of building.
    """
    spare = round(rng.uniform(0, style.left_out) * rooms) if rooms > 2 else 0
    cells, is_hall = _cut(rng, area_m2, rooms + spare, style)
    kept = _leave_out(rng, cells, is_hall, spare)
    wall_m = rng.uniform(0.1, 0.2)
    cells = _to_area([cells[i] for i in kept], area_m2, wall_m)
    kept = _joined(_neighbours(cells, door_m[1] + wall_m + 2 * JAMB_M), len(cells))
    cells, is_hall = [cells[i] for i in kept], [is_hall[i] for i in kept]
    neighbours = _neighbours(cells, door_m[1] + wall_m + 2 * JAMB_M)
    floors = [cell.grown(-wall_m / 2) for cell in cells]
    kinds = _kinds(rng, floors, is_hall, neighbours, office=style is OFFICE)
    openings = [
        _opening(rng, pair, shared, wall_m, door_m, wide=wide)
        for pair, shared, wide in _joints(rng, kinds, neighbours, style)
    ]
    recesses = _recesses(rng, floors, wall_m, style)
    return Layout(
        rooms=[Room(floor=floor, kind=kind) for floor, kind in zip(floors, kinds, strict=True)],
        openings=openings,
        recesses=recesses,
        wedges=_wedges(rng, floors, openings, recesses, style),
    )


def _cut(rng: np.random.Generator, area_m2: float, n: int, style: Style) -> tuple[list[Rect], list[bool]]:
    """Cut a rectangle into n pieces between wall axes; and which of them are corridors."""
    aspect = rng.uniform(*style.aspect)
    width = float(np.sqrt(area_m2 * 1.15 * aspect))
    whole = Rect(0.0, 0.0, width, width / aspect)
    halls: list[Rect] = []
    pieces = [whole]
    if n >= 4 and rng.random() < style.corridor_chance:
        halls, pieces = _corridor(rng, whole, style)
    appetite = [float(a) for a in rng.lognormal(0, style.uneven, len(pieces))]
    while len(pieces) + len(halls) < n:
        hunger = [
            piece.area * max(piece.size) / min(piece.size) / a
            if max(piece.size) >= 2 * style.narrowest_m
            else 0.0
            for piece, a in zip(pieces, appetite, strict=True)
        ]
        i = int(np.argmax(hunger))
        if hunger[i] == 0.0:
            break
        pieces[i : i + 1] = _halves(rng, pieces[i], style.narrowest_m)
        appetite[i : i + 1] = [float(a) for a in appetite[i] * rng.lognormal(0, style.uneven, 2)]
    return halls + pieces, [True] * len(halls) + [False] * len(pieces)


def _corridor(rng: np.random.Generator, whole: Rect, style: Style) -> tuple[list[Rect], list[Rect]]:
    """A corridor along the longer side, from one end or through; and the pieces around it."""
    x0, y0, x1, y1 = whole
    width = rng.uniform(*style.corridor_m)
    y = y0 + rng.uniform(0.35, 0.65) * (y1 - y0 - width)
    end = x0 + rng.uniform(0.5, 1.1) * (x1 - x0)
    pieces = [Rect(x0, y0, x1, y), Rect(x0, y + width, x1, y1)]
    if x1 - end < style.narrowest_m:
        return [Rect(x0, y, x1, y + width)], pieces
    if rng.random() < 0.5:  # the corridor's end belongs to one of the sides: cut that side there
        side = pieces.pop(int(rng.integers(2)))
        pieces.append(side._replace(x1=end))
        pieces.append(Rect(end, min(side.y0, y), x1, max(side.y1, y + width)))
    else:
        pieces = [Rect(x0, y0, end, y), Rect(x0, y + width, end, y1), Rect(end, y0, x1, y1)]
    return [Rect(x0, y, end, y + width)], pieces


def _halves(rng: np.random.Generator, piece: Rect, narrowest_m: float) -> list[Rect]:
    """Cut a piece across its longer side."""
    x0, y0, x1, y1 = piece
    longer = max(piece.size)
    at = float(np.clip(rng.uniform(0.3, 0.7) * longer, narrowest_m, longer - narrowest_m))
    if piece.size[0] >= piece.size[1]:
        return [Rect(x0, y0, x0 + at, y1), Rect(x0 + at, y0, x1, y1)]
    return [Rect(x0, y0, x1, y0 + at), Rect(x0, y0 + at, x1, y1)]


def _leave_out(rng: np.random.Generator, cells: list[Rect], is_hall: list[bool], n: int) -> list[int]:
    """Drop up to n pieces, so that the others still hang together; returns those kept."""
    kept = list(range(len(cells)))
    touching = _neighbours(cells, 1.0)
    for i in rng.permutation(len(cells)):
        rest = [k for k in kept if k != i]
        links = [pair for pair in touching if set(pair) <= set(rest)]
        if len(kept) + n > len(cells) and not is_hall[i] and len(_joined(links, len(cells))) == len(rest):
            kept = rest
    return kept


class Shared(NamedTuple):
    """The stretch of wall axis that two pieces share."""

    along_x: bool
    at: float
    low: float
    high: float


def _neighbours(cells: list[Rect], shortest_m: float) -> dict[tuple[int, int], Shared]:
    """Pairs of pieces that share a stretch of wall of some length; the lower of the two first."""
    found = {}
    for i, j in combinations(range(len(cells)), 2):
        for a, b in ((i, j), (j, i)):
            p, q = cells[a], cells[b]
            if abs(p.y1 - q.y0) < 1e-6:
                shared = Shared(True, p.y1, max(p.x0, q.x0), min(p.x1, q.x1))
            elif abs(p.x1 - q.x0) < 1e-6:
                shared = Shared(False, p.x1, max(p.y0, q.y0), min(p.y1, q.y1))
            else:
                continue
            if shared.high - shared.low >= shortest_m:
                found[a, b] = shared
    return found


def _joined(links: Iterable[tuple[int, int]], n: int) -> list[int]:
    """The largest set of pieces that hang together."""
    group = list(range(n))
    for a, b in links:
        group = [group[a] if g == group[b] else g for g in group]
    largest = max(group, key=group.count)
    return [i for i in range(n) if group[i] == largest]


def _to_area(cells: list[Rect], area_m2: float, wall_m: float) -> list[Rect]:
    """Scale pieces so that what walls leave of them has the wanted area together."""
    # sum of (w s - t) (h s - t) over all pieces is quadratic in the scale s
    a = sum(cell.area for cell in cells)
    b = -wall_m * sum(sum(cell.size) for cell in cells)
    c = len(cells) * wall_m**2 - area_m2
    scale = float((-b + np.sqrt(b * b - 4 * a * c)) / (2 * a))
    return [Rect(*(scale * v for v in cell)) for cell in cells]


def _kinds(
    rng: np.random.Generator,
    floors: list[Rect],
    is_hall: list[bool],
    neighbours: dict[tuple[int, int], Shared],
    *,
    office: bool,
) -> list[str]:
    """What each room is for, by its size and neighbours."""
    by_size = sorted((i for i in range(len(floors)) if not is_hall[i]), key=lambda i: -floors[i].area)
    kinds = ["hall"] * len(floors)
    for i in by_size:
        kinds[i] = _kind_by_size(rng, floors[i], office=office)
    living = by_size[0]
    kinds[living] = (
        "open office" if office and floors[living].area > 30 else "meeting" if office else "living"
    )
    beside = [b if a == living else a for a, b in neighbours if living in (a, b)]
    for kind, least, most in [("kitchen", 5, 20), ("dining", 7, 25)]:
        fit = [
            i for i in beside if not is_hall[i] and kinds[i] not in SOCIAL and least < floors[i].area < most
        ]
        if fit and not office and (kind == "kitchen" or len(by_size) > 5):
            kinds[fit[int(rng.integers(len(fit)))]] = kind
    if "bath" not in kinds and len(by_size) >= 3:
        kinds[by_size[-1]] = "bath"
    return kinds


def _kind_by_size(rng: np.random.Generator, floor: Rect, *, office: bool) -> str:
    if floor.area < 2.5:
        return "storage"
    if office:
        return "kitchen" if floor.area < 9 else "meeting" if rng.random() < 0.2 else "office"
    if floor.area < 6.5:
        return "bath" if rng.random() < 0.6 else "storage"
    return "bedroom" if rng.random() < 0.8 else "office"


def _joints(
    rng: np.random.Generator, kinds: list[str], neighbours: dict[tuple[int, int], Shared], style: Style
) -> list[tuple[tuple[int, int], Shared, bool]]:
    """Pairs of rooms that get an opening, the wall they share, and whether the opening is wide."""
    cost = {}
    for a, b in neighbours:
        pair = {kinds[a], kinds[b]}
        if "hall" in pair:
            base = 0.0
        elif pair <= SOCIAL:
            base = 0.3
        else:
            base = 0.8 if pair & SOCIAL else 1.5
        cost[a, b] = base + rng.random()
    group = list(range(len(kinds)))
    chosen = []
    for a, b in sorted(cost, key=lambda pair: cost[pair]):
        tree = group[a] != group[b]
        both_social = {kinds[a], kinds[b]} <= SOCIAL
        extra = rng.random() < style.loops * (2 if both_social else 1)
        wide = both_social and rng.random() < style.open_plan
        if tree or extra:
            chosen.append(((a, b), neighbours[a, b], wide))
            group = [group[a] if g == group[b] else g for g in group]
    return chosen


def _opening(
    rng: np.random.Generator,
    pair: tuple[int, int],
    shared: Shared,
    wall_m: float,
    door_m: tuple[float, float],
    *,
    wide: bool,
) -> Opening:
    """A door, more often near a corner than not, or a wide opening, in the wall that two rooms share."""
    low, high = shared.low + wall_m / 2 + JAMB_M, shared.high - wall_m / 2 - JAMB_M
    width = rng.uniform(*door_m)
    if wide:
        width = max(width, rng.uniform(0.5, 1.0) * (high - low))
    slack = high - low - width
    start = low + slack * rng.random()
    if rng.random() < 0.5:  # close to one end
        corner = min(rng.uniform(0, 0.3), slack)
        start = low + corner if rng.random() < 0.5 else high - width - corner
    across = (shared.at - wall_m / 2 - 0.05, shared.at + wall_m / 2 + 0.05)
    if shared.along_x:
        hole = Rect(start, across[0], start + width, across[1])
    else:
        hole = Rect(across[0], start, across[1], start + width)
    return Opening(rooms=pair, hole=hole, along_x=shared.along_x, width_m=width)


def _recesses(
    rng: np.random.Generator, floors: list[Rect], wall_m: float, style: Style
) -> list[tuple[int, Polygon]]:
    """Alcoves and bays beyond walls that have nothing behind them."""
    found: list[tuple[int, Polygon]] = []
    taken = list(floors)
    for i, floor in enumerate(floors):
        for side in range(4):
            length = floor.size[side % 2]
            if rng.random() >= style.recess or length < 1.2:
                continue
            recess = _recess(rng, floor, side, length)
            box = _box(recess)
            beyond = box.grown(wall_m)
            if not any(beyond.meets(other) for k, other in enumerate(taken) if k != i):
                found.append((i, recess))
                taken.append(box)
    return found


def _recess(rng: np.random.Generator, floor: Rect, side: int, length: float) -> Polygon:
    """A niche, a bay or a wing at an angle, behind side 0 to 3 (south, east, north, west)."""
    width = rng.uniform(0.25, 0.9) * length
    middle = rng.uniform(width / 2, length - width / 2)
    shape = rng.random()
    slant = skew = tilt = 0.0
    if shape < 0.55:  # niche
        depth = rng.uniform(0.3, 0.9)
    elif shape < 0.85:  # bay
        depth = rng.uniform(0.4, 1.0)
        slant = min(rng.uniform(0.3, 1.0) * depth, 0.4 * width)
    else:  # wing at an angle, square at its end
        width = max(width, min(1.0, length))
        middle = float(np.clip(middle, width / 2, length - width / 2))
        depth = rng.uniform(1.5, 3.0)
        skew = rng.uniform(-0.6, 0.6) * depth
        tilt = float(np.clip(skew / depth * width, -depth, depth)) / 2
    # Corners as (along the wall, outwards), first on the wall, which they overlap so that nothing is left.
    u = np.array([-width / 2, width / 2, width / 2 - slant + skew, -width / 2 + slant + skew]) + middle
    v = np.array([-0.1, -0.1, depth - tilt, depth + tilt])
    return beside(floor, side, u, v)


def beside(floor: Rect, side: int, u: np.ndarray, v: np.ndarray) -> Polygon:
    """Points given along a side of a room (u, from its start, counter-clockwise) and outwards (v)."""
    start = floor.polygon()[side]
    along = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][side])
    outward = np.array([along[1], -along[0]])
    points = start + u[:, None] * along + v[:, None] * outward
    return points[::-1].copy()  # outwards is to the right of along, so reversed to be counter-clockwise


def _box(points: Polygon) -> Rect:
    """The smallest rectangle along the axes around some points."""
    return Rect(*points.min(axis=0).tolist(), *points.max(axis=0).tolist())


def _wedges(
    rng: np.random.Generator,
    floors: list[Rect],
    openings: list[Opening],
    recesses: list[tuple[int, Polygon]],
    style: Style,
) -> list[tuple[int, Polygon]]:
    """Solid wedges that cut a corner or lean on a whole wall, away from doors and bays."""
    found = []
    for i, floor in enumerate(floors):
        if rng.random() >= style.slanted or min(floor.size) < 1.8:
            continue
        side = int(rng.integers(4))
        length, across = floor.size[side % 2], floor.size[1 - side % 2]
        legs = np.array([rng.uniform(0.2, 0.5) * length, rng.uniform(0.2, 0.5) * across])
        if rng.random() < 0.4:
            legs = np.array([length, rng.uniform(0.05, 0.2) * across])
        # A triangle on the wall: from the side's start along it, and from the start inwards.
        wedge = beside(floor, side, np.array([-0.05, -0.05, legs[0]]), np.array([0.05, -legs[1], 0.05]))
        doorways = [opening.threshold(0.7) for opening in openings if i in opening.rooms]
        bays = [_box(recess) for room, recess in recesses if room == i]
        if not any(_box(wedge).meets(other) for other in doorways + bays):
            found.append((i, wedge))
    return found
