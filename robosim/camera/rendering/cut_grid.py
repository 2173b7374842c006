"""Lines of a square grid that a building is cut along, as seen from above.

Points are numbered, and each is computed once for all the surfaces that meet there: first the corners of the building,
then the places where its walls cross the lines, then the crossings of two lines. Lines are turned with the plan and
shifted by odd fractions of a cell, so that none passes through a corner.
"""

import numpy as np
import shapely
from jaxtyping import Float, Int

from robosim.plans.floorplan import FloorPlan
from robosim.support.index_ranges import index_ranges

#: Where the first lines pass, in cells of the plan, whose corners have whole or half coordinates.
_SHIFT = np.array([0.3071, 0.1873])


class CutGrid:
    """A square grid and the numbered points on it."""

    def __init__(self, plan: FloorPlan, step_m: float, corners: Float[np.ndarray, "n 2"]) -> None:
        """A grid with lines about `step_m` apart, a whole number of cells, and the corners in `map` [m]."""
        self.step_m = max(1, round(step_m / plan.resolution_m)) * plan.resolution_m
        self._origin = plan.to_map(_SHIFT)
        c, s = np.cos(plan.origin[2]), np.sin(plan.origin[2])
        self._R = np.array([[c, -s], [s, c]])
        self.map_xy = corners
        """Points in `map` [m]."""
        self.xy = np.round((corners - self._origin) @ self._R / self.step_m, 9)
        """Points in steps; lines have whole coordinates."""
        self._n_corners = len(corners)

    def cut(self, edges: Int[np.ndarray, "n 2"]) -> tuple[Int[np.ndarray, "m 2"], Int[np.ndarray, " m"]]:
        """Cut edges between corners wherever they cross a line.

        Returns:
            pieces: Both ends of each piece, in order along its edge.
            edge: Which edge it is a piece of.
        """
        start, end = self.xy[edges[:, 0]], self.xy[edges[:, 1]]
        owners: list[np.ndarray] = []
        shares: list[np.ndarray] = []
        places: list[np.ndarray] = []
        for axis in (0, 1):
            edge, line = _whole_between(start[:, axis], end[:, axis])
            share = (line - start[edge, axis]) / (end - start)[edge, axis]
            place = start[edge] + share[:, None] * (end - start)[edge]
            place[:, axis] = line
            owners.append(edge)
            shares.append(share)
            places.append(place)
        edge, share = np.concatenate(owners), np.concatenate(shares)
        a, b = self.map_xy[edges[edge, 0]], self.map_xy[edges[edge, 1]]
        new = self._add(np.concatenate(places), a + share[:, None] * (b - a))
        return _chains(edges, edge, share, new)

    def tiles(
        self, triangles: Int[np.ndarray, "n 3"], border: Int[np.ndarray, "m 2"]
    ) -> tuple[Int[np.ndarray, "k 3"], Int[np.ndarray, " k"]]:
        """Cut a level region into the parts of it that lie in each square.

        Args:
            triangles: The region before the cut, as corners.
            border: All pieces of its border, as `cut` gave them.

        Returns:
            triangles: The region after the cut, counter-clockwise, with no vertices but those of `border` and
                crossings of lines inside.
            tile: Which tile each is a part of, counted from 0.
        """
        pieces = np.concatenate([border, self._inner_lines(border)])
        lines = shapely.linestrings(self.xy[pieces])
        tiles = shapely.get_parts(shapely.polygonize(lines))
        region = shapely.STRtree(shapely.polygons(self.xy[triangles]))
        tiles = tiles[np.unique(region.query(shapely.point_on_surface(tiles), predicate="intersects")[0])]
        parts, tile = shapely.get_parts(shapely.constrained_delaunay_triangles(tiles), return_index=True)
        points = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
        used = np.unique(pieces)
        keys = self.xy[used] @ (1, 1j)
        order = np.argsort(keys)
        found = used[order][np.searchsorted(keys[order], points @ (1, 1j))]
        clockwise = _doubled_area(points) < 0
        found[clockwise] = found[clockwise, ::-1]
        return found, tile

    def _inner_lines(self, border: Int[np.ndarray, "m 2"]) -> Int[np.ndarray, "k 2"]:
        """Pieces of the grid's lines inside of a border, cut where lines cross."""
        points = np.unique(border)
        points = points[points >= self._n_corners]
        spans: list[np.ndarray] = []
        owners: list[np.ndarray] = []
        places: list[np.ndarray] = []
        for axis in (0, 1):
            at, along = self.xy[points, axis], self.xy[points, 1 - axis]
            on_line = np.flatnonzero(at == np.round(at))
            # Along a line, the border is crossed inwards and outwards in turns.
            ends = points[on_line[np.lexsort([along[on_line], at[on_line]])]].reshape(-1, 2)
            span, other = _whole_between(*self.xy[ends, 1 - axis].T)
            place = np.empty((len(span), 2))
            place[:, axis], place[:, 1 - axis] = self.xy[ends[span, 0], axis], other
            owners.append(span + sum(len(other_axis) for other_axis in spans))
            spans.append(ends)
            places.append(place)
        ends, span, place = np.concatenate(spans), np.concatenate(owners), np.concatenate(places)
        distinct, which = np.unique(place, axis=0, return_inverse=True)
        crossings = self._add(distinct, self.step_m * distinct @ self._R.T + self._origin)[which.ravel()]
        from_start = np.abs(place - self.xy[ends[span, 0]]).sum(axis=1)
        length = np.abs(self.xy[ends[span, 1]] - self.xy[ends[span, 0]]).sum(axis=1)
        return _chains(ends, span, from_start / length, crossings)[0]

    def _add(self, xy: Float[np.ndarray, "n 2"], map_xy: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
        """Numbers of new points."""
        first = len(self.xy)
        self.xy, self.map_xy = np.concatenate([self.xy, xy]), np.concatenate([self.map_xy, map_xy])
        return np.arange(first, len(self.xy))


def _whole_between(
    a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """All whole numbers strictly between a and b: for which element, and the number."""
    first = np.floor(np.minimum(a, b)) + 1
    count = np.maximum(np.ceil(np.maximum(a, b)) - first, 0).astype(int)
    owner, number = index_ranges(np.zeros(len(a), int), count)
    return owner, first[owner] + number


def _chains(
    ends: Int[np.ndarray, "n 2"],
    owner: Int[np.ndarray, " m"],
    share: Float[np.ndarray, " m"],
    points: Int[np.ndarray, " m"],
) -> tuple[Int[np.ndarray, "k 2"], Int[np.ndarray, " k"]]:
    """Cut lines between their `ends` at `points`; `share` of each is 0 at the first end of its line, 1 at the second.

    Returns both ends of each piece, and which line it is a piece of.
    """
    lines = np.arange(len(ends))
    line = np.concatenate([lines, owner, lines])
    order = np.lexsort([np.concatenate([np.zeros(len(ends)), share, np.ones(len(ends))]), line])
    point, line = np.concatenate([ends[:, 0], points, ends[:, 1]])[order], line[order]
    inside = line[1:] == line[:-1]
    return np.column_stack([point[:-1], point[1:]])[inside], line[1:][inside]


def _doubled_area(triangles: Float[np.ndarray, "n 3 2"]) -> Float[np.ndarray, " n"]:
    """Twice the area of triangles, positive if counter-clockwise."""
    side, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]
