"""The strongest paths of links among very many triangles: candidates of the transmitter, computed and checked exactly.

For each transmitter there is a table of what it may reach, over patches and edges (`wireless.tracing.candidates`).
One sweep over it leaves few rows for each receiver (`wireless.tracing.receiver_sweep`). These rows are laid out and
checked as in exhaustive search (`wireless.tracing.path_layout`, `wireless.tracing.space_paths`), so that each path is
one that exhaustive search finds; paths that are not in the table are missed. The edges that may be strongest come
first, so that a full list spares the rest. Rows do not name walls that are passed: these are found along the legs.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.em.diffraction import close_edge_bound, edge_bound
from wireless.em.fields import NOWHERE_M
from wireless.em.reflected import Reflected, by_face, by_mirror
from wireless.geometry.array_types import Point, Points
from wireless.geometry.occlusion import FREE, HIDDEN, find_cover
from wireless.geometry.space import Ground, Space
from wireless.tracing.path_layout import Chain, edge_sight, is_on_large, is_open, lay_out, mirror_over
from wireless.tracing.reachable import EdgeChains, OpenChains
from wireless.tracing.receiver_sweep import chains_at, edges_at
from wireless.tracing.space_paths import (
    Link,
    Links,
    Workspace,
    left_by_mirrors,
    link_of,
    make_links,
    make_workspace,
    name_path,
    path_sight,
    table_of,
    try_path,
    weigh_path,
)
from wireless.tracing.table import Setting, Table

#: Edges of a link whose bounds are found closely at once: those behind are spared if the list fills up.
_LOT = 64


class _Rows(NamedTuple):
    """Paths to try, with what their power cannot exceed."""

    edge: Int[np.ndarray, " n"]
    """Edge of each; -1 for none."""
    near: Int[np.ndarray, "n m"]
    """Patches before it, or all, the first from the transmitter first; -1 beyond the last."""
    far: Int[np.ndarray, "n l"]
    """Patches behind it, the first from the receiver first."""
    bound: Float[np.ndarray, " n"]
    """Upper bound of the power of each."""
    bare: Float[np.ndarray, " n"]
    """Upper bound if its patches reflected everything."""


@compiled
def _enter(space: Space, setting: Setting, link: Link, rows: _Rows, work: Workspace, count: int) -> int:
    """Enter paths into a link's list, but those whose bound shows that they are too weak; the list's new length."""
    ground, scratch, ends, rank, keep = space.ground, work.scratch, link.ends, link.best.rank, setting.keep
    images, others = np.empty((rows.near.shape[1] + 1, 3)), np.empty((rows.far.shape[1] + 1, 3))
    for h in range(len(rows.edge)):
        full = count == keep
        if full and rows.bound[h] < rank[keep - 1, 0]:
            continue
        edge = rows.edge[h]
        near = Chain(images, rows.near[h], mirror_over(ground.plane, ends[0], rows.near[h], images))
        far = Chain(others, rows.far[h], mirror_over(ground.plane, ends[1], rows.far[h], others))
        m, large = lay_out(ground, ends, near, edge, far, work.layout)
        if m < 0 or m > setting.max_met:
            continue
        if full and near.order + far.order > 1:
            limit = rows.bare[h] * left_by_mirrors(ground.facet_normal, setting, m, scratch)
            if limit < rank[keep - 1, 0]:
                continue
        if large and not is_on_large(space, near, edge, far, scratch.point):
            continue
        weighed = -1.0, 0.0
        # Looking takes as long as weighing, and most paths are too weak for a full list.
        if full and setting.max_through == 0:
            weighed = weigh_path(ground, setting, m, scratch)
            if weighed[0] < 0 or weighed[1] <= rank[keep - 1, 0]:
                continue
        seen = FREE if setting.max_through else path_sight(space.tree, m, scratch.point, scratch.kind)
        if seen != HIDDEN:
            name_path(work.parts, near, edge, far)
            count = try_path(space, setting, link, m, work, count, weighed, seen)
    return count


@compiled
def _reflect(
    space: Space, setting: Setting, links: Links, chains: OpenChains, reflected: Reflected, work: Workspace
) -> None:
    """Enter the paths over patches into the lists of all links."""
    hits = chains_at(chains, links.rx)
    for r in range(len(links.rx)):
        mine = hits.row[hits.start[r] : hits.start[r + 1]]
        bound, bare = np.full(len(mine), np.inf), np.full(len(mine), np.inf)
        for h in range(len(mine)):
            row, length2, off = mine[h], 0.0, 0.0
            order = chains.order[row]
            if order == 0:
                continue
            for i in range(3):
                step = links.rx[r, i] - chains.column[i, row]
                length2 += step * step
                off += step * chains.column[3 + i, row]
            bare[h] = 1 / (4 * setting.wavenumber**2 * length2)
            facet = space.patch_facet[chains.chain[row, order - 1]]
            bound[h] = bare[h] * by_mirror(
                reflected.mirror, reflected.row[facet], abs(off) / np.sqrt(length2)
            )
        none = np.full((len(mine), 1), -1)
        rows = _Rows(none[:, 0].copy(), chains.chain[mine], none, bound, bare)
        links.n_paths[r] = _enter(space, setting, link_of(links, r), rows, work, links.n_paths[r])


@compiled
def _rough_bounds(
    ground: Ground,
    wavenumber: float,
    edges: EdgeChains,
    mine: Int[np.ndarray, " n"],
    rx: Point,
    least: float,
    sight: Points,
) -> Float[np.ndarray, " n"]:
    """Upper bounds of the power over edges if their faces were mirrors; -1 if it is zero or below the least."""
    # Puts where the receiver's image is, as seen from the edge, into `sight` (see `edge_sight`).
    rough, far, image = np.empty(len(mine)), edges.far, np.empty((edges.far.shape[1] + 1, 3))
    for h in range(len(mine)):
        q = mine[h]
        e = edges.edge[q]
        after = mirror_over(ground.plane, rx, far[q], image) if far[q, 0] >= 0 else 0
        z, distance, behind = edge_sight(ground.edge, ground.edge_wedge, e, image[after] if after else rx)
        sight[h, 0], sight[h, 1], sight[h, 2], rough[h] = z, distance, behind, -1.0
        if distance >= NOWHERE_M and is_open(ground.edge_gap_rad[e], distance, behind, ground.near_m):
            off = edges.column[8, q]
            limit = edge_bound(behind, edges.angle[q], ground.edge_gap_rad[e], wavenumber, off, distance)
            if limit >= least:
                rough[h] = limit
    return rough


@compiled
def _within(angle: float, gap: float) -> float:
    """An angle from the 0-face within a wedge, which rounding may have turned out of it."""
    return min(angle, gap) if angle < np.pi + gap / 2 else 0.0


@compiled
def _bounds(
    ground: Ground,
    setting: Setting,
    reflected: Reflected,
    edges: EdgeChains,
    rows: Int[np.ndarray, " m"],
    ends: Float[np.ndarray, "2 3"],
    sight: Float[np.ndarray, "m 3"],
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Upper bounds of the power over edges, and the bounds if patches reflected everything."""
    # For many at once, as handing these tables on takes longer than finding one. Sights are those of `_rough_bounds`.
    edge, edge_wedge, gaps = ground.edge, ground.edge_wedge, ground.edge_gap_rad
    edge_facets, plane, patch_facet = ground.edge_facets, ground.plane, ground.patch_facet
    image, bound, bare = np.empty((edges.near.shape[1] + 1, 3)), np.empty(len(rows)), np.empty(len(rows))
    mirror, apart, alike, row = reflected.mirror, reflected.apart, reflected.alike, reflected.row
    column, wavenumber, bisector = edges.column, setting.wavenumber, setting.bisector
    for j in range(len(rows)):
        q = rows[j]
        e, distance, place, off = edges.edge[q], sight[j, 1], column[7, q], column[8, q]
        gap, z = gaps[e], 0.0
        phi, phi_source = _within(sight[j, 2], gap), _within(edges.angle[q], gap)
        for i in range(3):
            z += column[3 + i, q] * (ends[1, i] - column[i, q])
        at = (place * distance + z * off) / (off + distance)
        before, after = np.hypot(place - at, off), np.hypot(z - at, distance)
        sin_b0 = distance / after
        faces = (
            by_face(apart, alike, row[edge_facets[e, 0]], phi, phi_source, sin_b0, bisector),
            by_face(apart, alike, row[edge_facets[e, 1]], gap - phi, gap - phi_source, sin_b0, bisector),
        )
        bare[j] = close_edge_bound(phi, phi_source, gap, wavenumber, before, after, sin_b0, faces)
        bound[j] = bare[j]
        # The patches next to the receiver and next to the edge count.
        far, order = edges.far[q, 0], 0
        if far >= 0:
            cosine = 0.0
            for i in range(3):
                cosine += plane[far, i] * (ends[1, i] - column[i, q] - at * column[3 + i, q])
            bound[j] *= by_mirror(mirror, row[patch_facet[far]], abs(cosine) / after)
        if edges.near[q, 0] >= 0:
            order = mirror_over(plane, ends[0], edges.near[q], image)
        if order > 0:
            near, cosine = edges.near[q, order - 1], 0.0
            for i in range(3):
                point = edge[e, 0, i] + (at + sight[j, 0] - z) * edge_wedge[e, 0, i]
                cosine += plane[near, i] * (point - image[order, i])
            bound[j] *= by_mirror(mirror, row[patch_facet[near]], abs(cosine) / before)
    return bound, bare


