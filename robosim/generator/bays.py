"""Alcoves, bays and wings that widen rooms, and wedges that cut their corners, for slanted walls.

They are added to rooms that have been laid out: recesses where nothing lies behind a wall, wedges where there is no
door and no recess.
"""

import numpy as np

from robosim.generator.building_style import Style
from robosim.generator.rect import Polygon, Rect, bounding_box, points_along


def draw_recesses(
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
            box = bounding_box(recess)
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
    return points_along(floor, side, u, v)


def draw_wedges(
    rng: np.random.Generator,
    floors: list[Rect],
    doorways: list[tuple[int, Rect]],
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
        wedge = points_along(floor, side, np.array([-0.05, -0.05, legs[0]]), np.array([0.05, -legs[1], 0.05]))
        obstacles = [doorway for room, doorway in doorways if room == i]
        obstacles += [bounding_box(recess) for room, recess in recesses if room == i]
        if not any(bounding_box(wedge).meets(other) for other in obstacles):
            found.append((i, wedge))
    return found
