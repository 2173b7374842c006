"""Rooms of a generated building and the openings between them, as geometry without furniture.

The pieces of a rectangle (`subdivision`) get a purpose by their size and neighbours. A spanning tree of openings joins
them, with the least cost where a door is usual (to the corridor, the living room), and some more make loops. Bays and
alcoves are added where nothing lies behind a wall, and wedges cut corners away from doors, so that walls slant. All
parts are convex polygons in the building's own frame, in metres, with most walls along its axes.
"""

from dataclasses import dataclass

import numpy as np

from robosim.generator.canvas import Polygon, Rect, bounding_box, points_along
from robosim.generator.subdivision import (
    OFFICE,
    SharedWall,
    Style,
    cut,
    largest_connected,
    leave_out,
    shared_walls,
    to_area,
)
from robosim.generator.wings import LargeStyle, cut_wings, draw_posts


def draw_recesses(
    rng: np.random.Generator, floors: list[Rect], wall_m: float, style: Style
) -> list[tuple[int, Polygon]]:
    """Alcoves and bays beyond walls that have nothing behind them."""
    recesses: list[tuple[int, Polygon]] = []
    taken = list(floors)
    for i, floor in enumerate(floors):
        for side in range(4):
            length = floor.size[side % 2]
            if rng.random() >= style.recess or length < 1.2:
                continue
            recess = _recess(rng, floor, side, length)
            box = bounding_box(recess)
            beyond = box.grown(wall_m)
            if not any(beyond.meets(other) for k, other in enumerate(taken) if k != i):
                recesses.append((i, recess))
                taken.append(box)
    return recesses


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
    return points_along(floor, side, u, v)


def draw_wedges(
    rng: np.random.Generator,
    floors: list[Rect],
    doorways: list[tuple[int, Rect]],
    recesses: list[tuple[int, Polygon]],
    style: Style,
) -> list[tuple[int, Polygon]]:
    """Solid wedges that cut a corner or lean on a whole wall, away from doors and bays."""
    wedges = []
    for i, floor in enumerate(floors):
        if rng.random() >= style.slanted or min(floor.size) < 1.8:
            continue
        side = int(rng.integers(4))
        length, across = floor.size[side % 2], floor.size[1 - side % 2]
        legs = np.array([rng.uniform(0.2, 0.5) * length, rng.uniform(0.2, 0.5) * across])
        if rng.random() < 0.4:
            legs = np.array([length, rng.uniform(0.05, 0.2) * across])
        # A triangle on the wall: from the side's start along it, and from the start inwards.
        wedge = points_along(floor, side, np.array([-0.05, -0.05, legs[0]]), np.array([0.05, -legs[1], 0.05]))
        obstacles = [doorway for room, doorway in doorways if room == i]
        obstacles += [bounding_box(recess) for room, recess in recesses if room == i]
        if not any(bounding_box(wedge).meets(other) for other in obstacles):
            wedges.append((i, wedge))
    return wedges


#: Least length of wall next to a door [m].
JAMB_M = 0.08
#: Kinds of room that are often one open space.
SOCIAL = {"living", "dining", "kitchen", "hall", "open office", "great hall"}


