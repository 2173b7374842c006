"""The strongest paths of links in a floor plan or in storeys: views of both ends, joined at edges, weighed.

Reflections come from the views of the transmitter. Diffracted paths are joined where a view of the transmitter and a
view of the receiver share an edge. In storeys both views must allow the slope of a path over an upright edge, and both
ends must see the point of a rim. `wireless.tracing.unfolded_paths` gives the points of a path.

What cannot enter a link's list is not computed: a reflection by its length, a diffraction by a bound on cot(u / 2n) F
(`wireless.em.diffraction`).

Left out: in storeys, reflections at floors and ceilings and walls that are passed (`wireless.tracing.space_engine`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Num

from robosim.support.compiled import compiled
from wireless.em.diffraction import edge_bound
from wireless.em.fields import DIFFRACTION, NOWHERE_M, REFLECTION
from wireless.geometry.array_growth import longer
from wireless.geometry.array_types import Point
from wireless.geometry.layers import Layers, Outline
from wireless.geometry.plan import NEAR_M
from wireless.geometry.view_steps import Limits
from wireless.geometry.visibility import Visibility, find_visibility, views_onto
from wireless.tracing.table import (
    Best,
    Scratch,
    Setting,
    Table,
    list_path,
    make_scratch,
    make_table,
    new_best,
    weigh,
    with_room,
    write_row,
)
from wireless.tracing.unfolded_paths import Link, Parts, edge_sight, lay_path

#: Slopes that differ by less are one.
_SLOPE = 1e-12


class Views(NamedTuple):
    """Views of many points, one after the other, and the edges in each."""

    view_start: Int[np.ndarray, " r1"]
    """Where each point's views begin, and an end."""
    image: Float[np.ndarray, "b 2"]
    """See `wireless.geometry.visibility.Visibility`, as for the next."""
    chain: Int[np.ndarray, "b 5"]
    """Views before count from the point's first one."""
    edge_start: Int[np.ndarray, " r1"]
    """Where each point's edges begin, and an end."""
    edge_hit: Int[np.ndarray, "e 2"]
    """Corners before rims."""
    edge_range: Float[np.ndarray, "e 2"]


class _NearEdges(NamedTuple):
    """Edges that a transmitter sees, by edge."""

    start: Int[np.ndarray, " e1"]
    """Where those of each edge begin, and an end."""
    node: Int[np.ndarray, " h"]
    sight: Float[np.ndarray, "h 3"]
    """Where the image is, see `edge_sight`."""
    seen: Float[np.ndarray, "h 2"]
    """See `wireless.geometry.visibility.Visibility.edge_range`."""


@compiled
def _with_rows(
    all_rows: Num[np.ndarray, "n k"], count: int, rows: Num[np.ndarray, "m k"]
) -> Num[np.ndarray, "l k"]:
    """An array with rows put behind its first `count`, longer if there is no room."""
    while len(all_rows) < count + len(rows):
        all_rows = longer(all_rows)
    all_rows[count : count + len(rows)] = rows
    return all_rows


@compiled
def views_of(
    layers: Layers,
    points: Float[np.ndarray, "r 3"],
    start: Int[np.ndarray, " r1"],
    start_list: Int[np.ndarray, " s"],
    limits: Limits,
) -> Views:
    """Views of many points onto edges."""
    n, outline = len(points), layers.outline
    view_start, edge_start = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    image, chain = np.empty((1024, 2)), np.empty((1024, 5), np.int64)
    hit, seen = np.empty((1024, 2), np.int64), np.empty((1024, 2))
    no_targets = np.zeros(len(layers.plan.tri_vertex), np.bool_)
    for i in range(n):
        visibility = find_visibility(
            layers, start_list[start[i] : start[i + 1]], points[i], no_targets, limits
        )
        v, e = view_start[i], edge_start[i]
        view_start[i + 1], edge_start[i + 1] = v + len(visibility.image), e + len(visibility.edge_hit)
        image, chain = _with_rows(image, v, visibility.image), _with_rows(chain, v, visibility.chain)
        hit, seen = _with_rows(hit, e, visibility.edge_hit), _with_rows(seen, e, visibility.edge_range)
        if len(outline.edge_gap_rad) > outline.n_corners:
            order = np.argsort(visibility.edge_hit[:, 0] >= outline.n_corners, kind="mergesort")
            hit[e : edge_start[i + 1]], seen[e : edge_start[i + 1]] = (
                visibility.edge_hit[order],
                visibility.edge_range[order],
            )
    return Views(
        view_start,
        image[: view_start[n]],
        chain[: view_start[n]],
        edge_start,
        hit[: edge_start[n]],
        seen[: edge_start[n]],
    )


