"""Visibility of a floor plan or of stacked storeys from a point, in line of sight and by the image method.

A view starts in the triangle around its source and goes on through the sides that are no walls, narrowed to the sector
that is seen through each (triangular expansion). Where it meets a wall, the sector becomes that of the mirrored source.
So nothing has to be tested for being hidden: what a view reaches is a path, and whatever it does not reach is none, in
each order. There is no sampling, and decisions err by rounding only: a target counts as seen if it is out of view by
less than `NEAR_M`. The triangles that views pass are stored (`Visibility`), for targets that come later.

Storeys are floor plans over each other. Heights along each path change evenly, however often it was mirrored. A view
that comes to an opening in a slab goes on through it as what is seen through a convex window at that height: a target
is in view if the line from the image meets the window, whose size at another height is that around the image times the
ratio of heights. Corners are seen in a range of slopes, within which the path lies in their layer and meets the window;
rims of slabs are seen in parts.

Left out: reflections at floors and ceilings of several storeys, and walls that are passed there.
Reference: F. Bungiu et al., Efficient computation of visibility polygons, EuroCG 2014.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_growth import longer
from wireless.geometry.array_types import Point
from wireless.geometry.layers import Layers, openings_on
from wireless.geometry.view_bounds import is_in_window, is_within
from wireless.geometry.view_lists import EdgeList, VisitList, more_views, new_trail, new_views
from wireless.geometry.view_steps import (
    Limits,
    MirrorWalls,
    TriangleSides,
    add_corners,
    add_layer_views,
    add_rims,
    add_views,
    add_visits,
    eye_of,
    follow,
    look_through,
)


class Visibility(NamedTuple):
    """All views of a source, with the edges in each, and the triangles that they pass."""

    image: Float[np.ndarray, "b 2"]
    """Mirrored source of each view; the first is the source itself."""
    chain: Int[np.ndarray, "b 5"]
    """Wall that each view was mirrored at or passed last, the view before it (-1 for none), its numbers of
    reflections and of walls passed, and 1 if that wall was passed. A view through an opening repeats that before it."""
    edge_hit: Int[np.ndarray, "e 2"]
    """Pairs of edge and view. Edges are corners, and after these rims."""
    edge_range: Float[np.ndarray, "e 2"]
    """Visible range: for a corner, least and most height gained per metre of the plan; for a rim, from where to where
    along it [m]."""
    last_visit: Int[np.ndarray, " t"]
    """Last visit of each triangle by a view; -1 for none."""
    visit: Int[np.ndarray, "v 3"]
    """View of each visit, the visit of the same triangle before it (-1 for none), and 1 if all of the triangle is in
    the view's sector."""
    sector: Float[np.ndarray, "v 4"]
    """A point on the right and one on the left bound of what is in view there."""
    height_m: float
    """Height of the source."""
    window_span: Int[np.ndarray, "b 2"]
    """Where the corners of each view's window begin, and their number; 0 if it has none."""
    rise_m: Float[np.ndarray, " b"]
    """Height of its window above the source."""
    window: Float[np.ndarray, "w 2"]
    """Corners of windows."""
    whole: bool
    """Whether all visits are stored; otherwise those of triangles with targets."""


