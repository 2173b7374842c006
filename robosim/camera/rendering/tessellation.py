"""A building's surfaces cut into small patches, which can then be coloured one by one.

Floor, ceiling and lids are cut along the lines of a square grid; walls are cut upright along the same lines, and
at a few heights. Each new vertex lies on an old face, and where two faces meet along an edge, both have the same
vertices there, so that no crack opens between them in a picture. Patches share no vertices, so that colours can change
from one to the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Int, UInt8

from robosim.building.building import Building
from robosim.camera.rendering.cut_grid import CutGrid
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
    """What the patch is part of: index into `robosim.building.building.KINDS`."""
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
        first = np.cumsum([0] + [len(part.vertices) for part in parts])
        columns = {
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(cls)
            if field.name != "faces"
        }
        faces = [part.faces + start for part, start in zip(parts, first, strict=False)]
        return cls(**columns, faces=np.concatenate(faces))


def tessellate(building: Building, *, step_m: float, heights_m: Sequence[float]) -> Patches:
    """Cut a building's surfaces into patches.

    Args:
        building: Its mesh, made of level faces and of upright rectangles that stand on the floor.
        step_m: Side of the squares of level patches and width of upright ones, about.
        heights_m: Where upright faces are cut, in rising order.
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
