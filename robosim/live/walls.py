"""Walls of a page from the outlines of free space alone, which every episode's log has.

Each side of an outline becomes an upright rectangle that faces free space. A page draws its front only: so a wall fades
as soon as the eye is behind it, from above and from inside. Outlines may be wound either way: those that lie within an
even number of others have free space inside of them.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from jaxtyping import Float, Int

#: How far a line along walls may be from them [m]: a line is some 4 cm wide where a flat fills the window.
EDGE_M = 0.05


def facing_free(rings: Sequence[Float[np.ndarray, "_ 2"]]) -> list[Float[np.ndarray, "_ 2"]]:
    """The same outlines, closed and wound so that free space is on the left of each side [m]."""
    found = []
    closed = [_closed(ring) for ring in rings]
    areas = [shapely.Polygon(ring) if len(ring) > 3 else None for ring in closed]
    for i, (ring, area) in enumerate(zip(closed, areas, strict=True)):
        if area is None or area.area == 0:
            continue
        inside = shapely.Point(shapely.LineString(ring[:2]).interpolate(0.5, normalized=True))
        around = sum(
            other is not None and other.area > area.area and other.contains(inside)
            for k, other in enumerate(areas)
            if k != i
        )
        outer = around % 2 == 0
        found.append(ring if shapely.LinearRing(ring).is_ccw == outer else ring[::-1])
    return found


def wall_mesh(
    rings: Sequence[Float[np.ndarray, "_ 2"]], height_m: float
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Vertices [m] and triangles of the walls along outlines, their fronts to free space.

    Args:
        rings: As of `facing_free`.
        height_m: Of the walls.
    """
    sides = wall_sides(rings)
    if not len(sides):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    a, b = sides[:, 0], sides[:, 1]
    low, high = np.zeros((len(a), 1)), np.full((len(a), 1), height_m)
    corners = np.stack(
        [np.hstack([a, low]), np.hstack([b, low]), np.hstack([b, high]), np.hstack([a, high])], axis=1
    )
    first = 4 * np.arange(len(a))[:, None]
    # Free space is on the left of a to b: seen from there, a is on the right, so that b, a, top of a turns left.
    triangles = np.concatenate([first + np.array([1, 0, 3]), first + np.array([1, 3, 2])])
    return corners.reshape(-1, 3), triangles


def wall_sides(rings: Sequence[Float[np.ndarray, "_ 2"]]) -> Float[np.ndarray, "n 2 2"]:
    """Ends of all sides of closed outlines [m]."""
    parts = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]
    return np.concatenate(parts) if parts else np.zeros((0, 2, 2))


def upper_edges(rings: Sequence[Float[np.ndarray, "_ 2"]], height_m: float) -> Float[np.ndarray, "n 2 3"]:
    """Lines along the tops of walls, so few that a browser without a graphics card draws them in time [m].

    Args:
        rings: As of `facing_free`; lines keep to them within `EDGE_M`.
        height_m: Of the walls.
    """
    sides = wall_sides([shapely.get_coordinates(shapely.LinearRing(r).simplify(EDGE_M)) for r in rings])
    return np.dstack([sides, np.full(sides.shape[:2], height_m)])


def floor_mesh(
    rings: Sequence[Float[np.ndarray, "_ 2"]],
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Vertices [m] and triangles of the free floor between outlines, at z = 0, their fronts up.

    Args:
        rings: As of `facing_free`.
    """
    outer = [shapely.Polygon(ring) for ring in rings if shapely.LinearRing(ring).is_ccw]
    inner = [shapely.Polygon(ring) for ring in rings if not shapely.LinearRing(ring).is_ccw]
    free = shapely.difference(shapely.union_all(outer), shapely.union_all(inner))
    corners: list[np.ndarray] = []
    for part in shapely.get_parts(free):
        # Triangles of Delaunay's that keep to the outline.
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        corners += [shapely.get_coordinates(shapely.orient_polygons(one))[:3] for one in triangles]
    if not corners:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    points = np.concatenate(corners)
    return np.column_stack([points, np.zeros(len(points))]), np.arange(len(points)).reshape(-1, 3)


def _closed(ring: Float[np.ndarray, "_ 2"]) -> Float[np.ndarray, "_ 2"]:
    ring = np.asarray(ring, float)
    return ring if len(ring) and np.array_equal(ring[0], ring[-1]) else np.vstack([ring, ring[:1]])
