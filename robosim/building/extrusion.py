"""Faces of a building by kind and material, and their making from free polygons: a closed shell of triangles.

The shell is made of floor, ceiling, walls and lids over low islands. The polygons are triangulated with no vertices
but their own (constrained Delaunay, GEOS), so that each wall stands on the edge of exactly one floor triangle, and
there are no T-junctions. Where polygons touch at a point, the triangles around that point form several fans. Each fan
has a vertex of its own, so that every edge of the shell has exactly two faces.

Horizontal units are those of the polygons. Best are cells of the plan, in which points on one line are so
exactly; rounding would leave triangles of nearly no area along straight walls.

Left out: vertices in the middle of another ring's edge, which the outlines of plans do not have.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import shapely
import trimesh
from jaxtyping import Bool, Float, Int, Num, UInt8
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from robosim.plans.furnishings.furnishing import Furnishing
from wireless.em.materials import Material
from wireless.tracing.mesh_check import surfaces_digest

#: Sides of triangles.
Sides = Int[np.ndarray, " m"]


def rings_of(free: shapely.MultiPolygon) -> tuple[np.ndarray, Int[np.ndarray, " n"]]:
    """The closed lines of polygons, and which polygon each belongs to; its outer line comes first."""
    rings, owner = shapely.get_rings(shapely.get_parts(free), return_index=True)
    return rings, owner


def polygons_of(
    points: Sequence[Num[np.ndarray, "_ 2"]], owner: Int[np.ndarray, " n"]
) -> shapely.MultiPolygon:
    """Polygons from the corners of their closed lines, in the order of `rings_of`; valid or not.

    The last corner need not repeat the first; `owner` is the polygon that each line belongs to.
    """
    ring_of = np.repeat(np.arange(len(points)), [len(corners) for corners in points])
    return together(
        shapely.polygons(shapely.linearrings(np.concatenate(points), indices=ring_of), indices=owner)
    )


def together(polygons: Iterable[shapely.Polygon]) -> shapely.MultiPolygon:
    """The polygons as one, with free space on the left of each ring."""
    return shapely.MultiPolygon(list(shapely.orient_polygons(list(polygons))))


def wall_segments(free: shapely.MultiPolygon) -> Float[np.ndarray, "n 2 2"]:
    """Straight pieces of the boundary of free space: two ends x, y [m], with free space on the left."""
    rings = shapely.get_rings(shapely.get_parts(shapely.orient_polygons(free)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    starts = np.flatnonzero(ring[1:] == ring[:-1])
    return np.stack([points[starts], points[starts + 1]], axis=1)


def triangulated(polygons: shapely.Geometry) -> Float[np.ndarray, "n 3 2"]:
    """Counter-clockwise triangles that fill polygons, with no vertices but theirs."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons))
    points = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    side, other = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    # All turn in the same direction, which rounding would hide for the thinnest alone.
    clockwise = (side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]).sum() < 0
    return points[:, ::-1] if clockwise else points


