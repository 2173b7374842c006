"""Cutting a rectangle into rooms by straight cuts, the largest piece first.

Often a corridor is laid through it before; pieces may be left out at the end, which gives L-, U- and T-shaped
buildings and solid blocks. Pieces reach to the middle of the walls between them.

Reference for rooms by cutting rectangles: Marson and Musse, "Automatic real-time generation of floor plans
based on squarified treemaps algorithm", Int. J. Computer Games Technology (2010). Here cuts are drawn at
random rather than packed, since training needs variety, not the best plan.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from robosim.generator.canvas import Rect


@dataclass(frozen=True, kw_only=True)
class Style:
    """Layout and furniture of a kind of building."""

    aspect: tuple[float, float] = (1.0, 1.0)
    """Long over short side of the building, least and most."""
    corridor_chance: float = 1.0
    """Chance that a building of four rooms or more has a corridor."""
    corridor_m: tuple[float, float]
    """Width of corridors."""
    narrowest_m: float
    """Smallest side of a room, between wall axes."""
    uneven: float
    """Spread of room sizes: standard deviation of their logarithm."""
    left_out: float = 0.0
    """Largest share of pieces that are no rooms."""
    loops: float
    """Chance of a second door where two rooms are neighbours."""
    open_plan: float
    """Chance that two social rooms share a wide opening instead of a door."""
    recess: float = 0.0
    """Chance of an alcove or bay, for each free side of a room."""
    slanted: float = 0.0
    """Chance of a slanted wall, for each room."""
    crowding: float
    """Number of pieces of the usual furniture, relative to the lists of pieces."""


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


def cut(rng: np.random.Generator, area_m2: float, n: int, style: Style) -> tuple[list[Rect], list[bool]]:
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


def leave_out(rng: np.random.Generator, cells: list[Rect], is_hall: list[bool], n: int) -> list[int]:
    """Drop up to n pieces so that the others stay connected; returns the remaining ones."""
    rest = list(range(len(cells)))
    touching = list(shared_walls(cells, 1.0))
    for i in rng.permutation(len(cells)).tolist():
        links = [pair for pair in touching if i not in pair]
        if (
            len(rest) + n > len(cells)
            and not is_hall[i]
            and len(largest_connected(links, len(cells))) == len(rest) - 1
        ):
            rest.remove(i)
            touching = links
    return rest


class SharedWall(NamedTuple):
    """The stretch of wall axis that two pieces share."""

    along_x: bool
    at: float
    low: float
    high: float


def shared_walls(cells: list[Rect], shortest_m: float) -> dict[tuple[int, int], SharedWall]:
    """Pairs of pieces that share a stretch of wall of some length; the lower of the two first."""
    walls = {}
    for i, j in combinations(range(len(cells)), 2):
        for a, b in ((i, j), (j, i)):
            p, q = cells[a], cells[b]
            if abs(p.y1 - q.y0) < 1e-6:
                shared = SharedWall(True, p.y1, max(p.x0, q.x0), min(p.x1, q.x1))
            elif abs(p.x1 - q.x0) < 1e-6:
                shared = SharedWall(False, p.x1, max(p.y0, q.y0), min(p.y1, q.y1))
            else:
                continue
            if shared.high - shared.low >= shortest_m:
                walls[a, b] = shared
    return walls


def largest_connected(links: Iterable[tuple[int, int]], n: int) -> list[int]:
    """The largest connected set of pieces."""
    group = list(range(n))
    for a, b in links:
        group = [group[a] if g == group[b] else g for g in group]
    largest = max(group, key=group.count)
    return [i for i in range(n) if group[i] == largest]


def to_area(cells: list[Rect], area_m2: float, wall_m: float) -> list[Rect]:
    """Scale pieces so that, without walls, they have a given area in all."""
    # sum of (w s - t) (h s - t) over all pieces is quadratic in the scale s
    a = sum(cell.area for cell in cells)
    b = -wall_m * sum(sum(cell.size) for cell in cells)
    c = len(cells) * wall_m**2 - area_m2
    scale = float((-b + np.sqrt(b * b - 4 * a * c)) / (2 * a))
    return [Rect(*(scale * v for v in cell)) for cell in cells]
