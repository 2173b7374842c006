"""Floor plan of one storey of a triangle mesh: a slice between two heights above its floor.

A cell is free if there is floor under its centre and no surface reaches into it between the two heights;
occupied if one does; unknown otherwise. Small holes in a scanned floor are free. Closed pockets of
floor inside solid walls are not free: a line from there to the outside leaves more solids than it enters. Nor are those
inside of closed bodies that stand in a room.

Many files have faces of any orientation, so places are compared by the closed surfaces that contain them: a place in a
cupboard is inside of all surfaces that contain the room around it, and of the cupboard. Of two rooms that are closed
surfaces of their own neither contains the other. If no surface contains a room, as between solid walls or under the
open sky, only the faces distinguish a body, which they point out of, from another room.

glTF (.glb, .gltf) has y upwards by its standard, and x, -z become the plan's x, y; other formats have no
standard and are read with z upwards, as in robotics. Many files differ: the other one of the two axes is used if it
makes the largest floor more than twice as large. The unit of length, which most formats do not say, is a metre by
default.
Left out: doors that are closed in the mesh stay closed; floors steeper than 45 degrees.

Reference: glTF 2.0 specification, 3.4 (axes and units).
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import get_args

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from robosim.plans.floorplan import (
    FREE,
    LARGEST_M,
    OCCUPIED,
    UNKNOWN,
    FloorPlan,
    MapError,
    ReadingOptions,
    UpAxis,
    grid_size,
)
from robosim.plans.formats.mesh_file import MOST_BYTES, Triangles, load_triangles
from robosim.plans.formats.mesh_floors import LEVEL_COSINE, MeshFloor, area_below_air, find_floors
from robosim.plans.formats.raster import Windings, blocks, cells_touched, cut, section, unit_normals
from robosim.support.reading import reading
from wireless.geometry.closed_surfaces import Sides

#: Some cells of a plan.
Cells = Bool[np.ndarray, "ny nx"]


logger = logging.getLogger(__name__)

RESOLUTION_M = 0.05
DEFAULTS = ReadingOptions()
#: Heights above the floor between which walls are measured where no slice is chosen [m].
SLICE_M = DEFAULTS.slice_m
#: The floor may dip this far below its usual height [m].
_DIP_M = 0.2
#: Largest distance of a storey from a given height [m].
_NEAR_M = 0.5
#: Holes in a scanned floor up to this size are closed [m2].
_HOLE_M2 = 0.1
#: Least free area of a building [m2].
_LEFT_M2 = 1.0
#: A closed surface is a wall and no room if it is thinner [m].
_THICKEST_WALL_M = 0.35
#: A surface of less than this share of the floor is not the floor.
_FLOOR_SHARE = 0.2
#: Faces of larger meshes are not repaired, which would take too long.
_MOST_REPAIRED = 200_000
#: No storey is taller, floor to floor [m].
_TALLEST_M = 40.0
_GLTF = (".glb", ".gltf")
_OTHER = {"y": "z", "z": "y"}


def read_mesh(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan of a storey of a mesh file: GLB, PLY, OBJ, STL and others that trimesh reads."""
    up, unit_m = options.up, options.unit_m
    if up not in get_args(UpAxis):
        raise ValueError(f"up is {up!r}, expected one of {', '.join(get_args(UpAxis))}.")
    if unit_m is not None and not (np.isfinite(unit_m) and unit_m > 0):
        raise ValueError(f"unit_m is {unit_m:g}, expected a positive number of metres, such as 0.001 for mm.")
    remedy = "Export it again, as GLB, PLY, OBJ or STL."
    with reading(path, "a mesh", remedy, most_bytes=MOST_BYTES, kind=MapError) as file:
        triangles = load_triangles(file.read(), path, unit_m or 1.0)
        axis = up if up != "auto" else _likely_up(path, triangles, options.ground_m is None)
        triangles = turned_up(triangles, axis)
        try:
            if unit_m is None:
                _check_size(triangles)
            return plan_from_triangles(triangles, options, name=path.stem)
        except MapError as error:
            raise MapError(
                f"{error} The {axis} axis was taken to point up, and the unit of length for {unit_m or 1:g} m; if "
                f"wrong, pass up={_OTHER[axis]!r} (--up {_OTHER[axis]}), or unit_m=0.001 for mm (--unit 0.001)."
            ) from error


def _check_size(triangles: Triangles) -> None:
    """Raise MapError for a mesh that is longer than any building, or taller than its storeys can be."""
    x, y, z = np.ptp(triangles.reshape(-1, 3), axis=0)
    tall = z > _TALLEST_M and z > _TALLEST_M * len(find_floors(triangles, *SLICE_M))
    if tall or max(x, y) > LARGEST_M:
        raise MapError(
            f"a building {x:.4g} m long, {y:.4g} m wide and {z:.4g} m high? Pass its unit of length: unit_m=0.001 "
            "(--unit 0.001) for mm, 0.0254 for inches, or 1 if it is in metres all the same."
        )


