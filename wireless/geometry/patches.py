"""Facets in patches, each of which reflects as one, and in convex walls, each of which hides as one.

The triangles of a facet that hang together are a patch. If they fill a convex outline with few corners, as
the two halves of a wall do, that is its window and also one wall. Any other patch, such as a floor, is looked
through by a window around it, and hides by triangles. Large walls hide much at once, and few patches are few
windows. Where corners were rounded, cracks that this leaves between triangles are shut, and windows are as much wider.
"""

from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int

from wireless.geometry.array_types import Point, Points, Polygon
from wireless.geometry.facets import Surfaces
from wireless.geometry.overlapping_faces import axes_in
from wireless.geometry.tolerance import NEAR_M

#: Most corners of a patch.
PATCH_CORNERS = 8
#: Outlines that fill their convex hull but for cracks thinner than this are convex [m].
_CRACK_M = 1e-12
#: Corners nearer to the line between their neighbours are none [m].
_STRAIGHT_M = 1e-10


class Patches(NamedTuple):
    """Pieces of facets, and convex walls."""

    facet: Int[np.ndarray, " p"]
    """Facet of each patch."""
    window: Float[np.ndarray, "p k 3"]
    """Corners around each patch [m]; zeros beyond the last."""
    corners: Int[np.ndarray, " p"]
    """Number of corners of each."""
    start: Int[np.ndarray, " p1"]
    """Where each patch's triangles begin in `triangle`, and an end."""
    triangle: Int[np.ndarray, " t"]
    """Triangles of the surfaces, by patch."""
    wall: Float[np.ndarray, "w k 3"]
    """Corners of convex walls; zeros beyond the last."""
    wall_corners: Int[np.ndarray, " w"]
    """Number of corners of each."""
    wall_of: Int[np.ndarray, " t"]
    """Wall of each triangle of the surfaces."""


def find_patches(surfaces: Surfaces) -> Patches:
    """Patches and walls of all facets."""
    windows: list[np.ndarray] = []
    members: list[np.ndarray] = []
    facets: list[int] = []
    walls: list[np.ndarray] = []
    wall_of = np.empty(len(surfaces.triangle), np.int64)
    crack_m = surfaces.near_m - NEAR_M if surfaces.near_m > 2 * NEAR_M else 0.0
    for facet, (first, last) in enumerate(
        zip(surfaces.facet_start[:-1], surfaces.facet_start[1:], strict=True)
    ):
        group = surfaces.triangle[first:last]
        alone = [(group[0], np.zeros(1, int), True)]
        plane = surfaces.facet_point[facet], surfaces.facet_normal[facet]
        parts = alone if len(group) == 1 else _parts(group, *plane, crack_m)
        for window, which, filled in parts:
            windows.append(window)
            members.append(first + which)
            facets.append(facet)
            wall_of[first + which] = len(walls) + (0 if filled else np.arange(len(which)))
            walls += [window] if filled else list(group[which])
    window, corners = _padded(windows)
    if crack_m:
        window = _wider(window, corners, surfaces.facet_normal[facets], 2 * crack_m)
    wall, wall_corners = _padded(walls)
    return Patches(
        facet=np.array(facets, np.int64),
        window=window,
        corners=corners,
        start=np.append(0, np.cumsum([len(m) for m in members])).astype(np.int64),
        triangle=np.concatenate(members).astype(np.int64),
        wall=wall,
        wall_corners=wall_corners,
        wall_of=wall_of,
    )


def _padded(polygons: list[np.ndarray]) -> tuple[Float[np.ndarray, "n m 3"], Int[np.ndarray, " n"]]:
    """Corners of polygons, filled up with zeros, and their numbers."""
    corner = np.zeros((len(polygons), PATCH_CORNERS, 3))
    for i, polygon in enumerate(polygons):
        corner[i, : len(polygon)] = polygon
    return corner, np.array([len(p) for p in polygons], np.int64)


def _wider(
    window: Float[np.ndarray, "n m 3"], corners: Int[np.ndarray, " n"], normal: Points, by_m: float
) -> Float[np.ndarray, "n m 3"]:
    """Convex polygons whose sides are moved outwards."""
    row, k = np.arange(len(window))[:, None], np.arange(window.shape[1])
    after = window[row, np.where(k + 1 < corners[:, None], k + 1, 0)]
    out = np.cross(after - window, normal[:, None])
    out /= np.maximum(np.linalg.norm(out, axis=2, keepdims=True), NEAR_M)
    before = out[row, np.where(k > 0, k, corners[:, None]) - 1]
    turn = np.sign(np.einsum("nki,nki->nk", np.cross(before, out), normal[:, None]).sum(axis=1))
    step = (before + out) / np.maximum(1 + np.einsum("nki,nki->nk", before, out), 0.01)[..., None]
    return np.where((k < corners[:, None])[..., None], window + by_m * turn[:, None, None] * step, 0.0)


def _parts(
    triangle: Float[np.ndarray, "n 3 3"], base: Point, normal: Point, crack_m: float
) -> list[tuple[Polygon, Int[np.ndarray, " m"], bool]]:
    """Window and triangles of each part of triangles in one plane, and whether they fill the window."""
    axes = axes_in(normal)
    flat = shapely.polygons((triangle - base) @ axes.T)
    if crack_m:
        flat = shapely.buffer(flat, crack_m / 2, join_style="mitre")
    parts = shapely.get_parts(shapely.union_all(flat))
    component = shapely.STRtree(parts).nearest(shapely.centroid(flat))
    components: list[tuple[np.ndarray, np.ndarray, bool]] = []
    for i, whole in enumerate(parts):
        which, hull = np.flatnonzero(component == i), whole.convex_hull
        if not len(which):
            continue
        outline = hull.simplify(max(_STRAIGHT_M, crack_m / 2))
        filled = hull.area - whole.area <= max(_CRACK_M, crack_m) * hull.length
        filled &= not crack_m or hull.difference(whole).buffer(-crack_m / 2).is_empty
        if not 3 <= len(outline.exterior.coords) - 1 <= PATCH_CORNERS:
            outline, filled = hull.oriented_envelope, False
        components.append((base + shapely.get_coordinates(outline)[:-1] @ axes, which, bool(filled)))
    return components
