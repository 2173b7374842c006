"""A floor plan made ready for walking views through it: walls cut where they touch, corners, triangles.

Walls are snapped to a fine lattice and cut at each other, so that they meet in common points only: a wall that ends
just before another one is joined to it. A constrained triangulation of these points gives the triangle behind each
edge. Reflections still use the line that each wall had before.

A corner is where walls leave a gap of more than 180 degrees: this is the outside of a wedge, which diffracts.
An end of a single sheet leaves 360 degrees.
"""

from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from wireless.geometry.array_types import FlatPoint
from wireless.geometry.triangulation import Triangulation

#: How far points may be from the walls [m].
REACH_M = 20e3
#: A point this close to a wall is on it [m].
NEAR_M = 1e-9
#: Gaps between walls that exceed 180 degrees by less [rad] are no corner: nothing to be seen diffracts there.
FLAT_RAD = 1e-4


class Plan(NamedTuple):
    """Walls, corners and the triangles between them, around an origin of their own."""

    origin: Float[np.ndarray, "2"]
    """Where (0, 0) of all other fields lies [m]."""
    wall_point: Float[np.ndarray, "n 2"]
    """A point of each wall's line [m]."""
    wall_along: Float[np.ndarray, "n 2"]
    """Unit vector along each wall."""
    vertex: Float[np.ndarray, "v 2"]
    """Points of the triangulation [m]."""
    tri_vertex: Int[np.ndarray, "t 3"]
    """Points of each triangle, counter-clockwise."""
    tri_next: Int[np.ndarray, "t 3"]
    """Triangle behind the side opposite to each point, -1 for none."""
    tri_wall: Int[np.ndarray, "t 3"]
    """Wall on that side, -1 for none."""
    tri_open: Bool[np.ndarray, "t 3"]
    """Whether paths may pass the wall on that side, if there is one."""
    tri_corner: Int[np.ndarray, "t 3"]
    """Corner at each point if the triangle lies in its gap, -1 otherwise."""
    corner_vertex: Int[np.ndarray, " c"]
    """Point of each corner."""
    corner_walls: Int[np.ndarray, "c 2"]
    """Wall from which the gap is counted (counter-clockwise), and the other one."""
    corner_along: Float[np.ndarray, "c 2"]
    """Unit vector from the corner along the first of them."""
    corner_gap_rad: Float[np.ndarray, " c"]
    """Angle of the gap, n pi."""