@compiled
def _most_on_a_side(m: int, scratch: Scratch) -> int:
    """Reflections before the edge of the path in `scratch`, or after it if these are more."""
    before = after = 0
    for j in range(m):
        if scratch.kind[j] == DIFFRACTION:
            before, after = after, 0
        elif scratch.kind[j] == REFLECTION:
            after += 1
    return max(before, after)


@compiled
def _weigh(outline: Outline, setting: Setting, edge: int, m: int, scratch: Scratch) -> tuple[float, float]:
    """Length and power of the path in `scratch`, gain set; length -1 if it is none."""
    if edge < 0:
        return weigh(setting, m, 1.0, scratch)
    for i in range(3):
        for k in range(3):
            scratch.wedge[i, k] = outline.edge_wedge[edge, i, k]
    for i in range(2):
        wall = outline.edge_walls[edge, i]
        for k in range(setting.walls.shape[1]):
            scratch.wedge_walls[i, k] = setting.walls[wall, k]
    return weigh(setting, m, outline.edge_gap_rad[edge] / np.pi, scratch)


@compiled
def _try_path(
    outline: Outline, setting: Setting, link: Link, parts: Parts, scratch: Scratch, best: Best, count: int
) -> int:
    """Enter a path into a link's list, with each allowed number of reflections at floor and ceiling; its new length."""
    edge, n_max = parts[1], setting.max_reflections - link.chain[parts[0], 2]
    if edge >= 0:
        n_max = setting.edge_reflections - link.chain[parts[0], 2] - link.far_chain[parts[2], 2]
    up = min(n_max, 1 if not setting.has_floor else n_max) if setting.has_ceiling else 0
    down = min(n_max, 1 if not setting.has_ceiling else n_max) if setting.has_floor else 0
    for bounce in range(-down, up + 1):
        parts[3] = bounce
        m = lay_path(outline, setting, link, parts, scratch)
        if m > setting.max_met:
            continue
        if edge >= 0 and bounce != 0 and _most_on_a_side(m, scratch) > setting.side_reflections:
            continue
        length, power = _weigh(outline, setting, edge, m, scratch)
        if length < 0 or (count == len(best.rank) and power <= best.rank[count - 1, 0]):
            continue
        number = 1000 * m + bounce + (500 if edge >= 0 else 0)
        count = list_path(best, count, parts, length, power, m, number, scratch.point)
    return count


