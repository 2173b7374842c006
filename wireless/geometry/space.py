"""Triangles in space for tracing: facets that reflect, triangles that occlude and edges that diffract, in boxes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Point, Polygon
from wireless.geometry.boxes import Boxes, make_boxes
from wireless.geometry.cones import SLACK_M, Walls, may_see
from wireless.geometry.facets import Surfaces
from wireless.geometry.occlusion import Tree, depth_in, inward_of, leaf_around, make_tree
from wireless.geometry.patches import Patches, find_patches

#: Patches of more triangles have the one that holds a point looked up in the tree.
FEW_TRIANGLES = 8


class Panes(NamedTuple):
    """Patches by their planes and boxes."""

    plane: Float[np.ndarray, "p 4"]
    """Unit normal and level."""
    low: Float[np.ndarray, "p 3"]
    """Lowest corner of a box around each [m]."""
    high: Float[np.ndarray, "p 3"]
    """Highest corner."""


class Windows(NamedTuple):
    """Windows that views are opened by."""

    plane: Float[np.ndarray, "p 4"]
    """Unit normal and level of each patch."""
    facet: Int[np.ndarray, " p"]
    """Its facet."""
    window: Float[np.ndarray, "p k 3"]
    """Corners of a window around it."""
    corners: Int[np.ndarray, " p"]
    """Their number."""
    near_m: float
    """Tolerance of contact [m]."""


class Ground(NamedTuple):
    """Facets and edges that paths are laid out over."""

    plane: Float[np.ndarray, "p 4"]
    """Unit normal and level of each patch."""
    patch_facet: Int[np.ndarray, " p"]
    """Its facet."""
    start: Int[np.ndarray, " p1"]
    """Where each patch's triangles begin, and an end."""
    triangle: Float[np.ndarray, "t 3 3"]
    """Triangles by patch."""
    inward: Float[np.ndarray, "t 3 3"]
    """Unit vectors into each of these from its sides."""
    facet_normal: Float[np.ndarray, "f 3"]
    """Unit normal of each facet."""
    edge: Float[np.ndarray, "e 2 3"]
    """Ends of edges [m]."""
    edge_wedge: Float[np.ndarray, "e 3 3"]
    """Axes of each, see `wireless.geometry.facets.Surfaces`."""
    edge_gap_rad: Float[np.ndarray, " e"]
    """Open angle of each."""
    edge_facets: Int[np.ndarray, "e 2"]
    """Facets of 0-face and n-face."""
    near_m: float
    """Tolerance of contact [m]."""


class Space(NamedTuple):
    """Surfaces made ready for tracing."""

    surfaces: Surfaces
    """Facets and edges, around an origin of their own."""
    ground: Ground
    """Facets and edges that paths are laid out over."""
    windows: Windows
    """Windows that views are opened by."""
    panes: Panes
    """Planes and boxes of patches."""
    tree: Tree
    """Triangles that occlude."""
    tree_patch: Int[np.ndarray, " t"]
    """Patch of each triangle, in the tree's order."""
    tree_passes: Bool[np.ndarray, " t"]
    """Triangles that let paths through, in the tree's order."""
    walls: Walls
    """Convex walls, by which much is hidden at once."""
    mirrors: Bool[np.ndarray, " f"]
    """Facets that reflect."""
    passes: Bool[np.ndarray, " f"]
    """Facets that let paths through; half-spaces do not."""
    patch_facet: Int[np.ndarray, " p"]
    """Facet of each patch."""
    patch_boxes: Boxes
    """Patches that reflect, sorted into boxes; numbers are those of patches."""
    edge_boxes: Boxes
    """Edges, sorted into boxes."""