def turned_up(triangles: Triangles, axis: str) -> Triangles:
    """Triangles with z upwards, of ones with the axis "y" or "z" upwards; (x, y, z) becomes (x, -z, y)."""
    return triangles[:, :, [0, 2, 1]] * (1.0, -1.0, 1.0) if axis == "y" else triangles


def _likely_up(path: Path, triangles: Triangles, has_floor: bool) -> str:
    """The axis that points up by custom of the format, unless the other has a far larger floor, and no wall for it."""
    usual = "y" if path.suffix.lower() in _GLTF else "z"
    other = _OTHER[usual]
    span = np.ptp(triangles.reshape(-1, 3), axis=0)
    if not has_floor or span["xyz".index(other)] > span["xyz".index(usual)]:
        return usual
    largest = {
        axis: max(
            (s.area_m2 for s in find_floors(turned_up(triangles, axis), *SLICE_M) if s.has_walls), default=0
        )
        for axis in _OTHER
    }
    has_larger = largest[other] > largest[usual]
    axis, against = (other, usual) if largest[other] > 2 * largest[usual] else (usual, other)
    if has_larger:
        logger.warning(
            f"{path}: the {axis} axis is taken to point up{', as usual in such files' if axis == usual else ''}. The "
            f"largest floor has {largest[axis]:.0f} m2 then, and {largest[against]:.0f} m2 if the {against} axis does. "
            f"If this is wrong, pass up={against!r} (--up {against})."
        )
    return axis


def plan_from_triangles(
    triangles: Triangles, options: ReadingOptions = DEFAULTS, *, name: str = "plan"
) -> FloorPlan:
    """Floor plan of a storey of triangles in memory, z upwards [m].

    Raises:
        MapError: If no floor is found, or none near the given height, or nothing of it is free.
    """
    low, high = options.slice_m
    resolution_m = options.resolution_m or RESOLUTION_M
    if not 0 < low < high < np.inf:
        raise ValueError(
            f"slice_m is ({low:g}, {high:g}), expected two heights above the floor [m], the lower first."
        )
    if options.ground_m is None:
        candidates = find_floors(triangles, low, high)
        floors = [floor for floor in candidates if floor.has_walls] or candidates
        if not floors:
            lowest = triangles[..., 2].min()
            raise MapError(
                "no floor found: no level surface with free air above covers much of the mesh. If it "
                f"has walls alone, pass the height that they stand at: ground_m={lowest:.2f} (--ground {lowest:.2f})."
            )
        height_m = choose_floor(floors, options.floor_height_m).height_m
        triangles = _facing_up(triangles, height_m)
    else:
        height_m = options.ground_m
        (x0, y0), (x1, y1) = (end(triangles[..., :2], axis=(0, 1)) for end in (np.min, np.max))
        ground = np.insert([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], 2, height_m, axis=1)
        triangles = np.concatenate([triangles, ground[[[0, 1, 2], [0, 2, 3]]]])
    free, occupied, origin = _slice(triangles, height_m, low, high, resolution_m)
    if not free.any():
        raise MapError(
            f"nothing is free between {low:g} and {high:g} m above the floor at {height_m:.2f} m. "
            "Choose another slice or another floor height."
        )
    states = np.where(free, FREE, np.where(occupied, OCCUPIED, UNKNOWN)).astype(np.uint8)
    return FloorPlan(occupancy=states, resolution_m=resolution_m, origin=(*origin, 0.0), name=name)


def _facing_up(triangles: Triangles, height_m: float) -> Triangles:
    """Triangles with inverted surfaces turned over: floors that face down, and walls that face inwards.

    Each connected surface is judged by itself; where more than two faces meet in an edge, one body stands on another.
    Inconsistent faces of surfaces are repaired first, in meshes that are small enough.
    """
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(triangles.size // 3).reshape(-1, 3))
    if not mesh.is_winding_consistent and len(triangles) <= _MOST_REPAIRED:
        trimesh.repair.fix_normals(mesh, multibody=True)
        triangles = np.array(mesh.triangles)
        logger.warning("neighbouring faces of the mesh point to different sides; they are turned alike.")
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1)
    surface = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(triangles))
    over = _is_inverted_wall(triangles, normals, length, surface)[surface]
    at_height = np.abs(triangles[:, :, 2].mean(axis=1) - height_m) <= _DIP_M
    level = np.flatnonzero(at_height & (np.abs(normals[:, 2]) > LEVEL_COSINE * length))
    air = np.zeros(len(triangles))
    air[level] = area_below_air(triangles, level, SLICE_M[1]) * np.sign(normals[level, 2])
    if air.sum() < 0:
        # Walls' own undersides face down too, and are not the floor.
        over |= np.bincount(surface, air)[surface] < _FLOOR_SHARE * air.sum()
    if over.any():
        logger.warning("a floor or wall of the mesh is inside out; its surface is turned over.")
    return np.where(over[:, None, None], triangles[:, ::-1], triangles)


