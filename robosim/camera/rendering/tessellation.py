"""A building's surfaces cut into small patches, which can then be coloured one by one.

Floor, ceiling and lids are cut along the lines of a square grid; walls are cut upright along the same lines, and
at a few heights. Each new vertex lies on an old face, and where two faces meet along an edge, both have the same
vertices there, so that no crack opens between them in a picture. Patches share no vertices, so that colours can change
from one to the next.

Points on the grid are numbered, and each is computed once for all the surfaces that meet there: first the corners of
the building, then the places where its walls cross the lines, then the crossings of two lines. Lines are turned with
the plan and shifted by odd fractions of a cell, so that none passes through a corner.

Placed meshes become small triangles: long sides are halved until none is longer than a limit, in both triangles that
meet there. Sheets, which cameras may see from either side, come twice, once with each front.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, UInt8

from robosim.building.building import Building
from robosim.building.extrusion import PLACED
from robosim.plans.floorplan import FloorPlan
from robosim.plans.furnishings.furnishing import Furnishing
from robosim.support.index_ranges import index_ranges


@dataclass(frozen=True, kw_only=True, eq=False)
class Patches:
    """Triangles in patches; each vertex belongs to one patch."""

    vertices: Float[np.ndarray, "n 3"]
    """Corners of the patches in `map` [m]."""
    normals: Float[np.ndarray, "n 3"]
    """Unit normals of the patches, into free space."""
    inward: Float[np.ndarray, "n 3"]
    """Unit vectors in the patch's plane, from the vertex into the patch."""
    kind: UInt8[np.ndarray, " n"]
    """Kind of surface of the patch: index into `robosim.building.building.KINDS`."""
    cell: Int[np.ndarray, "n 2"]
    """Column and row of the grid's square that the patch lies in."""
    row: Int[np.ndarray, " n"]
    """Strip of a wall, counted from the floor up; 0 for level patches."""
    source: Int[np.ndarray, " n"]
    """A face of the building's mesh on the same surface."""
    faces: Int[np.ndarray, "m 3"]
    """Vertices of the triangles, counter-clockwise as seen from free space."""

    @classmethod
    def joined(cls, parts: list["Patches"]) -> "Patches":
        """Several sets of patches as one."""
        first = np.cumsum([0] + [len(patches.vertices) for patches in parts])
        columns = {
            field.name: np.concatenate([getattr(patches, field.name) for patches in parts])
            for field in fields(cls)
            if field.name != "faces"
        }
        faces = [patches.faces + start for patches, start in zip(parts, first, strict=False)]
        return cls(**columns, faces=np.concatenate(faces))


