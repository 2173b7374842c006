"""Polygons from the closed lines around them, and back."""

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from jaxtyping import Float, Int, Num


def rings_of(free: shapely.MultiPolygon) -> tuple[np.ndarray, Int[np.ndarray, " n"]]:
    """The closed lines of polygons, and which polygon each belongs to; its outer line comes first."""
    rings, owner = shapely.get_rings(shapely.get_parts(free), return_index=True)
    return rings, owner


def polygons_of(
    points: Sequence[Num[np.ndarray, "_ 2"]], owner: Int[np.ndarray, " n"]
) -> shapely.MultiPolygon:
    """Polygons from the corners of their closed lines, in the order of `rings_of`; valid or not.

    The last corner need not repeat the first; `owner` is the polygon that each line belongs to.
    """
    ring_of = np.repeat(np.arange(len(points)), [len(corners) for corners in points])
    return together(
        shapely.polygons(shapely.linearrings(np.concatenate(points), indices=ring_of), indices=owner)
    )


def together(polygons: Iterable[shapely.Polygon]) -> shapely.MultiPolygon:
    """The polygons as one, with free space on the left of each ring."""
    return shapely.MultiPolygon(list(shapely.orient_polygons(list(polygons))))


def triangulated(polygons: shapely.Geometry) -> Float[np.ndarray, "n 3 2"]:
    """Counter-clockwise triangles that fill polygons, with no vertices but theirs."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons))
    points = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    side, other = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    # All turn in the same direction, which rounding would hide for the thinnest alone.
    clockwise = (side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]).sum() < 0
    return points[:, ::-1] if clockwise else points
