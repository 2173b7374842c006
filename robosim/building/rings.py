"""Polygons from the closed lines around them, and back."""

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from jaxtyping import Int, Num


def rings_of(free: shapely.MultiPolygon) -> tuple[np.ndarray, Int[np.ndarray, " n"]]:
    """The closed lines of polygons, and which polygon each belongs to; its outer line comes first."""
    rings, owner = shapely.get_rings(shapely.get_parts(free), return_index=True)
    return rings, owner


def polygons_of(
    points: Sequence[Num[np.ndarray, "_ 2"]], owner: Int[np.ndarray, " n"]
) -> shapely.MultiPolygon:
    """Polygons from the corners of their closed lines, in the order of `rings_of`; valid or not.

    Args:
        points: Corners of each line; the last need not repeat the first.
        owner: Which polygon each line belongs to.
    """
    ring_of = np.repeat(np.arange(len(points)), [len(corners) for corners in points])
    return together(
        shapely.polygons(shapely.linearrings(np.concatenate(points), indices=ring_of), indices=owner)
    )


def together(polygons: Iterable[shapely.Polygon]) -> shapely.MultiPolygon:
    """The polygons as one, with free space on the left of each ring."""
    return shapely.MultiPolygon(list(shapely.orient_polygons(list(polygons))))


def split_at_touches(
    outlines: list[Num[np.ndarray, "_ 2"]], owner: Int[np.ndarray, " n"]
) -> tuple[list[Num[np.ndarray, "_ 2"]], Int[np.ndarray, " m"]]:
    """Closed lines that pass no corner twice: a line that does is split there into several.

    Args:
        outlines: Corners of each line, free space on its left.
        owner: Which polygon each line belongs to; its outer line comes first.
    """
    parts, owners = [], []
    for number, (outline, of) in enumerate(zip(outlines, owner.tolist(), strict=True)):
        loops = _loops(list(map(tuple, outline.tolist())))
        if number == 0 or of != owner[number - 1]:  # the outer line, which alone runs counter-clockwise
            loops.sort(key=signed_area, reverse=True)
        parts += loops
        owners += [of] * len(loops)
    return parts, np.array(owners)


def _loops(points: list[tuple[float, float]]) -> list[Num[np.ndarray, "_ 2"]]:
    """The simple loops of a closed line that may pass points more than once."""
    if len(set(points)) == len(points):
        return [np.array(points)]
    loops, path = [], list[tuple[float, float]]()
    place: dict[tuple[float, float], int] = {}
    for point in [*points, points[0]]:
        if point in place:
            loops.append(path[place[point] :])
            for passed in loops[-1]:
                del place[passed]
            del path[-len(loops[-1]) :]
        place[point] = len(path)
        path.append(point)
    return [np.array(loop) for loop in loops]


def signed_area(line: Num[np.ndarray, "_ 2"]) -> float:
    """Area inside of a closed line, negative when it runs clockwise."""
    x, y = line.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