def tessellate(building: Building, *, step_m: float, heights_m: Sequence[float]) -> Patches:
    """Cut a building's surfaces, level faces and upright rectangles on the floor, into patches.

    `step_m` is about the side of level patches and the width of upright ones, which are cut at rising heights [m].
    """
    mesh = building.mesh
    spots, spot = np.unique(mesh.vertices[:, :2] @ (1, 1j), return_inverse=True)
    grid = CutGrid(building.plan, step_m, np.column_stack([spots.real, spots.imag]))
    corner, z = spot[mesh.faces], mesh.vertices[:, 2][mesh.faces]
    level = np.ptp(z, axis=1) == 0
    walls = np.flatnonzero(~level & ((z == 0).sum(axis=1) == 2))  # one of the two triangles of each
    top = np.argmax(z[walls], axis=1)
    # The other two corners are the left and the right end of the wall's foot, seen from free space.
    foot = np.column_stack([corner[walls, (top + step) % 3] for step in (1, 2)])

    up = mesh.face_normals[:, 2] > 0
    group_of = np.column_stack([building.face_kind, z[:, 0], up])[level]
    groups, group = np.unique(group_of, axis=0, return_inverse=True)
    regions = [np.flatnonzero(level)[group.ravel() == number] for number in range(len(groups))]
    borders = [_border(corner[region]) for region in regions]

    cuts = _Cuts(grid, np.concatenate([foot, *borders]))
    parts = [_walls(building, walls, foot, cuts, heights_m)]
    parts += [
        _tiles(building, region, corner[region], cuts.of(border)[0], grid)
        for region, border in zip(regions, borders, strict=True)
    ]
    return Patches.joined(parts)


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
        """Cut edges between corners at the lines: both ends of each piece, in order, and which edge it is of."""
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
        """Cut a level region, triangles with all pieces of its border, into the parts that lie in each square.

        Returned are triangles, counter-clockwise, with no vertices but those of `border` and crossings of lines, and
        which tile each is a part of, counted from 0.
        """
        inner = self._inner_lines(border)
        whole, squares, is_open = self._whole_squares(inner, border)
        pieces = np.concatenate([border, inner[is_open]])
        lines = shapely.linestrings(self.xy[pieces])
        tiles = shapely.get_parts(shapely.polygonize(lines))
        points = shapely.point_on_surface(tiles)
        row, column = self._square(shapely.get_coordinates(points)).T
        tiles, points = (values[~whole[row, column]] for values in (tiles, points))
        region = shapely.STRtree(shapely.polygons(self.xy[triangles]))
        tiles = tiles[np.unique(region.query(points, predicate="intersects")[0])]
        parts, tile = shapely.get_parts(shapely.constrained_delaunay_triangles(tiles), return_index=True)
        points = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
        used = np.unique(pieces)
        keys = self.xy[used] @ (1, 1j)
        order = np.argsort(keys)
        index = used[order][np.searchsorted(keys[order], points @ (1, 1j))]
        clockwise = doubled_area(points) < 0
        index[clockwise] = index[clockwise, ::-1]
        tile = np.append(tile, len(tiles) + np.arange(len(squares)) // 2)
        # In the order of their first lines: those with a piece of the border outside, then whole squares and frames.
        is_square = shapely.area(shapely.polygons(shapely.get_exterior_ring(tiles))) > 1 - 1e-9
        lowest = np.vstack([shapely.bounds(tiles)[:, :2] * is_square[:, None], self.xy[squares[::2, 2]]])
        rank = np.argsort(np.lexsort([*lowest.T[::-1], np.append(is_square, np.ones(len(squares) // 2))]))
        return np.concatenate([index, squares]), rank[tile]

    def _square(self, xy: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n 2"]:
        """Row and column of the squares that points in steps lie in, from the lowest corner of all."""
        return (np.floor(xy) - np.floor(self.xy.min(axis=0))).astype(int)[:, ::-1]

    def _whole_squares(
        self, inner: Int[np.ndarray, "k 2"], border: Int[np.ndarray, "m 2"]
    ) -> tuple[Bool[np.ndarray, "ny nx"], Int[np.ndarray, "n 3"], Bool[np.ndarray, " k"]]:
        """Squares with four inner sides and no border inside, which need not be searched for among lines.

        Returned are their mask, two triangles of each, cut as the others are, and which inner pieces are sides of
        other squares too.
        """
        ends = self.xy[inner]
        is_side = (ends == np.round(ends)).all(axis=(1, 2)) & (np.ptp(ends, axis=1).sum(axis=1) == 1)
        after = self._square(ends.min(axis=1))
        # The other square lies a row below a level piece, and a column to the left of an upright one.
        before = after - np.ptp(ends, axis=1).astype(int)
        count = np.zeros(self._square(self.xy).max(axis=0) + 2, np.uint8)
        for squares in (before, after):
            np.add.at(count, tuple(squares[is_side].T), 1)
        count[tuple(self._square(self.xy[border].mean(axis=1)).T)] = 0
        whole = count == 4
        corner = np.zeros(count.shape, int)
        corner[tuple(self._square(ends[is_side].reshape(-1, 2)).T)] = inner[is_side].ravel()
        column, row = np.nonzero(whole.T)
        up, right = np.array([[1, 1, 0, 0, 0, 1], [1, 0, 0, 0, 1, 1]])  # of two triangles
        triangles = corner[row[:, None] + up, column[:, None] + right].reshape(-1, 3)
        is_open = ~(is_side & whole[tuple(after.T)] & whole[tuple(before.T)])
        return whole, triangles, is_open

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


class _Cuts:
    """Pieces of the edges between corners, the same in both directions."""

    def __init__(self, grid: CutGrid, edges: Int[np.ndarray, "n 2"]) -> None:
        self.grid = grid
        self._edges = np.unique(np.sort(edges, axis=1), axis=0)
        self._pieces, edge = grid.cut(self._edges)
        self._first = np.searchsorted(edge, np.arange(len(self._edges) + 1))

    def of(self, edges: Int[np.ndarray, "n 2"]) -> tuple[Int[np.ndarray, "m 2"], Int[np.ndarray, " m"]]:
        """Pieces of some edges, each directed as its edge, and which edge each is a piece of."""
        low, high = np.sort(edges, axis=1).T
        base = len(self.grid.xy)
        known = np.searchsorted(self._edges @ (base, 1), low * base + high)
        edge, number = index_ranges(self._first[known], self._first[known + 1] - self._first[known])
        pieces = self._pieces[number]
        back = (edges[:, 0] > edges[:, 1])[edge]
        pieces[back] = pieces[back, ::-1]
        return pieces, edge


def _border(triangles: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, "m 2"]:
    """Sides of triangles that have no other triangle of the same region beyond them."""
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    base = triangles.max() + 1
    return sides[~np.isin(sides @ (base, 1), sides @ (1, base))]


def _walls(
    building: Building,
    walls: Int[np.ndarray, " n"],
    foot: Int[np.ndarray, "n 2"],
    cuts: _Cuts,
    heights_m: Sequence[float],
) -> Patches:
    """Upright patches of walls, given by a face of each and the ends of its foot, left and right from free space."""
    pieces, piece_of = cuts.of(foot)
    tops = building.mesh.triangles[walls, :, 2].max(axis=1)
    strips = []
    for top in np.unique(tops):
        levels = np.array([0.0, *(z for z in heights_m if z < top), top])
        here = np.flatnonzero(tops[piece_of] == top)
        piece, row = np.meshgrid(here, np.arange(len(levels) - 1), indexing="ij")
        strips.append((piece.ravel(), row.ravel(), levels[row.ravel()], levels[row.ravel() + 1]))
    piece, row, low, high = (np.concatenate(column) for column in zip(*strips, strict=True))
    feet = cuts.grid.map_xy[pieces[piece]]
    corners = np.empty((len(piece), 4, 3))  # from the lower left one, counter-clockwise
    corners[:, :, :2] = feet[:, [0, 1, 1, 0]]
    corners[:, :, 2] = np.column_stack([low, low, high, high])
    along = corners[:, 1] - corners[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    inward = np.stack([along, -along, -along, along], axis=1)
    inward[:, :, 2] = [1, 1, -1, -1]
    source = walls[piece_of[piece]]
    n = len(piece)
    return Patches(
        vertices=corners.reshape(-1, 3),
        normals=np.repeat(building.mesh.face_normals[source], 4, axis=0),
        inward=inward.reshape(-1, 3) / np.sqrt(2),
        kind=np.repeat(building.face_kind[source], 4),
        cell=np.repeat(np.floor(cuts.grid.xy[pieces[piece]].mean(axis=1)).astype(int), 4, axis=0),
        row=np.repeat(row, 4),
        source=np.repeat(source, 4),
        faces=(4 * np.arange(n)[:, None, None] + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3),
    )


def _tiles(
    building: Building,
    region: Int[np.ndarray, " n"],
    corners: Int[np.ndarray, "n 3"],
    border: Int[np.ndarray, "m 2"],
    grid: CutGrid,
) -> Patches:
    """Level patches of the faces of a region at one height, with all pieces of its border."""
    triangles, tile = grid.tiles(corners, border)
    source = region[0]
    normal = building.mesh.face_normals[source]
    faces = triangles if normal[2] > 0 else triangles[:, ::-1]
    used, faces = np.unique(faces + len(grid.xy) * tile[:, None], return_inverse=True)
    faces = faces.reshape(-1, 3)
    tile_of, point = np.divmod(used, len(grid.xy))
    xy = grid.map_xy[point]
    centre = grid.xy[triangles].mean(axis=1)
    cells = np.zeros((tile.max() + 1, 2), int)
    cells[tile] = np.floor(centre).astype(int)
    n = len(used)
    return Patches(
        vertices=np.column_stack([xy, np.full(n, building.mesh.triangles[source, 0, 2])]),
        normals=np.tile(normal, (n, 1)),
        inward=_into(xy, faces),
        kind=np.full(n, building.face_kind[source]),
        cell=cells[tile_of],
        row=np.zeros(n, int),
        source=np.full(n, source),
        faces=faces,
    )


def _into(xy: Float[np.ndarray, "n 2"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit vectors from each vertex to the middle of the triangles around it."""
    to_centre = xy[faces].mean(axis=1)[:, None] - xy[faces]
    to_centre /= np.linalg.norm(to_centre, axis=2, keepdims=True)
    total = np.zeros((len(xy), 3))
    np.add.at(total, faces.ravel(), np.pad(to_centre.reshape(-1, 2), ((0, 0), (0, 1))))
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-9)


#: Where the first lines pass, in cells of the plan, whose corners have whole or half coordinates.
_SHIFT = np.array([0.3071, 0.1873])


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
    """Cut lines between `ends` at `points` with a share from 0 to 1 of their line: ends of pieces, and their lines."""
    lines = np.arange(len(ends))
    line = np.concatenate([lines, owner, lines])
    order = np.lexsort([np.concatenate([np.zeros(len(ends)), share, np.ones(len(ends))]), line])
    point, line = np.concatenate([ends[:, 0], points, ends[:, 1]])[order], line[order]
    inside = line[1:] == line[:-1]
    return np.column_stack([point[:-1], point[1:]])[inside], line[1:][inside]


def doubled_area(triangles: Float[np.ndarray, "n 3 2"]) -> Float[np.ndarray, " n"]:
    """Twice the area of triangles, positive if counter-clockwise."""
    side, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]


#: Meshes of more triangles are not cut.
_ENOUGH = 20_000


def placed_patches(
    furnishings: Sequence[Furnishing], *, step_m: float
) -> tuple[Patches, Float[np.ndarray, "n 3"]]:
    """Patches of placed meshes, no side longer than a step [m] unless they are many, and colours of corners."""
    triangles, colours = [], []
    for furnishing in furnishings:
        bodies = furnishing.bodies
        fronts = bodies.vertices[bodies.faces]
        backs = fronts[~bodies.oriented[bodies.body]][:, ::-1]
        both = np.concatenate([fronts, backs])
        cut = both if len(both) > _ENOUGH else _cut(both, step_m)
        triangles.append(cut)
        colours.append(np.tile(np.array(furnishing.colour, float), (3 * len(cut), 1)))
    corners = np.concatenate(triangles)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    inward = corners.mean(axis=1, keepdims=True) - corners
    inward /= np.maximum(np.linalg.norm(inward, axis=2, keepdims=True), 1e-300)
    n = corners.shape[0] * 3
    patches = Patches(
        vertices=corners.reshape(-1, 3),
        normals=np.repeat(normal, 3, axis=0),
        inward=inward.reshape(-1, 3),
        kind=np.full(n, PLACED, np.uint8),
        cell=np.zeros((n, 2), int),
        row=np.zeros(n, int),
        source=np.zeros(n, int),
        faces=np.arange(n).reshape(-1, 3),
    )
    return patches, np.concatenate(colours)


def _cut(triangles: Float[np.ndarray, "n 3 3"], step_m: float) -> Float[np.ndarray, "m 3 3"]:
    """Triangles without sides longer than a step."""
    done = []
    while len(triangles):
        long = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2) > step_m
        count = long.sum(axis=1)
        done.append(triangles[count == 0])
        parts = []
        for n_long in (1, 2, 3):
            cut_now, which = triangles[count == n_long], long[count == n_long]
            # Turned so that long sides come first: a to b, and b to c.
            first = {
                1: np.argmax(which, axis=1),
                2: np.argmin(which, axis=1) + 1,
                3: np.zeros(len(cut_now), int),
            }
            order = (first[n_long][:, None] + np.arange(3)) % 3
            a, b, c = np.take_along_axis(cut_now, order[:, :, None], axis=1).transpose(1, 0, 2)
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            pieces = {
                1: [(a, ab, c), (ab, b, c)],
                2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
                3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
            }
            parts += [np.stack(piece, axis=1) for piece in pieces[n_long]]
        triangles = np.concatenate(parts)
    return np.concatenate(done)
