"""Stacked storeys made ready for walking views through them: the plan of each layer, and what joins them.

A layer is a storey, or a slab with its openings (`wireless.geometry.stack`). Each is a floor plan of its own
(`wireless.geometry.plan`), and all of them lie side by side in one `Plan`, whose triangles know their layer. Where no
level face is between a triangle and one of the next layer, what both cover is a piece of an opening, through which
views go on. Edges of level faces, such as rims of slabs, are sides of triangles too.

Only rooms count: regions with a floor or a ceiling in a storey, and all that openings join to them. A scene whose rooms
are not closed but for their openings is no stack.
"""

from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from robosim.support.compiled import compiled
from wireless.geometry.convex import in_common
from wireless.geometry.facets import LEVEL, Surfaces
from wireless.geometry.plan import Plan, make_plan, regions
from wireless.geometry.stack import Stack

#: Some of the triangles.
Mask = Bool[np.ndarray, " t"]
#: A number for each triangle.
Numbers = Int[np.ndarray, " t"]
#: Whether each is so below and above.
BothSides = Bool[np.ndarray, "t 2"]


#: Lines nearer to a wall than so many snaps are taken to be on it.
_ON_WALL = 10
#: Pieces of openings of less area are none [m2].
_NOTHING_M2 = 1e-11
#: A triangle is covered by others but for this share of its area, or this area times a snap [m2].
_COVERED, _COVERED_M = 1e-6, 100.0


#: How far before an edge its open side is looked at [m].
_ASIDE_M = 1e-4


class Openings(NamedTuple):
    """Openings between layers, in pieces that join one triangle to another."""

    start: Int[np.ndarray, " p1"]
    """Where the pieces below (2 t) and above (2 t + 1) triangle t begin, and an end."""
    behind: Int[np.ndarray, " q"]
    """Triangle behind each piece."""
    corners: Int[np.ndarray, " q"]
    """Number of corners of each piece."""
    corner: Float[np.ndarray, "q k 2"]
    """Corners of each piece, counter-clockwise [m]; zeros beyond the last."""
    most_corners: int
    """Most corners of a window: corners of the pieces that were passed, and two of a sector at each."""


class Outline(NamedTuple):
    """Walls that reflect, and edges that diffract: corners of the plan, and after these rims of slabs."""

    wall_point: Float[np.ndarray, "n 2"]
    """A point of each wall's line [m]."""
    wall_along: Float[np.ndarray, "n 2"]
    """Unit vector along each wall."""
    n_corners: int
    """How many edges are corners."""
    edge_point: Float[np.ndarray, "e 3"]
    """A point of each edge [m]; of a corner at height 0."""
    edge_wedge: Float[np.ndarray, "e 3 3"]
    """See `wireless.geometry.facets.Surfaces`."""
    edge_gap_rad: Float[np.ndarray, " e"]
    """Open angle of each."""
    edge_walls: Int[np.ndarray, "e 2"]
    """Number of 0-face and n-face among the setting's walls; rims follow the edges of the plan."""


class Layers(NamedTuple):
    """Floor plans over each other and the openings between them, or a single one."""

    plan: Plan
    """Walls, corners and triangles of all layers."""
    level_m: Float[np.ndarray, " k"]
    """Heights between the layers, from the lowest floor to the highest ceiling [m]."""
    tri_layer: Int[np.ndarray, " t"]
    """Layer of each triangle."""
    openings: Openings
    """Openings between them."""
    tri_rim: Int[np.ndarray, "t 3 2"]
    """Rim, by its number among edges, on the side opposite to each point, at the lower and at the upper end of the
    layer; -1 for none."""
    outline: Outline
    """Walls and edges."""


def make_outline(plan: Plan, rims: Surfaces | None, edges: Int[np.ndarray, " k"]) -> Outline:
    """Walls and corners of a plan, and some edges of surfaces as rims."""
    n_corners, along = len(plan.corner_vertex), plan.corner_along
    point, wedge = np.zeros((n_corners, 3)), np.zeros((n_corners, 3, 3))
    point[:, :2], wedge[:, 0, 2] = plan.vertex[plan.corner_vertex], 1.0
    wedge[:, 1, :2], wedge[:, 2, 0], wedge[:, 2, 1] = along, -along[:, 1], along[:, 0]
    gap_rad, walls = plan.corner_gap_rad, plan.corner_walls
    if rims is not None:
        point = np.concatenate([point, rims.edge[edges, 0]])
        wedge, gap_rad = (
            np.concatenate([wedge, rims.edge_wedge[edges]]),
            np.append(gap_rad, rims.edge_gap_rad[edges]),
        )
        walls = np.concatenate([walls, len(plan.wall_along) + np.arange(2 * len(edges)).reshape(-1, 2)])
    return Outline(plan.wall_point, plan.wall_along, n_corners, point, wedge, gap_rad, walls)


