"""Images of a point over chains of facets in space, and the windows that they look through.

The point is mirrored at each patch that it sees; each image looks through its patch, at the patches of the
next order, and so on. A window is what its cone leaves of the patch (`wireless.geometry.cones`), so that windows
shrink with each reflection and most chains end soon, whatever the size of the building.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from wireless.geometry.boxes import Boxes, make_boxes
from wireless.geometry.cones import MAX_CORNERS, PIECES, SLACK_M, clipped, meeting, sees, sides
from wireless.geometry.facets import Surfaces
from wireless.geometry.occlusion import Tree, box_holds, holds, inward_of, make_tree
from wireless.geometry.patches import find_patches
from wireless.support.compiled import compiled

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


class Space(NamedTuple):
    """Surfaces made ready for tracing."""

    surfaces: Surfaces
    """Facets and edges, around an origin of their own."""
    tree: Tree
    """What hides."""
    tree_patch: Int[np.ndarray, " t"]
    """Patch of each triangle, in the tree's order."""
    tree_wall: Int[np.ndarray, " t"]
    """Wall of each triangle, in the tree's order."""
    wall: Float[np.ndarray, "w k 3"]
    """Corners of convex walls."""
    wall_corners: Int[np.ndarray, " w"]
    """Number of corners of each wall."""
    tree_passes: Bool[np.ndarray, " t"]
    """Triangles that let paths through, in the tree's order."""
    mirrors: Bool[np.ndarray, " f"]
    """Facets that reflect."""
    passes: Bool[np.ndarray, " f"]
    """Facets that let paths through; half-spaces do not."""
    patch_facet: Int[np.ndarray, " p"]
    """Facet of each patch."""
    window: Float[np.ndarray, "p k 3"]
    """Corners of a window around each patch."""
    corners: Int[np.ndarray, " p"]
    """Number of corners of each window."""
    panes: Panes
    """Planes and boxes of patches."""
    start: Int[np.ndarray, " p1"]
    """Where each patch's triangles begin, and an end."""
    triangle: Float[np.ndarray, "t 3 3"]
    """Triangles by patch."""
    inward: Float[np.ndarray, "t 3 3"]
    """Unit vectors into each of these from its sides."""
    patch_boxes: Boxes
    """Patches that reflect, sorted into boxes; numbers are those of patches."""
    edge_boxes: Boxes
    """Edges, sorted into boxes."""


class Windows(NamedTuple):
    """What views are opened by: few arrays, as to hand all of a space on takes longer than to open one."""

    plane: Float[np.ndarray, "p 4"]
    """Unit normal and level of each patch."""
    facet: Int[np.ndarray, " p"]
    """Its facet."""
    window: Float[np.ndarray, "p k 3"]
    """Corners of a window around it."""
    corners: Int[np.ndarray, " p"]
    """Their number."""
    near_m: float
    """What is closer than this touches."""


class Views(NamedTuple):
    """Images with their windows, the first without one."""

    order: Int[np.ndarray, " v"]
    """Number of reflections."""
    chain: Int[np.ndarray, "v m"]
    """Patches that were mirrored at, the first from the source first."""
    image: Float[np.ndarray, "v m1 3"]
    """Source, mirrored at none of these, at one, and so on [m]."""
    window: Float[np.ndarray, "v k 3"]
    """Corners of the window in the last patch [m]."""
    corners: Int[np.ndarray, " v"]
    """Number of its corners."""


def make_space(surfaces: Surfaces, mirrors: Bool[np.ndarray, " f"], passes: Bool[np.ndarray, " f"]) -> Space:
    """Prepare what does not depend on antennas.

    Args:
        surfaces: Facets and edges.
        mirrors: Facets that reflect.
        passes: Facets that let paths through.
    """
    patches = find_patches(surfaces)
    tree = make_tree(surfaces.triangle, surfaces.plane[surfaces.triangle_facet], surfaces.near_m)
    patch = np.empty(len(surfaces.triangle), np.int64)
    patch[patches.triangle] = np.repeat(np.arange(len(patches.facet)), np.diff(patches.start))
    triangle = surfaces.triangle[patches.triangle]
    shining = np.flatnonzero(mirrors[patches.facet])
    plane = surfaces.plane[patches.facet]
    used = (np.arange(patches.window.shape[1]) < patches.corners[:, None])[..., None]
    low = np.where(used, patches.window, np.inf).min(axis=1)
    high = np.where(used, patches.window, -np.inf).max(axis=1)
    boxes = make_boxes(low[shining], high[shining])
    return Space(
        surfaces=surfaces,
        tree=tree,
        tree_patch=patch[tree.number],
        tree_wall=patches.wall_of[tree.number],
        wall=patches.wall,
        wall_corners=patches.wall_corners,
        tree_passes=passes[surfaces.triangle_facet[tree.number]],
        mirrors=mirrors,
        passes=passes,
        patch_facet=patches.facet,
        window=patches.window,
        corners=patches.corners,
        panes=Panes(plane, low, high),
        start=patches.start,
        triangle=triangle,
        inward=inward_of(triangle, np.repeat(plane[:, :3], np.diff(patches.start), axis=0)),
        patch_boxes=boxes._replace(number=shining[boxes.number]),
        edge_boxes=make_boxes(surfaces.edge.min(axis=1), surfaces.edge.max(axis=1)),
    )


@compiled
def in_large_patch(
    tree: Tree, tree_patch: Int[np.ndarray, " t"], patch: int, p: Float[np.ndarray, "3"]
) -> bool:
    """Whether a point of a patch's plane lies in one of its triangles, found in the tree; sides count."""
    stack = np.empty(64, np.int64)
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        box = stack[depth]
        if not box_holds(tree, box, p, SLACK_M):
            continue
        one, other = tree.child[box]
        if one >= 0:
            stack[depth], stack[depth + 1] = one, other
            depth += 2
            continue
        for t in range(-1 - one, -1 - one + other):
            if tree_patch[t] == patch and holds(
                tree.triangle[t : t + 1], tree.inward[t : t + 1], p, tree.near_m
            ):
                return True
    return False


