"""A building of several storeys: floor plans over each other, slabs between them, and openings in these.

Each storey is the building of its plan alone (`robosim.building.building`), at its own height. Where a slab has an
opening, its top and underside are left out and its rim is a wall. An opening is clipped to where the floors below and
above are both free. All of it is one mesh: a closed shell around each free volume with normals into it, whose walls,
floors and ceilings meet in common vertices; then the furnishings of the storeys. Corners at one place become vertices,
one for each fan of triangles around it: where two parts of a surface touch at a point or along a line, each has its own
vertices there, so that every edge has exactly two triangles.

Left out: stairs, furniture lower than its storey, passages of no width, the outsides of walls and slabs.
"""

import logging
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from robosim.building.building import (
    Building,
    BuildingConfig,
    Storey,
    make_building,
    material_of,
    with_furnishings,
)
from robosim.building.extrusion import (
    CEILING,
    FLOOR,
    FURNITURE,
    WALL,
    Faces,
    plain_mesh,
    polygons_of,
    rings_of,
    triangulated,
    wall_segments,
)
from robosim.parts import MaterialPart
from robosim.plans.floorplan import MapError
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from wireless.em.materials import Material

logger = logging.getLogger(__name__)

#: Corners of openings this close to corners or walls are on them [m].
_ON_M = 1e-9
#: Corners whose coordinates differ by less are merged [m].
SAME_M = 1e-8
#: Smaller parts of openings between walls are dropped [m2].
_LEAST_M2 = 0.01