@dataclass(frozen=True, kw_only=True)
class Room:
    """A room: its floor before bays are added and corners cut, and its purpose."""

    floor: Rect
    kind: str


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A door or a wide opening in the wall between two rooms."""

    rooms: tuple[int, int]
    """The two rooms, the one with the lower coordinate first."""
    hole: Rect
    """The part of the wall that is removed; it reaches a little into both rooms."""
    along_x: bool
    """Whether the wall runs along x."""
    width_m: float
    """Clear width."""

    @property
    def is_door(self) -> bool:
        """Whether a door leaf would fit."""
        return self.width_m <= 1.1

    def threshold(self, depth_m: float) -> Rect:
        """Floor in front of the opening on both sides, which stays free."""
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
    """Solid wedges with a slanted side, and posts: the room that they narrow, and their plan."""

    def bounds(self) -> Rect:
        """Around all floor."""
        corners = np.vstack(
            [room.floor.polygon() for room in self.rooms] + [floor for _, floor in self.recesses]
        )
        return Rect(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())


def lay_out(
    rng: np.random.Generator, *, area_m2: float, rooms: int, door_m: tuple[float, float], style: Style
) -> Layout:
    """Draw the rooms of a building at random.

    `area_m2` is the floor of all rooms without bays, before furniture. There are fewer `rooms`, which include
    corridors, if the area is too small; in a large building their number follows from their uses. `door_m` are least
    and largest clear widths.
    """
    uses: list[str] = []
    if isinstance(style, LargeStyle):
        cells, uses = cut_wings(rng, area_m2, style)
        is_hall = [use == "hall" for use in uses]
    else:
        spare = round(rng.uniform(0, style.left_out) * rooms) if rooms > 2 else 0
        cells, is_hall = cut(rng, area_m2, rooms + spare, style)
        rest = leave_out(rng, cells, is_hall, spare)
        cells, is_hall = [cells[i] for i in rest], [is_hall[i] for i in rest]
    wall_m = rng.uniform(0.1, 0.2)
    cells = to_area(cells, area_m2, wall_m)
    door_and_jambs_m = door_m[1] + wall_m + 2 * JAMB_M
    rest = largest_connected(shared_walls(cells, door_and_jambs_m), len(cells))
    cells, is_hall = [cells[i] for i in rest], [is_hall[i] for i in rest]
    walls = shared_walls(cells, door_and_jambs_m)
    floors = [cell.grown(-wall_m / 2) for cell in cells]
    kinds = [uses[i] for i in rest] if uses else _kinds(rng, floors, is_hall, walls, office=style is OFFICE)
    openings = [
        _opening(rng, pair, wall, wall_m, door_m, wide=wide)
        for pair, wall, wide in _joints(rng, kinds, walls, style)
    ]
    recesses = draw_recesses(rng, floors, wall_m, style)
    doorways = [(i, opening.threshold(0.7)) for opening in openings for i in opening.rooms]
    wedges = draw_wedges(rng, floors, doorways, recesses, style)
    if uses:
        wedges += [(i, post) for i, floor in enumerate(floors) for post in draw_posts(rng, floor)]
    return Layout(
        rooms=[Room(floor=floor, kind=kind) for floor, kind in zip(floors, kinds, strict=True)],
        openings=openings,
        recesses=recesses,
        wedges=wedges,
    )


def _kinds(
    rng: np.random.Generator,
    floors: list[Rect],
    is_hall: list[bool],
    neighbours: dict[tuple[int, int], SharedWall],
    *,
    office: bool,
) -> list[str]:
    """Purpose of each room, by its size and neighbours."""
    by_size = sorted((i for i in range(len(floors)) if not is_hall[i]), key=lambda i: -floors[i].area)
    kinds = ["hall"] * len(floors)
    for i in by_size:
        kinds[i] = _kind_by_size(rng, floors[i], office=office)
    living = by_size[0]
    kinds[living] = (
        "open office" if office and floors[living].area > 30 else "meeting" if office else "living"
    )
    neighbours_of_living = [b if a == living else a for a, b in neighbours if living in (a, b)]
    for kind, least, largest in [("kitchen", 5, 20), ("dining", 7, 25)]:
        fit = [
            i
            for i in neighbours_of_living
            if not is_hall[i] and kinds[i] not in SOCIAL and least < floors[i].area < largest
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
    rng: np.random.Generator, kinds: list[str], neighbours: dict[tuple[int, int], SharedWall], style: Style
) -> list[tuple[tuple[int, int], SharedWall, bool]]:
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
        both_social, are_corridors = {kinds[a], kinds[b]} <= SOCIAL, kinds[a] == kinds[b] == "hall"
        extra = rng.random() < style.loops * (2 if both_social else 1)
        wide = both_social and rng.random() < style.open_plan
        if tree or extra or are_corridors:
            chosen.append(((a, b), neighbours[a, b], wide or are_corridors))
            group = [group[a] if g == group[b] else g for g in group]
    return chosen


def _opening(
    rng: np.random.Generator,
    pair: tuple[int, int],
    shared: SharedWall,
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