@compiled
def new_views(n: int, most: int) -> Views:
    """Room for views of chains of up to `most` facets."""
    return Views(
        np.zeros(n, np.int64),
        np.zeros((n, most), np.int64),
        np.zeros((n, most + 1, 3)),
        np.zeros((n, MAX_CORNERS, 3)),
        np.zeros(n, np.int64),
    )


@compiled
def _twice(views: Views) -> Views:
    """The same with twice as much room."""
    return Views(
        np.concatenate((views.order, views.order)),
        np.concatenate((views.chain, views.chain)),
        np.concatenate((views.image, views.image)),
        np.concatenate((views.window, views.window)),
        np.concatenate((views.corners, views.corners)),
    )


@compiled
def windows_of(space: Space) -> Windows:
    """What views in a space are opened by."""
    return Windows(space.panes.plane, space.patch_facet, space.window, space.corners, space.tree.near_m)


@compiled
def cone_of(windows: Windows, views: Views, v: int, plane: Float[np.ndarray, "p 4"]) -> int:
    """Planes around what a view may reach; the last is that of its facet, its normal away from the image.

    Returns:
        Number of planes; 0 if the view has no window, and so reaches everything.
    """
    order = views.order[v]
    if order == 0:
        return 0
    apex = views.image[v, order]
    n = sides(apex, views.window[v], views.corners[v], plane)
    patch = views.chain[v, order - 1]
    off = -windows.plane[patch, 3]
    for i in range(3):
        off += windows.plane[patch, i] * apex[i]
    sign = -1.0 if off > 0 else 1.0
    for i in range(4):
        plane[n, i] = sign * windows.plane[patch, i]
    return n + 1


@compiled
def opens(
    windows: Windows,
    views: Views,
    v: int,
    patch: int,
    opened: Views,
    w: int,
    plane: Float[np.ndarray, "p 4"],
    n_planes: int,
    spare: Float[np.ndarray, "k 3"],
) -> bool:
    """Whether a patch is in the cone of view v, whose planes are given; if so, view w of others is what it opens."""
    order, facet = views.order[v], windows.facet[patch]
    off, reach = -windows.plane[patch, 3], -np.inf
    for i in range(3):
        off += windows.plane[patch, i] * views.image[v, order, i]
    if abs(off) < windows.near_m or (order > 0 and facet == windows.facet[views.chain[v, order - 1]]):
        return False
    n = windows.corners[patch]
    if order > 0:
        for k in range(n):
            depth = -plane[n_planes - 1, 3]
            for i in range(3):
                depth += plane[n_planes - 1, i] * windows.window[patch, k, i]
            reach = max(reach, depth)
        if reach <= windows.near_m:
            return False
    n = clipped(windows.window[patch], n, plane, n_planes, opened.window[w], spare)
    if n == 0:
        return False
    opened.order[w], opened.corners[w] = order + 1, n
    for k in range(order):
        opened.chain[w, k] = views.chain[v, k]
    for k in range(order + 1):
        for i in range(3):
            opened.image[w, k, i] = views.image[v, k, i]
    opened.chain[w, order] = patch
    for i in range(3):
        opened.image[w, order + 1, i] = views.image[v, order, i] - 2 * off * windows.plane[patch, i]
    return True


@compiled
def spread(
    space: Space,
    views: Views,
    v: int,
    count: int,
    occluding: bool,
    plane: Float[np.ndarray, "p 4"],
    found: Int[np.ndarray, " p"],
    piece: Float[np.ndarray, "s k 3"],
) -> tuple[Views, int]:
    """Append the views of the next order that a view opens; all views and their number.

    Args:
        space: Surfaces.
        views: Views so far.
        v: The one to go on from.
        count: How many there are.
        occluding: Whether patches that are hidden are left out.
        plane: Room for planes.
        found: Room for patches.
        piece: Room for polygons.
    """
    order, windows = views.order[v], windows_of(space)
    n_planes = cone_of(windows, views, v, plane)
    apex, behind = views.image[v, order].copy(), np.zeros(4)
    # A view of its own: what it opens may take its place.
    own = new_views(1, views.chain.shape[1])
    own.order[0], own.chain[0], own.image[0] = order, views.chain[v], views.image[v]
    if order > 0:
        behind[:] = plane[n_planes - 1]
    for h in range(meeting(space.patch_boxes, plane, n_planes, found)):
        if count == len(views.order):
            views = _twice(views)
        if not opens(windows, own, 0, found[h], views, count, plane, n_planes, piece[0]):
            continue
        if occluding and not sees(
            space.tree,
            space.tree_wall,
            space.wall,
            space.wall_corners,
            apex,
            behind,
            views.window[count],
            views.corners[count],
            piece,
        ):
            continue
        count += 1
    return views, count


@compiled
def all_views(
    space: Space, source: Float[np.ndarray, "3"], max_order: int, occluding: bool
) -> tuple[Views, int]:
    """Views of a point over up to max_order facets, by order, and their number."""
    views, count = new_views(64, max_order), 1
    views.image[0, 0] = source
    plane, found = np.empty((MAX_CORNERS + 1, 4)), np.empty(len(space.patch_facet), np.int64)
    piece = np.empty((PIECES, MAX_CORNERS, 3))
    now = 0
    while now < count and views.order[now] < max_order:
        views, count = spread(space, views, now, count, occluding, plane, found, piece)
        now += 1
    return views, count