#: Kinds of faces, which `face_kind` is an index of, as in `robosim.building.extrusion`.
KINDS = ("wall", "floor", "ceiling", "furniture", "placed")


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """A mesh whose faces know their kind and material, in `map`."""

    mesh: trimesh.Trimesh
    """All faces, with normals into free space, those of walls, floor and ceiling first; of these, vertices are corners
    of walls only. Faces of placed meshes that close no volume may have either orientation."""
    face_kind: UInt8[np.ndarray, " n_faces"]
    """Kind of each face: index into `KINDS`; rims of slabs between storeys are walls."""
    materials: tuple[str | Material, ...]
    """Radio materials of the faces, by the names of `wireless.em.materials`, or of layers of their own."""
    face_material: UInt8[np.ndarray, " n_faces"]
    """Material of each face: index into `materials`."""
    furnishings: tuple[Furnishing, ...] = ()
    """Meshes placed in it, with heights above the lowest floor, in the order of their faces."""
    floor_ceiling: ClassVar[bool] = False
    """Radio reflects at floor and ceiling only if `TracerConfig.floor_ceiling` says so."""

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest x, y, z [m] in `map`."""
        return self.mesh.bounds

    @property
    def digest(self) -> str:
        """A text that changes with any vertex, face or material."""
        return surfaces_digest(self.mesh, self.face_material, self.materials)

    def submesh(self, *kinds: str) -> trimesh.Trimesh:
        """The faces of some kinds, as a mesh of their own."""
        if unknown := [kind for kind in kinds if kind not in KINDS]:
            raise ValueError(f"kind is {unknown[0]!r}, expected one of {', '.join(KINDS)}.")
        return self._part(np.isin(self.face_kind, [KINDS.index(kind) for kind in kinds]))

    def of_material(self, material: str) -> trimesh.Trimesh:
        """The faces of one radio material, as a mesh of their own."""
        names = list(map(str, self.materials))
        if material not in names:
            raise ValueError(f"material is {material!r}, expected one of {', '.join(names)}.")
        return self._part(self.face_material == names.index(material))

    def _part(self, mask: Bool[np.ndarray, " n_faces"]) -> trimesh.Trimesh:
        used, faces = np.unique(self.mesh.faces[mask], return_inverse=True)
        return plain_mesh(self.mesh.vertices[used], faces.reshape(-1, 3), self.mesh.metadata)


def plain_mesh(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], metadata: dict[str, object]
) -> trimesh.Trimesh:
    """Mesh whose vertices stay as they are, unmerged and in order."""
    mesh = trimesh.Trimesh(vertices, faces, process=False, validate=False, metadata=dict(metadata))
    mesh.units = "m"
    return mesh


#: Kinds of faces; the last is of placed meshes, which are not extruded.
WALL, FLOOR, CEILING, FURNITURE, PLACED = range(5)


class Solid(NamedTuple):
    """Triangles and their kinds."""

    vertices: Float[np.ndarray, "n_vertices 3"]
    faces: Int[np.ndarray, "n_faces 3"]
    kind: UInt8[np.ndarray, " n_faces"]


class Level(NamedTuple):
    """A triangulation at one height, whose triangles share a vertex only if they share edges around it."""

    vertices: Float[np.ndarray, "n_vertices 3"]
    triangles: Int[np.ndarray, "n 3"]


def extrude(
    free: shapely.MultiPolygon,
    furniture: Bool[np.ndarray, " n_rings"],
    height_m: float,
    furniture_height_m: float | None = None,
    ceiling: bool = True,
) -> Solid:
    """Closed shell around free space from z = 0 up, with normals into free space.

    Low furniture that touches something else at a single point stays as high as the walls, since free space would be
    separated there below its lid and connected above.

    Args:
        free: Free floor; outer rings counter-clockwise, holes clockwise.
        furniture: Which rings of `free` go around furniture, in the order of `shapely.get_rings`.
        height_m: Height of the ceiling.
        furniture_height_m: Height of the furniture, under a lid; None for `height_m`.
        ceiling: Whether to close the shell from above.
    """
    outlines = shapely.get_rings(shapely.get_parts(free))
    spots, rings = _spots(outlines)
    lowered = np.zeros(len(rings), bool)
    if furniture_height_m is not None:
        alone = np.bincount(np.concatenate(rings), minlength=len(spots)) == 1
        lowered = furniture & [bool(alone[ring].all()) for ring in rings]

    open_at = _triangulate(free, spots)
    lid_at = _triangulate(shapely.MultiPolygon([shapely.Polygon(ring) for ring in outlines[lowered]]), spots)
    floor = _level(open_at, spots, 0.0)
    top = _level(np.concatenate([open_at, lid_at]), spots, height_m, len(floor.vertices))
    lid = _level(lid_at, spots, furniture_height_m or 0.0, len(floor.vertices) + len(top.vertices))

    start, end = np.concatenate(rings), np.concatenate([np.roll(ring, -1) for ring in rings])
    ring_of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    edge = _half_edges(open_at, start, end)
    below, above = _ends(floor.triangles, edge), _ends(top.triangles, edge)
    low = lowered[ring_of]  # a lid lies on the other side of its edges than the floor does
    above[low] = _ends(lid.triangles, _half_edges(lid_at, end[low], start[low]))[:, ::-1]

    over = top.triangles[:, ::-1] if ceiling else np.empty((0, 3), int)
    # Two triangles for each wall between an edge of the floor and the one above it, normals to its left.
    upright = np.column_stack([below[:, 0], above, below[:, 0], above[:, 1], below[:, 1]]).reshape(-1, 3)
    faces = [floor.triangles, upright, lid.triangles, over]
    of_wall = np.repeat(np.where(furniture[ring_of], FURNITURE, WALL), 2)
    kind = [
        np.full(len(faces[0]), FLOOR),
        of_wall,
        np.full(len(faces[2]), FURNITURE),
        np.full(len(over), CEILING),
    ]
    used, numbered = np.unique(np.concatenate(faces), return_inverse=True)
    vertices = np.concatenate([floor.vertices, top.vertices, lid.vertices])[used]
    return Solid(vertices, numbered.reshape(-1, 3), np.concatenate(kind).astype(np.uint8))


def pockets(segments: Float[np.ndarray, "n 2 2"], height_m: float, kind: int = WALL) -> Solid:
    """Walls between ends (x, y), from z = 0 up, with a face on either side and no volume; each is closed in itself."""
    xy = np.tile(segments, (1, 2, 1))  # below: 0, 1; above: 2, 3
    z = np.broadcast_to([0.0, 0.0, height_m, height_m], (len(segments), 4))
    vertices = np.concatenate([xy, z[:, :, None]], axis=2).reshape(-1, 3)
    # The diagonals of the two faces cross, so that no edge has more than two triangles.
    faces = np.array([[0, 2, 3], [0, 3, 1], [1, 3, 2], [1, 2, 0]])
    faces = (4 * np.arange(len(segments))[:, None, None] + faces).reshape(-1, 3)
    return Solid(vertices, faces, np.full(len(faces), kind, np.uint8))


def _spots(outlines: np.ndarray) -> tuple[Float[np.ndarray, "n 2"], list[Int[np.ndarray, " _"]]]:
    """All distinct points of some rings, and each ring as indices into them, without its repeated end."""
    points, ring_of = shapely.get_coordinates(outlines, return_index=True)
    distinct, index = np.unique(points[:, 0] + 1j * points[:, 1], return_inverse=True)
    counts = np.bincount(ring_of, minlength=len(outlines))
    rings = [ring[:-1] for ring in np.split(index, np.cumsum(counts)[:-1])]
    return np.column_stack([distinct.real, distinct.imag]), rings


def _triangulate(
    polygons: shapely.MultiPolygon, spots: Float[np.ndarray, "n 2"]
) -> Int[np.ndarray, "n_triangles 3"]:
    """Counter-clockwise triangles that fill the polygons, as indices of their corners among `spots`."""
    points = triangulated(polygons)
    return np.searchsorted(spots[:, 0] + 1j * spots[:, 1], points[:, :, 0] + 1j * points[:, :, 1])


def _half_edges(triangles: Int[np.ndarray, "n 3"], start: Sides, end: Sides, *, must: bool = True) -> Sides:
    """Side of a triangle from `start` to `end`, as triangle * 3 + side; -1 if there is none."""
    base = 1 + max(triangles.max(initial=0), start.max(initial=0), end.max(initial=0))
    keys = (triangles * base + np.roll(triangles, -1, axis=1)).ravel()
    order = np.argsort(keys)
    wanted = start * base + end
    position = np.searchsorted(keys, wanted, sorter=order)
    if len(keys) == 0:
        return np.full(len(wanted), -1)
    at = order[np.minimum(position, len(keys) - 1)]
    at = np.where(keys[at] == wanted, at, -1)
    if must and (at < 0).any():
        raise RuntimeError(f"{(at < 0).sum()} edges of the outline are missing in its triangulation.")
    return at


def _ends(triangles: Int[np.ndarray, "n 3"], half_edge: Sides) -> Int[np.ndarray, "m 2"]:
    """Start and end of sides of triangles."""
    row, side = np.divmod(half_edge, 3)
    return np.stack([triangles[row, side], triangles[row, (side + 1) % 3]], axis=1)


def _level(
    triangles: Int[np.ndarray, "n 3"], spots: Float[np.ndarray, "m 2"], z_m: float, first: int = 0
) -> Level:
    """The triangulation at a height, vertices counted from `first`; triangles share one if they share an edge there."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    mate = _half_edges(triangles, end, start, must=False)
    here = np.flatnonzero(mate >= 0)
    corners = np.arange(triangles.size).reshape(-1, 3)
    same, other = _ends(corners, here).T.ravel(), _ends(corners, mate[here])[:, ::-1].T.ravel()
    links = coo_array((np.ones(len(same), bool), (same, other)), shape=(triangles.size, triangles.size))
    count, label = connected_components(links, directed=False)
    vertices = np.full((count, 3), z_m)
    vertices[label, :2] = spots[start]
    return Level(vertices, label.reshape(-1, 3) + first)
