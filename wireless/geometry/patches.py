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

from wireless.geometry.array_types import Points
from wireless.geometry.facets import Surfaces, counted
from wireless.geometry.overlapping_faces import axes_in
from wireless.geometry.tolerance import NEAR_M

#: Most corners of a patch.
PATCH_CORNERS = 8
#: Outlines that fill their convex hull but for cracks thinner than this are convex [m].
_CRACK_M = 1e-12
#: Rounding of areas, as a fraction of them.
_ROUNDING = 1e-14
#: Corners nearer to the line between their neighbours are none [m].
_STRAIGHT_M = 1e-10
#: Facets of more triangles than this are joined one by one.
_LARGE = 64


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
    crack_m = surfaces.near_m - NEAR_M if surfaces.near_m > 2 * NEAR_M else 0.0
    axes = axes_in(surfaces.facet_normal)
    whole, facet, patch_of = _pieces(surfaces, axes, crack_m)
    hull = shapely.convex_hull(whole)
    outline = shapely.simplify(hull, max(_STRAIGHT_M, crack_m / 2))
    missing_m2 = shapely.area(hull) - shapely.area(whole)
    filled = missing_m2 <= max(_CRACK_M, crack_m) * shapely.length(hull)
    if crack_m:
        # What is missing is no crack if a disc as wide as a crack fits in, which is larger than the area here.
        rough = np.flatnonzero(filled & (missing_m2 > crack_m**2 / 2 - _ROUNDING * shapely.area(hull)))
        missing = shapely.difference(hull[rough], whole[rough])
        filled[rough] = shapely.is_empty(shapely.buffer(missing, -crack_m / 2))
    corners = shapely.get_num_coordinates(outline) - 1
    irregular = (corners < 3) | (corners > PATCH_CORNERS)
    outline[irregular], filled[irregular] = shapely.oriented_envelope(hull[irregular]), False
    order = np.argsort(patch_of, kind="stable")
    start = np.searchsorted(patch_of[order], np.arange(len(whole) + 1))
    flat, patch = shapely.get_coordinates(outline, return_index=True)
    window, corners = _padded(
        surfaces.facet_point[facet[patch]] + np.einsum("na,nai->ni", flat, axes[facet[patch]]), patch
    )
    # A triangle alone is its own window.
    alone = np.diff(surfaces.facet_start)[facet] == 1
    window[alone], corners[alone], filled[alone] = 0.0, 3, True
    window[alone, :3] = surfaces.triangle[order[start[:-1][alone]]]
    walls = np.where(filled, 1, np.diff(start))
    first_wall = np.cumsum(walls) - walls
    single = ~filled[patch_of]
    wall_of = first_wall[patch_of]
    wall_of[order] += single[order] * counted(np.diff(start))
    wall, wall_corners = np.zeros((walls.sum(), PATCH_CORNERS, 3)), np.full(walls.sum(), 3)
    wall[first_wall[filled]], wall_corners[first_wall[filled]] = window[filled], corners[filled]
    wall[wall_of[single], :3] = surfaces.triangle[single]
    if crack_m:
        window = _wider(window, corners, surfaces.facet_normal[facet], 2 * crack_m)
    return Patches(
        facet=facet,
        window=window,
        corners=corners,
        start=start,
        triangle=order,
        wall=wall,
        wall_corners=wall_corners,
        wall_of=wall_of,
    )


def _pieces(
    surfaces: Surfaces, axes: Float[np.ndarray, "f 2 3"], crack_m: float
) -> tuple[np.ndarray, Int[np.ndarray, " p"], Int[np.ndarray, " t"]]:
    """Outlines of the triangles of each facet that hang together, their facets, and the piece of each triangle."""
    facet = surfaces.triangle_facet
    flat = shapely.polygons(
        np.einsum("tki,tai->tka", surfaces.triangle - surfaces.facet_point[facet][:, None], axes[facet])
    )
    joined = np.empty(len(axes), object)
    large = np.diff(surfaces.facet_start) > _LARGE
    for f in np.flatnonzero(large):
        joined[f] = _union(flat[slice(*surfaces.facet_start[f : f + 2])])
    few = ~large[facet]
    if few.any():
        group = shapely.multipolygons(flat[few], indices=np.cumsum(~large)[facet[few]] - 1)
        joined[~large] = shapely.union_all(group[:, None], axis=1)
    if crack_m:
        joined = shapely.buffer(joined, crack_m / 2, join_style="mitre")
    whole, facet_of = shapely.get_parts(joined, return_index=True)
    piece = np.searchsorted(facet_of, facet)
    first = np.searchsorted(facet_of, np.arange(len(axes) + 1))
    for f in np.flatnonzero(np.diff(first) > 1):
        inside = slice(*surfaces.facet_start[f : f + 2])
        tree = shapely.STRtree(whole[first[f] : first[f + 1]])
        piece[inside] += tree.nearest(shapely.centroid(flat[inside]))
    used, piece = np.unique(piece, return_inverse=True)
    return whole[used], facet_of[used], piece


def _union(flat: np.ndarray) -> shapely.Geometry:
    """Union of many triangles in one plane."""
    # Triangles side by side cancel their common sides, which is faster by far; others make no valid shape of that area.
    try:
        joined = shapely.coverage_union_all(flat)
        is_exact = np.isclose(joined.area, shapely.area(flat).sum(), rtol=1e-9) and joined.is_valid
    except shapely.GEOSException:
        is_exact = False
    return joined if is_exact else shapely.union_all(flat)


def _padded(
    corner: Float[np.ndarray, "c 3"], polygon: Int[np.ndarray, " c"]
) -> tuple[Float[np.ndarray, "n m 3"], Int[np.ndarray, " n"]]:
    """Corners of closed rings by polygon, filled up with zeros, and their numbers."""
    corners = np.bincount(polygon) - 1
    padded = np.zeros((len(corners), PATCH_CORNERS, 3))
    place = counted(corners + 1)
    inner = place < corners[polygon]
    padded[polygon[inner], place[inner]] = corner[inner]
    return padded, corners


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
