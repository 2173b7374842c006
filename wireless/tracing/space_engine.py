"""The strongest paths of links among any triangles: image method over facets, edges, occlusion of each leg.

Chains of images of the transmitter are walked depth first (`wireless.geometry.images`). For each receiver in the cone
of an image the path is followed back from the receiver; it counts if each point lies in its facet and its legs meet no
more walls than may be passed. At an edge the parts from both ends are unfolded into one straight line (the ray leaves
at the angle it arrives, Keller's law), which gives the point on the edge: edges that images of the transmitter see are
joined with those in the cones of the receiver's images.

Nothing is sampled. What cannot enter a link's list is not computed, by the bounds that floor plans have too
(`wireless.tracing.plan_engine`), which are faster and find the same paths.
"""

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.em.diffraction import edge_bound
from wireless.em.fields import NOWHERE_M
from wireless.geometry.array_types import Point
from wireless.geometry.boxes import Boxes
from wireless.geometry.cones import MAX_CORNERS, PIECES, SLACK_M, clip_to_planes, things_within
from wireless.geometry.images import Views, add_next_views, all_views, cone_of, new_views
from wireless.geometry.space import Space, may_see_line
from wireless.tracing.path_layout import Chain, edge_sight, is_open, lay_out
from wireless.tracing.space_paths import (
    Links,
    Workspace,
    enter_laid,
    link_of,
    make_links,
    make_workspace,
    table_of,
)
from wireless.tracing.table import Setting, Table

#: With fewer receivers, trying each costs less than finding out whether the last patch is seen at all.
_FEW = 32


@compiled
def _enter_view(
    space: Space, setting: Setting, links: Links, rx_boxes: Boxes, views: Views, v: int, work: Workspace
) -> None:
    """Enter the paths over the chain of one view into the lists of the receivers in its cone."""
    keep, k2, rx, ground = setting.keep, 2 * setting.wavenumber, links.rx, space.ground
    order, plane, receivers = views.order[v], np.empty((MAX_CORNERS + 1, 4)), np.empty(len(rx), np.int64)
    n_planes = cone_of(space.windows, views, v, plane)
    image = views.image[v]
    near, far = Chain(image, views.chain[v], order), Chain(image, views.chain[v], 0)
    for h in range(things_within(rx_boxes, plane, n_planes, receivers)):
        r = receivers[h]
        inside = True
        for k in range(n_planes):
            depth = SLACK_M - plane[k, 3]
            for i in range(3):
                depth += plane[k, i] * rx[r, i]
            inside = inside and depth >= 0
        if not inside:
            continue
        if links.n_paths[r] == keep:
            length2 = 0.0
            for i in range(3):
                length2 += (image[order, i] - rx[r, i]) ** 2
            if links.rank[r, keep - 1, 0] * k2 * k2 * length2 > 1:
                continue
        m, large = lay_out(ground, links.ends[r], near, -1, far, work.layout)
        if m >= 0:
            link, chains = link_of(links, r), (near, -1, far)
            links.n_paths[r] = enter_laid(space, setting, link, chains, m, large, work, links.n_paths[r])


@compiled
def _reflect(space: Space, setting: Setting, links: Links, rx_boxes: Boxes, work: Workspace) -> None:
    """Enter all paths without diffraction into the lists of their links; chains are walked depth first."""
    views, n = new_views(64, setting.max_reflections), 1
    views.image[0, 0] = links.tx
    patches, plane = np.empty(len(space.patch_facet), np.int64), np.empty((MAX_CORNERS + 1, 4))
    piece = np.empty((PIECES, MAX_CORNERS, 3))
    while n > 0:
        n -= 1
        order = views.order[n]
        _enter_view(space, setting, links, rx_boxes, views, n, work)
        if order < setting.max_reflections:
            is_extended = order + 1 < setting.max_reflections or len(links.rx) > _FEW
            occluding = is_extended and setting.max_through == 0
            views, n = add_next_views(space, views, n, n, occluding, plane, patches, piece)