def make_space(
    surfaces: Surfaces,
    mirrors: Bool[np.ndarray, " f"],
    passes: Bool[np.ndarray, " f"],
    patches: Patches | None = None,
) -> Space:
    """Prepare what does not depend on antennas; `patches` are those of the surfaces, None to find them."""
    patches = patches or find_patches(surfaces)
    tree = make_tree(surfaces.triangle, surfaces.plane[surfaces.triangle_facet], surfaces.near_m)
    patch = np.empty(len(surfaces.triangle), np.int64)
    patch[patches.triangle] = np.repeat(np.arange(len(patches.facet)), np.diff(patches.start))
    triangle, plane = surfaces.triangle[patches.triangle], surfaces.plane[patches.facet]
    used = (np.arange(patches.window.shape[1]) < patches.corners[:, None])[..., None]
    low = np.where(used, patches.window, np.inf).min(axis=1)
    high = np.where(used, patches.window, -np.inf).max(axis=1)
    reflecting = np.flatnonzero(mirrors[patches.facet])
    boxes = make_boxes(low[reflecting], high[reflecting])
    return Space(
        surfaces=surfaces,
        ground=Ground(
            plane=plane,
            patch_facet=patches.facet,
            start=patches.start,
            triangle=triangle,
            inward=inward_of(triangle, np.repeat(plane[:, :3], np.diff(patches.start), axis=0)),
            facet_normal=surfaces.facet_normal,
            edge=surfaces.edge,
            edge_wedge=surfaces.edge_wedge,
            edge_gap_rad=surfaces.edge_gap_rad,
            edge_facets=surfaces.edge_facets,
            near_m=surfaces.near_m,
        ),
        windows=Windows(plane, patches.facet, patches.window, patches.corners, surfaces.near_m),
        panes=Panes(plane, low, high),
        tree=tree,
        tree_patch=patch[tree.number],
        tree_passes=passes[surfaces.triangle_facet[tree.number]],
        walls=Walls(patches.wall_of[tree.number], patches.wall, patches.wall_corners),
        mirrors=mirrors,
        passes=passes,
        patch_facet=patches.facet,
        patch_boxes=boxes._replace(number=reflecting[boxes.number]),
        edge_boxes=make_boxes(surfaces.edge.min(axis=1), surfaces.edge.max(axis=1)),
    )


@compiled
def in_large_patch(tree: Tree, tree_patch: Int[np.ndarray, " t"], patch: int, p: Point) -> bool:
    """Whether a point of a patch's plane lies in one of its triangles, found in the tree; sides count."""
    stack = np.zeros(64, np.int64)
    first, last, depth = leaf_around(tree, p, SLACK_M, stack, 1)
    while depth >= 0:
        for t in range(first, last):
            mine = tree_patch[t] == patch
            if mine and depth_in(tree.triangle, tree.inward, t, p[0], p[1], p[2]) >= -tree.near_m:
                return True
        first, last, depth = leaf_around(tree, p, SLACK_M, stack, depth)
    return False


@compiled
def aside_m(near_m: float) -> float:
    """How far next to a target that is [m]: well beyond what touches."""
    return max(1e-6, 30 * near_m)


@compiled
def may_see_line(
    space: Space,
    image: Point,
    behind: Float[np.ndarray, "4"],
    line: Polygon,
    strip: Float[np.ndarray, "4 3"],
    piece: Float[np.ndarray, "s k 3"],
) -> bool:
    """Whether an image may see a line or what touches it, see `may_see`; `strip` and `piece` are work arrays."""
    size, across = 0.0, np.empty(3)
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        across[i] = (line[1, a] - line[0, a]) * (image[b] - line[0, b]) - (line[1, b] - line[0, b]) * (
            image[a] - line[0, a]
        )
        size += across[i] ** 2
    across *= aside_m(space.tree.near_m) / np.sqrt(size) if size > 0 else 0.0
    for i in range(3):
        strip[0, i], strip[1, i] = line[0, i] - across[i], line[1, i] - across[i]
        strip[2, i], strip[3, i] = line[1, i] + across[i], line[0, i] + across[i]
    return may_see(space.tree, space.walls, image, behind, strip, 4, piece)