@compiled
def _by_first(pairs: Int[np.ndarray, "h 2"], n: int) -> tuple[Int[np.ndarray, " n1"], Int[np.ndarray, " h"]]:
    """Numbers of pairs sorted by their first entry (in order among equals), and where those of each entry begin."""
    start = np.zeros(n + 1, np.int64)
    for i in range(len(pairs)):
        start[pairs[i, 0] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    fill, number = start.copy(), np.empty(len(pairs), np.int64)
    for i in range(len(pairs)):
        number[fill[pairs[i, 0]]] = i
        fill[pairs[i, 0]] += 1
    return start, number


@compiled
def _near_edges(outline: Outline, seen: Visibility) -> _NearEdges:
    """Edges that a transmitter sees, by edge."""
    start, number = _by_first(seen.edge_hit, len(outline.edge_gap_rad))
    view, sight, seen_range = seen.edge_hit[number, 1], np.empty((len(number), 3)), seen.edge_range[number]
    for j in range(len(number)):
        image = seen.image[view[j]]
        sight[j] = edge_sight(outline, seen.edge_hit[number[j], 0], image[0], image[1], seen.height_m)
    return _NearEdges(start, view, sight, seen_range)


@compiled
def _is_seen(seen: Float[np.ndarray, "2"], value: float, slack: float) -> bool:
    """Whether a slope or a place along a rim is within what is seen."""
    return seen[0] - slack <= value <= seen[1] + slack


@compiled
def _diffract(
    outline: Outline,
    setting: Setting,
    link: Link,
    near: _NearEdges,
    far: Views,
    receiver: int,
    scratch: Scratch,
    best: Best,
    count: int,
) -> int:
    """Enter the paths of a link over edges that both ends see into its list; the list's new length."""
    n_corners, rise, keep = outline.n_corners, link.rx[2] - link.tx[2], len(best.rank)
    chain, far_image, far_chain = link.chain, link.far_image, link.far_chain
    parts = np.zeros(4, np.int64)
    for h in range(far.edge_start[receiver], far.edge_start[receiver + 1]):
        edge, far_node = far.edge_hit[h, 0], far.edge_hit[h, 1]
        if near.start[edge] == near.start[edge + 1]:
            continue
        far_s, after, phi = edge_sight(
            outline, edge, far_image[far_node, 0], far_image[far_node, 1], link.rx[2]
        )
        if after < NOWHERE_M:
            continue
        for j in range(near.start[edge], near.start[edge + 1]):
            node, before = near.node[j], near.sight[j, 1]
            reflections = chain[node, 2] + far_chain[far_node, 2]
            through = chain[node, 3] + far_chain[far_node, 3]
            if reflections > setting.edge_reflections or through > setting.max_through or before < NOWHERE_M:
                continue
            if 1 + reflections + through > setting.max_met:
                continue
            if edge < n_corners:
                slope = rise / (before + after)
                if not (
                    _is_seen(near.seen[j], slope, _SLOPE) and _is_seen(far.edge_range[h], -slope, _SLOPE)
                ):
                    continue
            else:
                along = (near.sight[j, 0] * after + far_s * before) / (before + after)
                if not (_is_seen(near.seen[j], along, NEAR_M) and _is_seen(far.edge_range[h], along, NEAR_M)):
                    continue
            if count == keep:
                gap, k = outline.edge_gap_rad[edge], setting.wavenumber
                if edge_bound(phi, near.sight[j, 2], gap, k, before, after) < best.rank[count - 1, 0]:
                    continue
            parts[0], parts[1], parts[2] = node, edge, far_node
            count = _try_path(outline, setting, link, parts, scratch, best, count)
    return count


@compiled
def trace_links(
    layers: Layers,
    setting: Setting,
    tx: Point,
    seen: Visibility,
    rx: Float[np.ndarray, "r 3"],
    start: Int[np.ndarray, " r1"],
    start_list: Int[np.ndarray, " s"],
    far: Views,
) -> Table:
    """Strongest paths from one transmitter to many receivers."""
    table, keep, row = make_table(setting, len(rx), len(rx)), setting.keep, 0
    hit_start, hit_view = views_onto(seen, rx, start, start_list)
    near, scratch, best = _near_edges(layers.outline, seen), make_scratch(setting), new_best(setting, 4)
    parts = np.zeros(4, np.int64)
    folds = setting.has_floor or setting.has_ceiling
    for i in range(len(rx)):
        count, first, last = 0, far.view_start[i], far.view_start[i + 1]
        link = Link(tx, rx[i], seen.image, seen.chain, far.image[first:last], far.chain[first:last])
        rise = 0.0 if folds else rx[i, 2] - tx[2]
        parts[1], parts[2] = -1, 0
        for j in range(hit_start[i], hit_start[i + 1]):
            node = hit_view[j]
            if seen.chain[node, 2] + seen.chain[node, 3] > setting.max_met:
                continue
            if count == keep:
                length = np.hypot(seen.image[node, 0] - rx[i, 0], seen.image[node, 1] - rx[i, 1])
                if (2 * setting.wavenumber * np.hypot(length, rise)) ** -2 < best.rank[count - 1, 0]:
                    continue
            parts[0] = node
            count = _try_path(layers.outline, setting, link, parts, scratch, best, count)
        count = _diffract(layers.outline, setting, link, near, far, i, scratch, best, count)
        table.n_paths[i] = count
        table = with_room(setting, table, row + count)
        for j in range(count):
            m = lay_path(layers.outline, setting, link, best.parts[j], scratch)
            length, power = _weigh(layers.outline, setting, best.parts[j, 1], m, scratch)
            write_row(setting, table, row + j, length, power, m, scratch)
        row += count
    return table
