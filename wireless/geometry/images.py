"""Image method: images of a point over chains of facets in space, and the windows that they look through.

Specular reflections come from the point mirrored at each patch that it sees; each image looks through its patch, at the
patches of the next order, and so on. A window is what its cone leaves of the patch (`wireless.geometry.cones`), so that
windows shrink with each reflection and most chains end soon, whatever the size of the building.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Planes, Point, Polygon
from wireless.geometry.cones import MAX_CORNERS, PIECES, clip_to_planes, may_see, side_planes, things_within
from wireless.geometry.space import Space, Windows


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


@compiled
def new_views(n: int, max_order: int) -> Views:
    """Room for views of chains of up to `max_order` facets."""
    return Views(
        np.zeros(n, np.int64),
        np.zeros((n, max_order), np.int64),
        np.zeros((n, max_order + 1, 3)),
        np.zeros((n, MAX_CORNERS, 3)),
        np.zeros(n, np.int64),
    )


@compiled
def _twice(views: Views) -> Views:
    """Return a copy with twice as much room."""
    return Views(
        np.concatenate((views.order, views.order)),
        np.concatenate((views.chain, views.chain)),
        np.concatenate((views.image, views.image)),
        np.concatenate((views.window, views.window)),
        np.concatenate((views.corners, views.corners)),
    )


@compiled
def cone_of(windows: Windows, views: Views, v: int, plane: Planes) -> int:
    """Planes around what a view may reach; the last is that of its facet, its normal away from the image.

    Returns their number; 0 if the view has no window, and so reaches everything.
    """
    order = views.order[v]
    if order == 0:
        return 0
    apex = views.image[v, order]
    n = side_planes(apex, views.window[v], views.corners[v], plane)
    patch = views.chain[v, order - 1]
    off = -windows.plane[patch, 3]
    for i in range(3):
        off += windows.plane[patch, i] * apex[i]
    sign = -1.0 if off > 0 else 1.0
    for i in range(4):
        plane[n, i] = sign * windows.plane[patch, i]
    return n + 1


@compiled
def open_view(
    windows: Windows,
    views: Views,
    v: int,
    patch: int,
    opened: Views,
    w: int,
    plane: Planes,
    n_planes: int,
    spare: Polygon,
) -> bool:
    """Whether a patch is in the cone of view v, whose planes are given; if so, view w of others is what it opens."""
    order, facet, n = views.order[v], windows.facet[patch], windows.corners[patch]
    off, reach = -windows.plane[patch, 3], -np.inf
    for i in range(3):
        off += windows.plane[patch, i] * views.image[v, order, i]
    if abs(off) < windows.near_m or (order > 0 and facet == windows.facet[views.chain[v, order - 1]]):
        return False
    if order > 0:
        for k in range(n):
            depth = -plane[n_planes - 1, 3]
            for i in range(3):
                depth += plane[n_planes - 1, i] * windows.window[patch, k, i]
            reach = max(reach, depth)
        if reach <= windows.near_m:
            return False
    n = clip_to_planes(windows.window[patch], n, plane, n_planes, opened.window[w], spare)
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
def add_next_views(
    space: Space,
    views: Views,
    v: int,
    count: int,
    occluding: bool,
    plane: Planes,
    patches: Int[np.ndarray, " p"],
    piece: Float[np.ndarray, "s k 3"],
) -> tuple[Views, int]:
    """Append the views of the next order that a view opens; all views and their number."""
    order, windows = views.order[v], space.windows
    n_planes = cone_of(windows, views, v, plane)
    apex, behind = views.image[v, order].copy(), np.zeros(4)
    # A view of its own: what it opens may take its place.
    parent = new_views(1, views.chain.shape[1])
    parent.order[0], parent.chain[0], parent.image[0] = order, views.chain[v], views.image[v]
    if order > 0:
        behind[:] = plane[n_planes - 1]
    for h in range(things_within(space.patch_boxes, plane, n_planes, patches)):
        if count == len(views.order):
            views = _twice(views)
        if not open_view(windows, parent, 0, patches[h], views, count, plane, n_planes, piece[0]):
            continue
        if occluding and not may_see(
            space.tree, space.walls, apex, behind, views.window[count], views.corners[count], piece
        ):
            continue
        count += 1
    return views, count


@compiled
def all_views(space: Space, source: Point, max_order: int, occluding: bool) -> tuple[Views, int]:
    """Views of a point over up to max_order facets, by order, and their number."""
    views, count = new_views(64, max_order), 1
    views.image[0, 0] = source
    plane, patches = np.empty((MAX_CORNERS + 1, 4)), np.empty(len(space.patch_facet), np.int64)
    piece = np.empty((PIECES, MAX_CORNERS, 3))
    now = 0
    while now < count and views.order[now] < max_order:
        views, count = add_next_views(space, views, now, count, occluding, plane, patches, piece)
        now += 1
    return views, count