def one_storey(plan: Plan, low_m: float, high_m: float) -> Layers:
    """A floor plan from floor to ceiling as the only layer, without openings."""
    n, none = len(plan.tri_vertex), np.empty(0, np.int64)
    return Layers(
        plan=plan,
        level_m=np.array([low_m, high_m]),
        tri_layer=np.zeros(n, np.int64),
        openings=Openings(np.zeros(2 * n + 1, np.int64), none, none, np.empty((0, 3, 2)), 0),
        tri_rim=np.full((n, 3, 2), -1, np.int64),
        outline=make_outline(plan, None, none),
    )


@compiled
def openings_on(openings: Openings, triangles: Int[np.ndarray, " n"]) -> int:
    """Number of pieces of openings below and above some triangles."""
    total = 0
    for t in triangles:
        total += openings.start[2 * t + 2] - openings.start[2 * t]
    return total


class Stacked(NamedTuple):
    """Layers, and what is known about them."""

    layers: Layers
    face: Int[np.ndarray, " n"]
    """A mesh face of each wall of the plan, then of each face of each rim."""
    room: Bool[np.ndarray, " t"]
    """Whether each triangle is in a room."""
    sealed: bool
    """Whether what passes a wall, floor or ceiling leaves the rooms."""


def make_layers(stack: Stack, surfaces: Surfaces, snap_m: float) -> Stacked | None:
    """Prepare what does not depend on antennas; None if the rooms are not closed."""
    rims = _rims(stack, surfaces, snap_m)
    made: dict[int, Plan] = {}
    # Slabs first: storeys are triangulated alike where these are open, so that openings fall into few pieces.
    for layer in sorted(range(len(stack.walls)), key=lambda number: (number % 2 == 0, number)):
        walls = stack.walls[layer]
        if len(walls):
            lines = [_outlines(stack.level[layer]), _outlines(stack.level[layer + 1])]
            lines += [_inner_sides(made[slab]) for slab in (layer - 1, layer + 1) if slab in made]
            seams = _seams(np.concatenate(lines), walls, snap_m)
            made[layer] = make_plan(walls, snap_m, seams=seams, origin=np.zeros(2))
    layer_of = sorted(made)
    plans = [made[layer] for layer in layer_of]
    plan = _side_by_side(plans)
    tri_layer = np.repeat(layer_of, [len(layer_plan.tri_vertex) for layer_plan in plans])
    triangle = shapely.polygons(plan.vertex[plan.tri_vertex])
    region = regions(plan)
    outer = np.unique(region[(plan.tri_next < 0).any(axis=1)])
    inner = ~np.isin(region, outer)
    covered = _covered(plan, tri_layer, inner, stack.level)
    pieces = _pieces(plan.vertex[plan.tri_vertex], tri_layer, inner & ~covered[:, 1], inner & ~covered[:, 0])
    area = shapely.area(triangle)
    room = _rooms(region, _floored(region, inner & (tri_layer % 2 == 0), covered, area), pieces)
    if not _closed(room, inner, covered, tri_layer, len(stack.level_m), area, pieces, snap_m):
        return None
    rims = rims[_facing(surfaces, rims, stack.level_m, triangle, tri_layer, room)]
    inside = room[pieces.below]
    openings = _by_triangle(len(triangle), _Pieces(*(column[inside] for column in pieces)))
    layers = Layers(
        plan=plan,
        level_m=stack.level_m,
        tri_layer=tri_layer,
        openings=Openings(*openings, (openings[3].shape[1] + 2) * len(stack.level_m)),
        tri_rim=_sides_on(plan, tri_layer, surfaces.edge[rims], stack.level_m, snap_m),
        outline=make_outline(plan, surfaces, rims),
    )
    faces = [*stack.wall_face, surfaces.facet_face[surfaces.edge_facets[rims]].ravel()]
    return Stacked(
        layers, np.concatenate(faces).astype(np.int64), room, _sealed(layers, room, inner, covered)
    )


def _rims(stack: Stack, surfaces: Surfaces, snap_m: float) -> Int[np.ndarray, " e"]:
    """Level edges at some height of a stack, off its lowest and highest one."""
    ends = surfaces.edge
    level = np.abs(surfaces.edge_wedge[:, 0, 2]) < LEVEL
    off = np.abs(ends[:, :, 2].mean(axis=1)[:, None] - stack.level_m[1:-1]).min(axis=1, initial=np.inf)
    return np.flatnonzero(level & (off < snap_m))


