"""Corridors of made buildings, with irregular or regular pillars, and rooms at their ends."""

from tests.slam.beams import along, rectangle

#: Places of recesses and pillars along a corridor that repeat nowhere [m].
IRREGULAR = (2.0, 5.5, 7.0, 11.0, 12.5, 17.5, 20.0, 26.0, 29.5, 31.0)
REGULAR = tuple(3.0 * k + 1.0 for k in range(12))


def corridor(places: tuple[float, ...], *rooms: tuple[float, float, float, float]) -> list:
    """Walls of a corridor of 36 m x 2 m with pillars at its walls, and rooms at its ends."""
    pillars = [
        side
        for k, x in enumerate(places)
        for side in rectangle(x, 1.7 * (k % 2), x + 0.5, 1.7 * (k % 2) + 0.3)
    ]
    walls = [(0.0, 0.0, 36.0, 0.0), (0.0, 2.0, 36.0, 2.0)]
    for x0, y0, x1, y1 in rooms:
        side = x1 if x0 < 0 else x0
        sides = [(x0, y0, x1, y0), (x0, y1, x1, y1), (x0 + x1 - side, y0, x0 + x1 - side, y1)]
        walls += [*sides, (side, y0, side, 0.0), (side, 2.0, side, y1)]
    return [*walls, *pillars]


#: A corridor with a wide room at its west end and a deep one at its east end, and one with closed ends.
BUILDING = corridor(IRREGULAR, (-6.0, -3.0, 0.0, 5.0), (36.0, -1.0, 45.0, 3.0))
#: Routes of two robots that meet nowhere, and both see 16 m of the corridor.
WEST = along([(-4, 1), (24, 1)])
EAST = along([(42, 1), (8, 1)])