@compiled
def find_visibility(
    layers: Layers,
    around: Int[np.ndarray, " s"],
    source: Point,
    has_target: Bool[np.ndarray, " t"],
    limits: Limits,
) -> Visibility:
    """All views of one source."""
    plan, level_m, openings, layered = layers.plan, layers.level_m, layers.openings, len(layers.level_m) > 2
    sides = TriangleSides(plan.vertex, plan.tri_vertex, plan.tri_next, plan.tri_wall)
    walls = MirrorWalls(plan.wall_point, plan.wall_along, plan.tri_wall, plan.tri_open, plan.tri_next)
    views, window, (trail, stack) = new_views(source), np.empty((256 if layered else 0, 2)), new_trail(256)
    edges = EdgeList(
        np.empty((256, 2), np.int64), np.empty((256, 2)), np.full(len(plan.corner_vertex), -1, np.int64)
    )
    room, no_visit = 4096 if limits.target_order >= 0 else 1, np.full(len(plan.tri_vertex), -1, np.int64)
    visits, whole = VisitList(no_visit, np.empty((room, 3), np.int64), np.empty((room, 4))), True
    n_visits, n_edges, has_rims = 0, 0, len(layers.outline.edge_gap_rad) > layers.outline.n_corners
    count, now, most_order = (1, 0), 0, max(limits.target_order, limits.edge_order)
    while now < count[0]:
        # A view through an opening begins with all of a triangle, the source with all around it.
        starts, enters = around if now == 0 else views.begin[now, :1], views.begin[now, 1]
        layer = layers.tri_layer[starts[0]] if len(starts) else 0
        eye = eye_of(views, now, (level_m[layer], level_m[layer + 1]), limits, source[2])
        reach2, aside = look_through(eye, views, window) if eye.corners else (np.inf, False)
        steps, hits = follow(sides, eye, starts, enters, views.sector[now], aside, reach2, trail, stack)
        while steps < 0:
            trail, stack = new_trail(2 * len(trail.step))
            steps, hits = follow(sides, eye, starts, enters, views.sector[now], aside, reach2, trail, stack)
        if eye.order <= limits.target_order:
            while n_visits + steps > len(visits.visit):
                visits = VisitList(visits.last, longer(visits.visit), longer(visits.sector))
            n_visits, stored = add_visits(visits, n_visits, trail, steps, now, has_target, limits.most_visits)
            whole = whole and stored
        if eye.order <= limits.edge_order:
            most_rims = 6 * steps if has_rims else 0
            while n_edges + min(3 * steps, len(edges.stamp)) + most_rims > len(edges.hit):
                edges = EdgeList(longer(edges.hit), longer(edges.seen_range), edges.stamp)
            own_trail = trail.step, trail.sector, steps
            n_edges = add_corners(
                plan.vertex, plan.tri_vertex, plan.tri_corner, own_trail, eye, window, edges, n_edges
            )
            if has_rims:
                n_edges = add_rims(layers, trail, steps, eye, window, reach2, aside, edges, n_edges)
        if layered or eye.order < most_order or views.chain[now, 3] < limits.max_through:
            pieces = openings_on(openings, trail.step[:steps, 0]) if layered else 0
            while count[0] + pieces + 2 * hits > len(views.image):
                views = more_views(views)
            while layered and count[1] + pieces * openings.most_corners + hits * eye.corners > len(window):
                window = longer(window)
            if layered:
                size = steps, hits
                count = add_layer_views(openings, walls, trail, size, eye, views, window, count, limits)
            else:
                count = add_views(walls, trail, (0, hits), eye, views, window, count, limits)
        now += 1
    n = count[0]
    return Visibility(
        views.image[:n],
        views.chain[:n],
        edges.hit[:n_edges],
        edges.seen_range[:n_edges],
        visits.last,
        visits.visit[:n_visits],
        visits.sector[:n_visits],
        source[2],
        views.window_span[:n],
        views.rise_m[:n],
        window[: count[1]],
        whole,
    )


@compiled
def views_onto(
    seen: Visibility,
    target: Float[np.ndarray, "r 3"],
    start: Int[np.ndarray, " r1"],
    start_list: Int[np.ndarray, " s"],
) -> tuple[Int[np.ndarray, " r1"], Int[np.ndarray, " h"]]:
    """Views that targets are in: where each target's views begin, and an end; views by rising number."""
    n, image, visit, sector = len(target), seen.image, seen.visit, seen.sector
    first, views, count = np.zeros(n + 1, np.int64), np.empty(64, np.int64), 0
    stamp = np.full(len(image), -1, np.int64)
    for i in range(n):
        px, py = target[i, 0], target[i, 1]
        for t in start_list[start[i] : start[i + 1]]:
            j = seen.last_visit[t]
            while j >= 0:
                v = visit[j, 0]
                if (
                    stamp[v] != i
                    and (visit[j, 2] or is_within(sector, j, image[v, 0], image[v, 1], px, py))
                    and (seen.window_span[v, 1] == 0 or _is_behind_window(seen, v, target[i]))
                ):
                    stamp[v] = i
                    if count == len(views):
                        views = longer(views)
                    place = count
                    while place > first[i] and views[place - 1] < v:
                        views[place] = views[place - 1]
                        place -= 1
                    views[place] = v
                    count += 1
                j = visit[j, 1]
        first[i + 1] = count
        views[first[i] : count] = views[first[i] : count][::-1].copy()  # visits come from the last one on
    return first, views[:count].copy()


@compiled
def _is_behind_window(seen: Visibility, view: int, target: Point) -> bool:
    """Whether the line from a view's image to a target in its sector meets its window."""
    climb, rise_m = target[2] - seen.height_m, seen.rise_m[view]
    if climb * rise_m <= 0:
        return False
    f, x, y = rise_m / climb, seen.image[view, 0], seen.image[view, 1]
    first, last = seen.window_span[view, 0], seen.window_span[view, 0] + seen.window_span[view, 1]
    return is_in_window(seen.window[first:last], x + f * (target[0] - x), y + f * (target[1] - y))