def _facing(
    surfaces: Surfaces,
    rims: Int[np.ndarray, " e"],
    level_m: Float[np.ndarray, " k"],
    triangle: np.ndarray,
    tri_layer: Numbers,
    room: Mask,
) -> Bool[np.ndarray, " e"]:
    """Whether the open side of each rim is in a room: that of a ceiling's edge at a wall is within the slab."""
    half, wedge = surfaces.edge_gap_rad[rims, None] / 2, surfaces.edge_wedge[rims]
    out = np.cos(half) * wedge[:, 1] + np.sin(half) * wedge[:, 2]
    before = surfaces.edge[rims].mean(axis=1) + _ASIDE_M * out
    layer = np.searchsorted(level_m, before[:, 2]) - 1
    rim, t = shapely.STRtree(triangle).query(shapely.points(before[:, :2]), predicate="intersects")
    is_inside = np.zeros(len(rims), bool)
    is_inside[rim[room[t] & (tri_layer[t] == layer[rim])]] = True
    return is_inside


def _outlines(flat: shapely.Geometry) -> Float[np.ndarray, "n 2 2"]:
    """Segments around polygons."""
    rings = shapely.get_rings(shapely.get_parts(flat))
    parts = [shapely.get_coordinates(ring) for ring in rings]
    return np.concatenate(
        [np.empty((0, 2, 2)), *(np.stack([outline[:-1], outline[1:]], axis=1) for outline in parts)]
    )


def _inner_sides(plan: Plan) -> Float[np.ndarray, "n 2 2"]:
    """Sides of the triangles between the walls of a plan, none of which leads outside."""
    region = regions(plan)
    inner = ~np.isin(region, region[(plan.tri_next < 0).any(axis=1)])
    corner = plan.vertex[plan.tri_vertex[inner]]
    return np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2, 2)


def _seams(
    lines: Float[np.ndarray, "n 2 2"], walls: Float[np.ndarray, "m 2 2"], snap_m: float
) -> Float[np.ndarray, "k 2 2"]:
    """Lines that lie between walls and not on one."""
    network = shapely.union_all(shapely.linestrings(walls), grid_size=snap_m)
    around = shapely.union_all(shapely.get_parts(shapely.polygonize([network])))
    middle = shapely.points(lines.mean(axis=1))
    off = shapely.distance(network, middle) > _ON_WALL * snap_m
    lines = lines[off & shapely.contains(around, middle)]
    ends = np.sort(np.round(lines, 9).view(complex)[..., 0], axis=1)  # once, in either direction
    return lines[np.unique(ends, axis=0, return_index=True)[1]]


def _side_by_side(plans: list[Plan]) -> Plan:
    """Several plans as one, none of whose triangles touch those of another."""
    walls = np.cumsum([0, *(len(plan.wall_along) for plan in plans)])
    points = np.cumsum([0, *(len(plan.vertex) for plan in plans)])
    triangles = np.cumsum([0, *(len(plan.tri_vertex) for plan in plans)])
    corners = np.cumsum([0, *(len(plan.corner_vertex) for plan in plans)])
    by = {
        "tri_vertex": points,
        "corner_vertex": points,
        "tri_next": triangles,
        "tri_wall": walls,
        "corner_walls": walls,
        "tri_corner": corners,
    }
    joined = {}
    for name in Plan._fields[1:]:
        parts = [getattr(plan, name) for plan in plans]
        if name in by:
            parts = [
                np.where(column >= 0, column + first, -1)
                for column, first in zip(parts, by[name][:-1], strict=True)
            ]
        joined[name] = np.concatenate(parts)
    return Plan(origin=plans[0].origin, **joined)


def _covered(plan: Plan, tri_layer: Numbers, inner: Mask, flat: tuple[shapely.Geometry, ...]) -> BothSides:
    """Whether level faces cover each inner triangle from below, and from above."""
    middle = plan.vertex[plan.tri_vertex].mean(axis=1)
    covered = np.zeros((len(middle), 2), bool)
    for level, area in enumerate(flat):
        shapely.prepare(area)
        for side in range(2):
            here = inner & (tri_layer == level - side)
            covered[here, side] = shapely.contains_xy(area, *middle[here].T)
    return covered


class _Pieces(NamedTuple):
    """Intersections of triangles of two layers."""

    below: Int[np.ndarray, " q"]
    """Triangle of the lower layer."""
    above: Int[np.ndarray, " q"]
    """Triangle of the higher one."""
    corner: Float[np.ndarray, "q 8 2"]
    """Corners of the piece [m]; zeros beyond the last."""
    corners: Int[np.ndarray, " q"]
    """Number of corners."""
    area: Float[np.ndarray, " q"]
    """Size [m2]."""