@compiled
def seen_edges(
    space: Space, views: Views, n: int, occluding: bool
) -> tuple[Int[np.ndarray, "h 2"], Float[np.ndarray, "h 3"]]:
    """Pairs of edge and view that sees it, by edge, and where the image is (`edge_sight`)."""
    ground, near_m, h = space.ground, space.ground.near_m, 0
    edges, pair, sight = np.empty(len(ground.edge), np.int64), np.empty((64, 2), np.int64), np.empty((64, 3))
    plane, piece = np.empty((MAX_CORNERS + 1, 4)), np.empty((PIECES, MAX_CORNERS, 3))
    line, ends, behind = np.empty((MAX_CORNERS, 3)), np.empty((2, 3)), np.zeros(4)
    strip = np.empty((4, 3))
    for v in range(n):
        n_planes = cone_of(space.windows, views, v, plane)
        if n_planes > 0:
            behind[:] = plane[n_planes - 1]
        image = views.image[v, views.order[v]]
        for j in range(things_within(space.edge_boxes, plane, n_planes, edges)):
            edge = edges[j]
            z, distance, angle = edge_sight(ground.edge, ground.edge_wedge, edge, image)
            if distance < near_m or not is_open(ground.edge_gap_rad[edge], distance, angle, near_m):
                continue
            ends[:] = ground.edge[edge]
            if clip_to_planes(ends, 2, plane, n_planes, line, piece[0]) == 0:
                continue
            if occluding and not may_see_line(space, image, behind, line, strip, piece):
                continue
            if h == len(pair):
                pair, sight = np.concatenate((pair, pair)), np.concatenate((sight, sight))
            pair[h, 0], pair[h, 1] = edge, v
            sight[h, 0], sight[h, 1], sight[h, 2] = z, distance, angle
            h += 1
    order = np.argsort(pair[:h, 0], kind="mergesort")
    return pair[order], sight[order]


@compiled
def _bend(space: Space, setting: Setting, links: Links, work: Workspace) -> None:
    """Enter all paths over an edge into the lists of their links."""
    ground, side, occluding = space.ground, setting.side_reflections, setting.max_through == 0
    near, n_near = all_views(space, links.tx, side, occluding)
    pair, sight = seen_edges(space, near, n_near, occluding)
    start = np.searchsorted(pair[:, 0], np.arange(len(ground.edge) + 1))
    edges, plane = np.empty(len(ground.edge), np.int64), np.empty((MAX_CORNERS + 1, 4))
    for r in range(len(links.rx)):
        far, n_far = all_views(space, links.rx[r], side, occluding)
        for v in range(n_far):
            after = far.order[v]
            chain = Chain(far.image[v], far.chain[v], after)
            n_planes = cone_of(space.windows, far, v, plane)
            for e in range(things_within(space.edge_boxes, plane, n_planes, edges)):
                edge = edges[e]
                if start[edge] == start[edge + 1]:
                    continue
                place, gap = (
                    edge_sight(ground.edge, ground.edge_wedge, edge, far.image[v, after]),
                    ground.edge_gap_rad[edge],
                )
                if place[1] < NOWHERE_M or not is_open(gap, place[1], place[2], ground.near_m):
                    continue
                for j in range(start[edge], start[edge + 1]):
                    w = pair[j, 1]
                    if near.order[w] + after > setting.edge_reflections:  # views come by order
                        break
                    if _may_join(space, setting, links, r, edge, sight[j], place):
                        before = Chain(near.image[w], near.chain[w], near.order[w])
                        m, large = lay_out(ground, links.ends[r], before, edge, chain, work.layout)
                        if m >= 0:
                            link, chains = link_of(links, r), (before, edge, chain)
                            links.n_paths[r] = enter_laid(
                                space, setting, link, chains, m, large, work, links.n_paths[r]
                            )


@compiled
def _may_join(
    space: Space,
    setting: Setting,
    links: Links,
    r: int,
    edge: int,
    near: Point,
    far: tuple[float, float, float],
) -> bool:
    """Whether a path over an edge, where images of both ends are as seen from it, meets it and may be strong enough."""
    ground, end, touch_m = space.ground, 0.0, space.ground.near_m
    for i in range(3):
        end += ground.edge_wedge[edge, 0, i] * (ground.edge[edge, 1, i] - ground.edge[edge, 0, i])
    z = (near[0] * far[1] + far[0] * near[1]) / (near[1] + far[1])
    if z < -touch_m or z > end + touch_m:
        return False
    if links.n_paths[r] < setting.keep:
        return True
    bound = edge_bound(far[2], near[2], ground.edge_gap_rad[edge], setting.wavenumber, near[1], far[1])
    return bound >= links.rank[r, setting.keep - 1, 0]


@compiled
def trace_space(
    space: Space, setting: Setting, tx: Point, rx: Float[np.ndarray, "r 3"], rx_boxes: Boxes
) -> Table:
    """Strongest paths from one transmitter to many receivers."""
    links, work = make_links(setting, tx, rx), make_workspace(setting)
    _reflect(space, setting, links, rx_boxes, work)
    if setting.edge_reflections >= 0 and len(space.ground.edge):
        _bend(space, setting, links, work)
    return table_of(space, setting, links, work)