def _is_inverted_wall(
    triangles: Triangles,
    normals: Float[np.ndarray, "n 3"],
    length: Float[np.ndarray, " n"],
    surface: Int[np.ndarray, " n"],
) -> Bool[np.ndarray, " s"]:
    """Find surfaces that enclose a thin volume, of a wall or slab, and face into it; none if rooms are such too."""
    n = int(surface.max()) + 1
    area = np.bincount(surface, length, n)
    total = np.stack([np.bincount(surface, axis, n) for axis in normals.T])
    closed = np.linalg.norm(total, axis=0) < 1e-6 * area
    count = np.bincount(surface, minlength=n)
    middle = np.stack([np.bincount(surface, axis, n) / count for axis in triangles[:, 0].T], axis=1)
    volume = np.bincount(surface, np.einsum("ij,ij->i", triangles[:, 0] - middle[surface], normals), n) / 6
    is_level = np.abs(normals[:, 2]) >= LEVEL_COSINE * length
    level = np.bincount(surface, length * is_level, n) / 2
    inwards = closed & (volume < 0)
    # Upright as walls, or level as slabs between storeys.
    thin = -2 * volume < _THICKEST_WALL_M * np.maximum(area / 2 - level, level)
    return inwards & thin & ~(inwards & ~thin).any()


def choose_floor(floors: list[MeshFloor], floor_height_m: float | None) -> MeshFloor:
    """The floor nearest to a height, within half a metre, or the lowest one, with a warning if there are others."""
    heights = ", ".join(f"{floor.height_m:.2f} m ({floor.area_m2:.0f} m2)" for floor in floors)
    if floor_height_m is None:
        if len(floors) > 1:
            logger.warning(f"floors found at {heights}; the lowest is taken. Choose by the floor height.")
        return floors[0]
    nearest = min(floors, key=lambda floor: abs(floor.height_m - floor_height_m))
    if not abs(nearest.height_m - floor_height_m) <= _NEAR_M:
        raise MapError(f"floor height is {floor_height_m:g} m, but floors were found at {heights}.")
    return nearest