@dataclass(frozen=True, kw_only=True)
class StoreysConfig:
    """How floor plans become a building of several storeys."""

    building: BuildingConfig = field(default_factory=BuildingConfig)
    """How each plan becomes a storey; heights are those of the storeys."""
    slab_material: MaterialPart = "concrete"
    """Radio material of slabs' rims in openings."""

    def __post_init__(self) -> None:
        material_of(self.slab_material, "slab_material")
        for name, wanted in (("ceiling", True), ("furniture_height_m", None)):
            value = getattr(self.building, name)
            if value is not wanted:
                raise ValueError(
                    f"building.{name} is {value}, expected {wanted} in a building of several storeys. Leave it out."
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class Storeys(Faces):
    """Storeys over each other in three dimensions, in the `map` frame: z up, the lowest floor at z = 0."""

    plan: StoreysPlan
    """Its plans."""
    storeys: tuple[Storey, ...]
    """From the lowest up."""

    def __repr__(self) -> str:
        return f"<Storeys {self.plan.name!r}: {len(self.storeys)}, {len(self.mesh.faces)} faces>"


#: Corners of triangles [m], and the kind and material of each.
_Part = tuple[Float[np.ndarray, "n 3 3"], Int[np.ndarray, " n"], list[str | Material]]


def make_storeys(plan: StoreysPlan, *, config: StoreysConfig | None = None) -> Storeys:
    """Extrude floor plans, from the lowest up, to storeys over each other.

    Raises:
        MapError: If a plan has no free area, or an opening is no polygon or nowhere between two free floors.
    """
    config = config or StoreysConfig()
    alone = [
        make_building(plan.storey(number).plan, config=replace(config.building, height_m=storey.height_m))
        for number, storey in enumerate(plan.storeys)
    ]
    free = [building.free for building in alone]
    opening = [
        _opening(plan.label, number, storey, free[number], free[number + 1])
        for number, storey in enumerate(plan.storeys[:-1])
    ]
    free, opening = _noded(free, opening)
    nothing = shapely.MultiPolygon()
    parts: list[_Part] = []
    slab = [
        storey.slab_material and material_of(storey.slab_material, "slab_material") for storey in plan.storeys
    ]
    for i, storey in enumerate(plan.storeys):
        low = plan.floor_m(i)
        high = low + storey.height_m
        below, above = ([nothing, *opening, nothing])[i : i + 2]
        over, under = slab[i], slab[i - 1] if i else None
        parts += [
            _walls(alone[i], free[i], low, high),
            _level(free[i], below, low, FLOOR, under or config.building.material("floor")),
            _level(free[i], above, high, CEILING, over or config.building.material("ceiling")),
        ]
        if i < len(opening):
            rim = _upright(wall_segments(opening[i]), high, plan.floor_m(i + 1))
            of_rim = over or material_of(config.slab_material, "slab_material")
            parts.append((rim, np.full(len(rim), WALL), [of_rim] * len(rim)))
    corner, kind = (np.concatenate(column) for column in list(zip(*parts, strict=True))[:2])
    vertices, faces, triangle = make_shell(corner)
    material = [entry for _, _, names in parts for entry in names]
    materials = tuple(dict.fromkeys(material))
    number_of = {entry: number for number, entry in enumerate(materials)}
    of_face = np.array([number_of[entry] for entry in material], np.uint8)
    logger.info(f"{plan.name}: {len(plan.storeys)} storeys, {len(faces)} faces")
    bare = Storeys(
        plan=plan,
        storeys=tuple(
            Storey(building=building, floor_m=plan.floor_m(i), opening=([*opening, nothing])[i])
            for i, building in enumerate(alone)
        ),
        mesh=plain_mesh(vertices, faces, {"plan": plan.name, "frame": "map"}),
        face_kind=kind.astype(np.uint8)[triangle],
        materials=materials,
        face_material=of_face[triangle],
    )
    raised = tuple(
        replace(thing, z_m=thing.z_m + storey.floor_m)
        for storey in bare.storeys
        for thing in storey.building.furnishings
    )
    return with_furnishings(bare, raised)


def _noded(
    free: list[shapely.MultiPolygon], opening: list[shapely.MultiPolygon]
) -> tuple[list[shapely.MultiPolygon], list[shapely.MultiPolygon]]:
    """Floors and openings with corners wherever one next to them has one on their outline."""
    count = -1
    while count != (count := int(shapely.get_num_coordinates([*free, *opening]).sum())):
        opening = [_with_corners(hole, free[i : i + 2]) for i, hole in enumerate(opening)]
        free = [_with_corners(area, opening[max(0, i - 1) : i + 1]) for i, area in enumerate(free)]
    return free, opening


def _opening(
    name: str, number: int, storey: StoreyPlan, below: shapely.MultiPolygon, above: shapely.MultiPolygon
) -> shapely.MultiPolygon:
    """Where the slab over a storey is open."""
    parts = []
    for ring in storey.openings:
        polygon = shapely.Polygon(ring)
        subject = f"{name}: storey {number}: openings has the polygon {[list(point) for point in ring][:4]}"
        if not polygon.is_valid or polygon.area == 0:
            raise MapError(f"{subject}, expected one that encloses an area and does not cross itself.")
        parts.append(_polygons(polygon & below & above))
        if parts[-1].is_empty:
            raise MapError(
                f"{subject}, in which the floors below and above are nowhere both free. Coordinates are metres in the "
                "frame of the plans, which must lie over each other."
            )
    return _polygons(shapely.union_all(parts))


def _polygons(area: shapely.Geometry) -> shapely.MultiPolygon:
    """The parts of an area that are not negligible."""
    parts = [
        polygon
        for polygon in shapely.get_parts(area)
        if polygon.geom_type == "Polygon" and polygon.area > _LEAST_M2
    ]
    return shapely.MultiPolygon(list(shapely.orient_polygons(parts)))


def _with_corners(area: shapely.MultiPolygon, others: list[shapely.MultiPolygon]) -> shapely.MultiPolygon:
    """Polygons with a corner wherever one of others has a corner on their outline."""
    points = shapely.get_coordinates(others)
    if area.is_empty or not len(points):
        return area
    points = np.unique(points, axis=0)
    twins = cKDTree(points).query_pairs(_ON_M, output_type="ndarray")
    points = np.delete(points, twins[:, 1], axis=0)
    tree, places = cKDTree(points), shapely.STRtree(shapely.points(points))
    rings, owner = rings_of(area)
    outlines = []
    for ring in rings:
        corner = shapely.get_coordinates(ring)[:-1]
        off, nearest = tree.query(corner, distance_upper_bound=_ON_M)
        corner = np.where((off < _ON_M)[:, None], points[np.minimum(nearest, len(points) - 1)], corner)
        ends = np.stack([corner, np.roll(corner, -1, axis=0)], axis=1)
        side, point = places.query(shapely.linestrings(ends), predicate="dwithin", distance=_ON_M)
        inner = (points[point][:, None] != ends[side]).any(axis=2).all(axis=1)
        side, point = side[inner], point[inner]
        share = np.linalg.norm(points[point] - ends[side, 0], axis=1)
        order = np.lexsort((share, side))
        outlines.append(np.insert(corner, side[order] + 1, points[point[order]], axis=0))
    return polygons_of(outlines, owner)


def _upright(segments: Float[np.ndarray, "n 2 2"], low: float, high: float) -> Float[np.ndarray, "m 3 3"]:
    """Two triangles over each segment, normals to its left."""
    a, b = segments[:, 0], segments[:, 1]
    at = [np.column_stack([xy, np.full(len(xy), z)]) for xy, z in ((a, low), (a, high), (b, high), (b, low))]
    return np.stack([at[0], at[1], at[2], at[0], at[2], at[3]], axis=1).reshape(-1, 3, 3)


def _walls(alone: Building, free: shapely.MultiPolygon, low: float, high: float) -> _Part:
    """Walls around a storey, each of the kind and material that it has in the storey alone."""
    segments = wall_segments(free)
    upright = np.flatnonzero(np.isin(alone.face_kind, (WALL, FURNITURE)))
    corner = alone.mesh.vertices[alone.mesh.faces[upright]][:, :, :2]
    # Seen from above a face is a line, from its leftmost corner to the one farthest from it.
    far = np.linalg.norm(corner[:, :, None] - corner[:, None], axis=3).reshape(len(corner), 9).argmax(axis=1)
    row = np.arange(len(corner))
    lines = shapely.linestrings(np.stack([corner[row, far // 3], corner[row, far % 3]], axis=1))
    face = upright[shapely.STRtree(lines).nearest(shapely.points(segments.mean(axis=1)))]
    materials = [alone.materials[i] for i in np.repeat(alone.face_material[face], 2)]
    return _upright(segments, low, high), np.repeat(alone.face_kind[face], 2).astype(np.int64), materials


def _level(
    free: shapely.MultiPolygon, hole: shapely.MultiPolygon, z_m: float, kind: int, material: str | Material
) -> _Part:
    """Floor or ceiling of a storey but for the opening in it."""
    area = shapely.difference(free, hole) if not hole.is_empty else free
    solid = [
        polygon
        for polygon in shapely.get_parts(area)
        if polygon.geom_type == "Polygon" and not polygon.is_empty
    ]
    if not solid:
        return np.empty((0, 3, 3)), np.empty(0, np.int64), []
    xy = triangulated(shapely.MultiPolygon(solid))
    xy = xy if kind == FLOOR else xy[:, ::-1]
    xy = _parted(xy, np.unique(shapely.get_coordinates([free, hole]), axis=0))
    corner = np.concatenate([xy, np.full((*xy.shape[:2], 1), z_m)], axis=2)
    return corner, np.full(len(corner), kind), [material] * len(corner)


def _parted(
    triangles: Float[np.ndarray, "n 3 2"], points: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "k 3 2"]:
    """Triangles cut at points on their sides, so that none of these meets two sides of others; slivers are left out."""
    side = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    edge, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    triangles = triangles[np.abs(edge[:, 0] * other[:, 1] - edge[:, 1] * other[:, 0]) > _ON_M * side]
    places = shapely.STRtree(shapely.points(points))
    while True:
        ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        line, point = places.query(shapely.linestrings(ends), predicate="dwithin", distance=_ON_M)
        inner = (np.linalg.norm(ends[line] - points[point][:, None], axis=2) > _ON_M).all(axis=1)
        line, point = line[inner], point[inner]
        which, first = np.unique(line // 3, return_index=True)
        if not len(which):
            return triangles
        k, at = line[first] % 3, points[point[first]]
        a, b, c = (triangles[which, (k + step) % 3] for step in range(3))
        halves = np.concatenate([np.stack([a, at, c], axis=1), np.stack([at, b, c], axis=1)])
        triangles = np.concatenate([np.delete(triangles, which, axis=0), halves])


def make_shell(
    corner: Float[np.ndarray, "n 3 3"],
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "m 3"], Int[np.ndarray, " m"]]:
    """Vertices and faces of triangles [m] that make closed shells, with normals into free space.

    Returns:
        Vertices, faces, and the triangle of each face; triangles with two corners at one place are dropped.
    """
    place = np.unique(np.round(corner.reshape(-1, 3) / SAME_M).astype(np.int64), axis=0, return_inverse=True)[
        1
    ]
    triangle = place.reshape(-1, 3)
    proper = np.flatnonzero((triangle != np.roll(triangle, -1, axis=1)).all(axis=1))
    triangle, corner, place = triangle[proper], corner[proper], triangle[proper].ravel()
    start, end = triangle.ravel(), np.roll(triangle, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((high, low))
    new = np.append(True, (np.diff(low[order]) > 0) | (np.diff(high[order]) > 0))
    first = np.flatnonzero(new)
    count = np.diff(np.append(first, len(order)))
    mate = np.full(len(start), -1)
    pairs = order[first[count == 2][:, None] + np.arange(2)]
    mate[pairs], mate[pairs[:, ::-1]] = pairs[:, ::-1], pairs
    for at, size in zip(first[count != 2], count[count != 2], strict=True):
        _pair(order[at : at + size], corner, start, mate)
    if (mate < 0).any() or (start[mate] != end).any():
        side = int(np.flatnonzero((mate < 0) | (start[mate] != end))[0])
        raise RuntimeError(f"The shell is open at the edge from {corner.reshape(-1, 3)[side]} on.")
    ends = np.arange(len(start)), 3 * (np.arange(len(start)) // 3) + (np.arange(len(start)) + 1) % 3
    # A side starts where its mate ends.
    links = coo_array((np.ones(len(start), bool), (ends[0], ends[1][mate])), shape=(len(start),) * 2)
    n, label = connected_components(links, directed=False)
    vertices = np.empty((n, 3))
    _, representative, again = np.unique(place, return_index=True, return_inverse=True)
    vertices[label] = corner.reshape(-1, 3)[representative[again]]
    return vertices, label.reshape(-1, 3), proper


def _pair(
    sides: Int[np.ndarray, " k"],
    corner: Float[np.ndarray, "n 3 3"],
    start: Int[np.ndarray, " s"],
    mate: Int[np.ndarray, " s"],
) -> None:
    """Pair the triangle sides on one line, each with the next one around it on the free side of its triangle."""

    def into(side: int) -> Float[np.ndarray, "3"]:
        """Direction into a side's triangle, at right angles to the line."""
        direction = corner[side // 3, (side % 3 + 2) % 3] - corner[side // 3, side % 3]
        direction = direction - (direction @ along) * along
        return direction / np.linalg.norm(direction)

    first = sides[0]
    along = corner[first // 3, (first % 3 + 1) % 3] - corner[first // 3, first % 3]
    along = along / np.linalg.norm(along)
    inward = {int(side): into(int(side)) for side in sides}
    for side in inward:
        forth = along if start[side] == start[first] else -along
        normal = np.cross(forth, inward[side])
        turn = {
            other: np.arctan2(inward[other] @ normal, inward[other] @ inward[side]) % (2 * np.pi)
            for other in inward
            if start[other] != start[side]
        }
        if turn:
            mate[side] = min(turn, key=lambda other: (turn[other], other))
