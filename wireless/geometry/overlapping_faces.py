"""Sheets that lie on each other in one plane: which of them is met.

Faces of several materials may cover the same place: a wall drawn twice, a picture on a wall, a sheet just
before another. Closer than the tolerance it is unknown which is in front, and a path must be reflected once, so there
is one surface: of the material that comes first. The others go on where they are not covered.
"""

import numpy as np
import shapely
from jaxtyping import Float, Int

from wireless.geometry.array_types import Triangles


def axes_in(normal: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2 3"]:
    """Two unit vectors at right angles to each other and to each unit normal."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=-1)])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([across, np.cross(normal, across)], axis=-2)


def without_overlaps(
    triangle: Triangles,
    plane: Int[np.ndarray, " t"],
    material: Int[np.ndarray, " t"],
    normal: Float[np.ndarray, "g 3"],
    tolerance_m: float,
) -> tuple[Float[np.ndarray, "n 3 3"], Int[np.ndarray, " n"]]:
    """Triangles, cut to what no sheet of a lower material covers; and which triangle each was part of."""
    low, high = np.full(len(normal), np.inf), np.full(len(normal), -np.inf)
    np.minimum.at(low, plane, material)
    np.maximum.at(high, plane, material)
    parts, source = [triangle], [np.arange(len(triangle))]
    visible = np.ones(len(triangle), bool)
    for g in np.flatnonzero(high > low):
        members = np.flatnonzero(plane == g)
        base, axes = triangle[members[0], 0], axes_in(normal[g])
        flat = shapely.polygons((triangle[members] - base) @ axes.T)
        for sheet in np.unique(material[members])[1:]:
            in_sheet = material[members] == sheet
            cover = shapely.union_all(flat[material[members] < sheet])
            hidden = np.zeros(len(members), bool)
            hidden[in_sheet] = _is_wide(shapely.intersection(flat[in_sheet], cover), tolerance_m)
            visible[members[hidden]] = False
            rest, which = shapely.get_parts(shapely.difference(flat[hidden], cover), return_index=True)
            wide = _is_wide(rest, tolerance_m)
            cut, of = shapely.get_parts(shapely.constrained_delaunay_triangles(rest[wide]), return_index=True)
            corners = shapely.get_coordinates(cut).reshape(-1, 4, 2)[:, :3]
            parts.append(base + corners @ axes)
            source.append(members[hidden][which[wide][of]])
    parts[0], source[0] = triangle[visible], source[0][visible]
    return np.concatenate(parts), np.concatenate(source)


def _is_wide(shape: np.ndarray, tolerance_m: float) -> np.ndarray:
    """Which shapes are more than slivers."""
    return ~shapely.is_empty(shapely.buffer(shape, -tolerance_m))