def make_plan(
    walls: Float[np.ndarray, "n 2 2"],
    snap_m: float,
    *,
    seams: Float[np.ndarray, "m 2 2"] | None = None,
    origin: FlatPoint | None = None,
) -> Plan:
    """Cut, join and triangulate.

    Args:
        walls: Ends (x, y) [m] of straight walls.
        snap_m: Ends of walls closer than this are one.
        seams: Ends of lines that are no walls, but sides of triangles too.
        origin: Where (0, 0) is put; None for the middle.
    """
    if origin is None:
        origin = np.round((walls.min(axis=(0, 1)) + walls.max(axis=(0, 1))) / 2, 3)
    ends = walls - origin
    along = ends[:, 1] - ends[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    lines = ends if seams is None else np.concatenate([ends, seams - origin])
    points, pieces = _cut(lines, snap_m)
    piece_wall = _parents(points[pieces] * snap_m, ends, along, snap_m, seams is not None)
    mesh = Triangulation(points, round(REACH_M / snap_m))
    for a, b in pieces:
        mesh.constrain(int(a), int(b))
    triangles, vertex = mesh.triangles(), np.array(mesh.points) * snap_m
    off, nearest = cKDTree(lines.reshape(-1, 2)).query(vertex, distance_upper_bound=snap_m)
    vertex[off < snap_m] = lines.reshape(-1, 2)[nearest[off < snap_m]]  # as given again, topology settled
    pieces, piece_wall = pieces[piece_wall >= 0], piece_wall[piece_wall >= 0]
    tri_next, tri_wall = _sides(triangles, pieces, piece_wall)
    corners = _corners(vertex, pieces, piece_wall, along)
    corner_vertex = np.array([c[0] for c in corners], np.int64)
    corner_walls = np.array([c[1] for c in corners], np.int64).reshape(-1, 2)
    corner_along = np.array([c[2] for c in corners], float).reshape(-1, 2)
    corner_gap = np.array([c[3] for c in corners], float)
    return Plan(
        origin=origin,
        wall_point=ends[:, 0].copy(),
        wall_along=along,
        vertex=vertex,
        tri_vertex=triangles,
        tri_next=tri_next,
        tri_wall=tri_wall,
        tri_open=tri_next >= 0,
        tri_corner=_in_gap(vertex, triangles, corner_vertex, corner_along, corner_gap),
        corner_vertex=corner_vertex,
        corner_walls=corner_walls,
        corner_along=corner_along,
        corner_gap_rad=corner_gap,
    )


def regions(plan: Plan) -> Int[np.ndarray, " t"]:
    """Number of each triangle's region: triangles joined without passing a wall."""
    t, i = np.nonzero((plan.tri_wall < 0) & (plan.tri_next >= 0))
    n = len(plan.tri_vertex)
    links = coo_array((np.ones(len(t), bool), (t, plan.tri_next[t, i])), shape=(n, n))
    return connected_components(links, directed=False)[1]


def _cut(ends: Float[np.ndarray, "n 2 2"], snap_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Lattice points, and pairs of them that are the pieces of walls between crossings."""
    lines = shapely.linestrings(ends / snap_m)
    noded = shapely.get_parts(shapely.union_all(shapely.make_valid(lines), grid_size=1.0))
    xy, line = shapely.get_coordinates(noded, return_index=True)
    xy = np.rint(xy).astype(np.int64)
    inner = line[1:] == line[:-1]
    points, number = np.unique(xy, axis=0, return_inverse=True)
    number = number.ravel()
    pieces = np.sort(np.column_stack([number[:-1][inner], number[1:][inner]]), axis=1)
    pieces = np.unique(pieces[pieces[:, 0] != pieces[:, 1]], axis=0)
    return points, pieces


def _parents(
    pieces: Float[np.ndarray, "m 2 2"],
    ends: Float[np.ndarray, "n 2 2"],
    along: Float[np.ndarray, "n 2"],
    snap_m: float,
    with_seams: bool,
) -> Int[np.ndarray, " m"]:
    """The wall that each piece was cut from: the one that its ends lie on best; -1 if it was cut from a seam."""
    tree = shapely.STRtree(shapely.linestrings(ends))
    middle = pieces.mean(axis=1)
    piece, wall = tree.query(shapely.points(middle), predicate="dwithin", distance=4 * snap_m)
    off = pieces[piece] - ends[wall, :1]
    away = np.abs(off[..., 0] * along[wall, None, 1] - off[..., 1] * along[wall, None, 0]).max(axis=1)
    order = np.lexsort((wall, away, piece))
    first = np.append(True, np.diff(piece[order]) != 0)
    parent = np.full(len(pieces), -1 if with_seams else 0, np.int64)
    best = order[first]
    if with_seams:  # on the lattice a wall's own pieces are off it by no more than its cuts are
        best = best[away[best] <= 2 * snap_m]
    parent[piece[best]] = wall[best]
    return parent


def _sides(
    triangles: Int[np.ndarray, "t 3"], pieces: Int[np.ndarray, "m 2"], piece_wall: Int[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, "t 3"], Int[np.ndarray, "t 3"]]:
    """Neighbour and wall on the side opposite to each point of each triangle."""
    wall_of = {(int(a), int(b)): int(wall) for (a, b), wall in zip(pieces, piece_wall, strict=True)}
    side = {(int(t[(k + 1) % 3]), int(t[(k + 2) % 3])): i for i, t in enumerate(triangles) for k in range(3)}
    tri_next, tri_wall = np.full(triangles.shape, -1, np.int64), np.full(triangles.shape, -1, np.int64)
    for i, t in enumerate(triangles):
        for k in range(3):
            a, b = int(t[(k + 1) % 3]), int(t[(k + 2) % 3])
            tri_next[i, k] = side.get((b, a), -1)
            tri_wall[i, k] = wall_of.get((min(a, b), max(a, b)), -1)
    return tri_next, tri_wall


def _corners(
    vertex: Float[np.ndarray, "v 2"],
    pieces: Int[np.ndarray, "m 2"],
    piece_wall: Int[np.ndarray, " m"],
    along: Float[np.ndarray, "n 2"],
) -> list[tuple[int, tuple[int, int], FlatPoint, float]]:
    """Point, walls, direction of the first wall and angle of each gap of more than 180 degrees."""
    spokes: dict[int, list[tuple[float, int, np.ndarray]]] = {}
    for (a, b), wall in zip(pieces, piece_wall, strict=True):
        side = vertex[b] - vertex[a]
        # The wall's own direction: that of a short piece would be spoilt by the lattice.
        side = along[wall] * (1.0 if side @ along[wall] >= 0 else -1.0)
        for point, out in ((int(a), side), (int(b), -side)):
            spokes.setdefault(point, []).append((float(np.arctan2(out[1], out[0])), int(wall), out))
    corners = []
    for point, at in sorted(spokes.items()):
        at.sort(key=lambda spoke: spoke[:2])
        for (start, wall, out), (stop, other, _) in zip(at, at[1:] + at[:1], strict=True):
            gap = (stop - start) % (2 * np.pi) if len(at) > 1 else 2 * np.pi
            if gap > np.pi + FLAT_RAD:
                corners.append((point, (wall, other), out, gap))
    return corners


def _in_gap(
    vertex: Float[np.ndarray, "v 2"],
    triangles: Int[np.ndarray, "t 3"],
    corner_vertex: Int[np.ndarray, " c"],
    corner_along: Float[np.ndarray, "c 2"],
    corner_gap: Float[np.ndarray, " c"],
) -> Int[np.ndarray, "t 3"]:
    """Corner at each point of each triangle, -1 where the triangle lies between the walls of its wedge."""
    at = np.full(len(vertex), -1, np.int64)
    at[corner_vertex] = np.arange(len(corner_vertex))
    corner = at[triangles]
    t, k = np.nonzero(corner >= 0)
    c = corner[t, k]
    out = []
    for step in (1, 2):
        side = vertex[triangles[t, (k + step) % 3]] - vertex[triangles[t, k]]
        out.append(side / np.linalg.norm(side, axis=1, keepdims=True))
    between, along = out[0] + out[1], corner_along[c]
    angle = np.arctan2(
        along[:, 0] * between[:, 1] - along[:, 1] * between[:, 0], np.einsum("ij,ij->i", along, between)
    )
    corner[t, k] = np.where(angle % (2 * np.pi) < corner_gap[c], c, -1)
    return corner


class Locator:
    """Finds the triangles that points lie in; on a border, all that touch it.

    Triangles are as exact as the lattice, walls more so: a point next to a wall lies on its own side only, one on
    the wall (within `NEAR_M`) on both.
    """

    def __init__(self, plan: Plan, near_m: float):
        self._near_m = near_m
        self._corners = plan.vertex[plan.tri_vertex]
        low, high = self._corners.min(axis=1) - near_m, self._corners.max(axis=1) + near_m
        self._tree = shapely.STRtree(shapely.box(*low.T, *high.T))
        side = np.roll(self._corners, -1, axis=1) - self._corners
        self._side = side / np.linalg.norm(side, axis=2)[..., None]
        self._wall = np.roll(plan.tri_wall, -2, axis=1)
        along = plan.wall_along[self._wall]
        self._along = along * np.sign(np.einsum("tki,tki->tk", along, side))[..., None]
        self._point = plan.wall_point[self._wall]

    def __call__(
        self, points: Float[np.ndarray, "n 2"]
    ) -> tuple[Int[np.ndarray, " n1"], Int[np.ndarray, " m"]]:
        """Where each point's triangles begin (and an end), and these triangles.

        Raises:
            ValueError: If a point is too far away, or not finite.
        """
        far = np.abs(points).max(initial=0.0)
        if not far < REACH_M:
            raise ValueError(f"A point is {far:g} m from the walls, expected finite and under {REACH_M:g} m.")
        point, triangle = self._tree.query(shapely.points(points))
        at = points[point][:, None]
        inside = np.all(_left(self._side[triangle], at - self._corners[triangle]) >= -self._near_m, axis=1)
        point, triangle = point[inside], triangle[inside]
        if len(point) > len(points):  # some point is on a border
            left = _left(self._along[triangle], at[inside] - self._point[triangle])
            behind = np.any((self._wall[triangle] >= 0) & (left < -NEAR_M), axis=1)
            # Next to a corner the lattice may leave a point in none.
            good = ~behind | ~np.isin(point, point[~behind])
            point, triangle = point[good], triangle[good]
        order = np.lexsort((triangle, point))
        return np.searchsorted(point[order], np.arange(len(points) + 1)), triangle[order]


def _left(side: Float[np.ndarray, "m 3 2"], off: Float[np.ndarray, "m 3 2"]) -> Float[np.ndarray, "m 3"]:
    """How far to the left of unit vectors something is."""
    return side[..., 0] * off[..., 1] - side[..., 1] * off[..., 0]