@compiled
def _uncovered(
    space: Space,
    ends: Float[np.ndarray, "2 3"],
    edges: EdgeChains,
    rows: Int[np.ndarray, " m"],
    work: Workspace,
) -> Bool[np.ndarray, " m"]:
    """Rows over whose edges there is a path whose last leg nothing hides; what hides it is noted."""
    ground, free = space.ground, np.zeros(len(rows), np.bool_)
    images, others = np.empty((edges.near.shape[1] + 1, 3)), np.empty((edges.far.shape[1] + 1, 3))
    for j in range(len(rows)):
        q = rows[j]
        near = Chain(images, edges.near[q], mirror_over(ground.plane, ends[0], edges.near[q], images))
        far = Chain(others, edges.far[q], mirror_over(ground.plane, ends[1], edges.far[q], others))
        m, _ = lay_out(ground, ends, near, edges.edge[q], far, work.layout)
        if m >= 0:
            cover = find_cover(space.tree, work.layout.point, m)
            free[j] = cover < 0
            if cover >= 0:
                edges.cover[q] = cover
    return free


@compiled
def _bend(
    space: Space, setting: Setting, links: Links, edges: EdgeChains, reflected: Reflected, work: Workspace
) -> None:
    """Enter the paths over edges into the lists of all links."""
    ground, keep, hit = space.ground, setting.keep, np.empty(len(edges.edge), np.int64)
    for r in range(len(links.rx)):
        mine, link = edges_at(space.panes, space.tree, edges, links.rx[r], hit), link_of(links, r)
        least, sight = (
            links.rank[r, keep - 1, 0] if links.n_paths[r] == keep else 0.0,
            np.empty((len(mine), 3)),
        )
        rough = _rough_bounds(ground, setting.wavenumber, edges, mine, links.rx[r], least, sight)
        # Edges that may be strongest come first, so that a full list spares the rest.
        order = np.argsort(-rough, kind="mergesort")
        order = order[: (rough >= 0).sum()]
        for first in range(0, len(order), _LOT):
            lot = order[first : first + _LOT]
            least = links.rank[r, keep - 1, 0] if links.n_paths[r] == keep else 0.0
            if rough[lot[0]] < least:
                break
            # Bounds spare a full list more than looking does, and take longer.
            if links.n_paths[r] < keep and setting.max_through == 0:
                lot = lot[_uncovered(space, link.ends, edges, mine[lot], work)]
            nearby = mine[lot]
            bound, bare = _bounds(ground, setting, reflected, edges, nearby, link.ends, sight[lot])
            bound = np.minimum(bound, rough[lot])
            best_first = np.argsort(-bound, kind="mergesort")
            nearby = nearby[best_first]
            rows = _Rows(
                edges.edge[nearby], edges.near[nearby], edges.far[nearby], bound[best_first], bare[best_first]
            )
            links.n_paths[r] = _enter(space, setting, link, rows, work, links.n_paths[r])


@compiled
def trace_candidates(
    space: Space,
    setting: Setting,
    tx: Point,
    rx: Float[np.ndarray, "r 3"],
    chains: OpenChains,
    edges: EdgeChains | None,
    reflected: Reflected,
) -> Table:
    """Strongest paths from one transmitter to many receivers over what it may reach; `edges` is None for no edges."""
    # A single loop, as numba takes some 10 us to make each record that Python sees.
    links, work = make_links(setting, tx, rx), make_workspace(setting)
    _reflect(space, setting, links, chains, reflected, work)
    if edges is not None:
        _bend(space, setting, links, edges, reflected, work)
    return table_of(space, setting, links, work)