def _slice(
    triangles: Triangles, height: float, low: float, high: float, resolution_m: float
) -> tuple[Cells, Cells, tuple[float, float]]:
    """Free cells, occupied cells, and the lower left corner of the grid, which just holds the floor."""
    bottom, top = height - _DIP_M, height + low

    def floor() -> Iterator[Triangles]:
        """Polygons of the floor, cut out of the triangles that face up."""
        for block in blocks(triangles):
            z, facing_up = block[:, :, 2], unit_normals(block)[:, 2] > LEVEL_COSINE
            yield cut(block[facing_up & (z.max(axis=1) >= bottom) & (z.min(axis=1) <= top)], bottom, top)

    corners = (polygons.reshape(-1, 3)[:, :2] for polygons in floor() if len(polygons))
    ends = np.array([(loop.min(axis=0), loop.max(axis=0)) for loop in corners])
    lower, upper = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
    nx, ny = grid_size(lower, upper, resolution_m, "the floor")
    origin = lower - resolution_m
    scale, shift = np.array([1 / resolution_m, 1 / resolution_m, 1.0]), np.append(origin, 0.0)
    has_floor = _covers(((polygons - shift) * scale for polygons in floor()), (ny, nx))
    flat, middle = (triangles - shift) * scale, (top + height + high) / 2
    occupied = cells_touched(flat, top, height + high, (ny, nx))
    free = _with_holes_closed(has_floor & ~occupied, occupied, resolution_m)
    free = _without_pockets(free, _inside_solids(flat, middle, (ny, nx)), resolution_m)
    del flat

    def places(cells: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        return np.insert(origin + (cells[:, ::-1] + 0.5) * resolution_m, 2, middle, axis=1)

    return _without_bodies(free, triangles, places), occupied, (float(origin[0]), float(origin[1]))


def _with_holes_closed(free: Cells, occupied: Cells, resolution_m: float) -> Cells:
    """Free cells with adjacent small holes, in which nothing stands; a column's inside is next to no free cell."""
    hole, n = ndimage.label(~free & ~occupied)
    small = np.bincount(hole.ravel(), minlength=n + 1) * resolution_m**2 <= _HOLE_M2
    is_adjacent = np.zeros(n + 1, bool)
    is_adjacent[hole[ndimage.binary_dilation(free)]] = True
    at_border = np.zeros(n + 1, bool)
    at_border[np.concatenate([hole[0], hole[-1], hole[:, 0], hole[:, -1]])] = True
    closed = small & is_adjacent & ~at_border
    closed[0] = False
    return free | closed[hole]


def _inside_solids(triangles: Triangles, height: float, shape: tuple[int, int]) -> Cells:
    """Cells at whose centre a height is inside a solid; x and y of the triangles in cells.

    A line sideways from there leaves more solids, through surfaces that face away, than it enters, and so does a line
    upwards. For closed solids one of the two would do; sheets, which bound no solid, seldom pass both: a room has
    walls or a ceiling that face it. Upwards, only triangles above the height count, so that one sum over their edges
    is enough.
    """
    sideways = Windings(shape)
    for block in blocks(triangles):
        sideways.add(*section(block, height))
    above = (cut(block[block[:, :, 2].max(axis=1) > height], height, np.inf) for block in blocks(triangles))
    return (sideways.numbers() > 0) & _covers(above, shape)


def _covers(polygons: Iterable[Float[np.ndarray, "n m 3"]], shape: tuple[int, int]) -> Cells:
    """Cells whose centre lies below (or above) more polygons that face up than polygons that face down."""
    windings = Windings(shape)
    for polygon in polygons:
        start, end = polygon[:, :, :2], np.roll(polygon[:, :, :2], -1, axis=1)
        windings.add(start.reshape(-1, 2), end.reshape(-1, 2))
    return windings.numbers() > 0


def _without_pockets(free: Cells, solid: Cells, resolution_m: float) -> Cells:
    """Free cells without parts mostly inside solids, unless hardly any would be left, as in a shell of sheets."""
    component, n = ndimage.label(free)
    size = np.bincount(component[free], minlength=n + 1)
    pocket = np.bincount(component[free & solid], minlength=n + 1) > size / 2
    left = free & ~pocket[component]
    return left if np.count_nonzero(left) * resolution_m**2 > _LEFT_M2 else free


def _without_bodies(
    free: Cells, triangles: Triangles, places: Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, "n 3"]]
) -> Cells:
    """Free cells without parts inside a body, such as a cupboard; `places` converts rows and columns to [m]."""
    component, n = ndimage.label(free)
    if n < 2:
        return free
    # The middle of a part is farthest from all that bounds it.
    depth = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    middle = places(np.array(ndimage.maximum_position(depth, component, np.arange(1, n + 1)), float))
    return free & ~np.append(False, in_bodies(triangles, middle))[component]


def in_bodies(triangles: Triangles, places: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
    """Whether places [m], one in each room and each possible body, are in bodies in the surroundings of others."""
    within, points_out = _within(triangles, places)
    kinds, kind = np.unique(within, axis=0, return_inverse=True)
    body = np.zeros(len(kinds), bool)
    for k in np.argsort(kinds.sum(axis=1), kind="stable"):
        around = (kinds <= kinds[k]).all(axis=1) & ~body
        # The inside of a hollow body is in its inner surface too.
        around &= (kinds[k].sum() - kinds.sum(axis=1)) % 2 == 1
        if around.any() and not kinds[around].any():
            around &= points_out[kind == k].all()
        body[k] = around.any()
    return body[kind.ravel()]


def _within(
    triangles: Triangles, places: Float[np.ndarray, "k 3"]
) -> tuple[Bool[np.ndarray, "k s"], Bool[np.ndarray, " k"]]:
    """Closed surfaces that places are in, and whether the faces of the smallest of them point out of it."""
    corners = triangles.reshape(-1, 3)
    sides = Sides(trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False))
    faces = np.flatnonzero(sides.closed)
    surface, which = np.unique(sides.surface[faces], return_inverse=True)
    low, high = np.full((len(surface), 3), np.inf), np.full((len(surface), 3), -np.inf)
    np.minimum.at(low, which, triangles[faces].min(axis=1))
    np.maximum.at(high, which, triangles[faces].max(axis=1))
    volume = np.bincount(which, np.linalg.det(triangles[faces] - low[which][:, None]) / 6, len(surface))
    place, body = np.nonzero(((places[:, None] > low) & (places[:, None] < high)).all(axis=2))
    inside, _ = sides.inside(places[place], surface[body])
    within = np.zeros((len(places), len(surface)), bool)
    within[place[inside], body[inside]] = True
    if not len(surface):
        return within, np.zeros(len(places), bool)
    innermost = np.where(within, np.abs(volume), np.inf).argmin(axis=1)
    return within, volume[innermost] > 0