def _pieces(
    corner: Float[np.ndarray, "t 3 2"], tri_layer: Numbers, open_above: Mask, open_below: Mask
) -> _Pieces:
    """Pieces of openings between some triangles of each layer and some of the next one."""
    below, above = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for layer in range(tri_layer.max()):
        low = np.flatnonzero(open_above & (tri_layer == layer))
        high = np.flatnonzero(open_below & (tri_layer == layer + 1))
        if len(low) and len(high):
            boxes = [
                shapely.box(*corner[triangles].min(axis=1).T, *corner[triangles].max(axis=1).T)
                for triangles in (low, high)
            ]
            lower, other = shapely.STRtree(boxes[1]).query(boxes[0])
            below.append(low[lower])
            above.append(high[other])
    first, second = np.concatenate(below), np.concatenate(above)
    pieces = _Pieces(first, second, *in_common(corner[first], corner[second]))
    return _Pieces(*(column[pieces.area > _NOTHING_M2] for column in pieces))


def _floored(region: Numbers, storey: Mask, covered: BothSides, area: Float[np.ndarray, " t"]) -> Mask:
    """Triangles of those regions of storeys that have a floor, or a ceiling, over half of them or more."""
    whole = np.bincount(region, area)
    has_floor = np.zeros(len(whole), bool)
    for side in range(2):
        has_floor |= np.bincount(region, area * (covered[:, side] & storey)) > whole / 2
    return has_floor[region]


def _rooms(region: Numbers, seed: Mask, pieces: _Pieces) -> Mask:
    """Triangles of regions that have a floor or a ceiling, and of those that openings join to them."""
    n, ends = region.max() + 1, (region[pieces.below], region[pieces.above])
    links = coo_array((np.ones(len(pieces.below), bool), ends), shape=(n, n))
    joined = connected_components(links, directed=False)[1][region]
    return np.isin(joined, np.unique(joined[seed]))


def _closed(
    room: Mask,
    inner: Mask,
    covered: BothSides,
    tri_layer: Numbers,
    n_levels: int,
    area: Float[np.ndarray, " t"],
    pieces: _Pieces,
    snap_m: float,
) -> bool:
    """Whether each triangle of a room has a face or pieces of openings all over it, below and above."""
    if not room.any() or (room & ~inner).any():
        return False
    slack = _COVERED * area + _COVERED_M * snap_m * np.sqrt(area)
    for side, mine in enumerate((pieces.above, pieces.below)):
        filled = np.bincount(mine, pieces.area, len(area))
        ends = tri_layer == (0 if side == 0 else n_levels - 2)
        open_ = room & ~covered[:, side] & (area > slack)
        if (open_ & ends).any() or (filled[open_] < (area - slack)[open_]).any():
            return False
    return True


def _by_triangle(n: int, pieces: _Pieces) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pieces from either side: where those of each triangle and side begin, what is behind, and their corners."""
    key = np.concatenate([2 * pieces.below + 1, 2 * pieces.above])
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], np.arange(2 * n + 1))
    behind = np.concatenate([pieces.above, pieces.below])[order]
    n_max = pieces.corners.max(initial=3)
    return (
        start,
        behind,
        np.tile(pieces.corners, 2)[order],
        np.tile(pieces.corner[:, :n_max], (2, 1, 1))[order],
    )


def _sides_on(
    plan: Plan,
    tri_layer: Numbers,
    rim: Float[np.ndarray, "e 2 3"],
    level_m: Float[np.ndarray, " k"],
    snap_m: float,
) -> Int[np.ndarray, "t 3 2"]:
    """The rim, by its number among edges, that each side of each triangle is a part of, at either end of its layer."""
    rim_of = np.full((*plan.tri_vertex.shape, 2), -1, np.int64)
    if not len(rim):
        return rim_of
    tree = shapely.STRtree(shapely.linestrings(rim[:, :, :2]))
    for i in range(3):
        ends = plan.vertex[plan.tri_vertex[:, [(i + 1) % 3, (i + 2) % 3]]]
        t, e = tree.query(shapely.points(ends.mean(axis=1)), predicate="dwithin", distance=2 * snap_m)
        line = shapely.linestrings(rim[e, :, :2])
        for k in range(2):
            near = shapely.distance(line, shapely.points(ends[t, k])) < 2 * snap_m
            t, e, line = t[near], e[near], line[near]
        for side in range(2):
            here = np.abs(level_m[tri_layer[t] + side] - rim[e, 0, 2]) < snap_m
            rim_of[t[here], i, side] = len(plan.corner_vertex) + e[here]
    return rim_of


def _sealed(layers: Layers, room: Mask, inner: Mask, covered: BothSides) -> bool:
    """Whether no wall and no level face has rooms on both sides."""
    plan = layers.plan
    both = (plan.tri_wall >= 0) & room[:, None] & room[plan.tri_next] & (plan.tri_next >= 0)
    if both.any():
        return False
    low, high = room & inner & covered[:, 1], room & inner & covered[:, 0]
    return not len(_pieces(plan.vertex[plan.tri_vertex], layers.tri_layer, low, high).below)
