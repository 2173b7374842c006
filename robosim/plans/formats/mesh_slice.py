"""Floor plan of one storey of a triangle mesh: what stands between two heights above its floor.

A cell is free if there is floor under its centre and no surface reaches into it between the two heights;
occupied if one does; unknown otherwise. Small holes in a scanned floor are free. Closed pockets of
floor inside solid walls are not free: leaving there, one comes out of more solids than one goes into. Nor are those
inside of closed bodies that stand in a room (`robosim.plans.formats.mesh_bodies`).

glTF (.glb, .gltf) has y upwards by its standard, and x, -z become the plan's x, y; other formats have no
standard and are taken to have z upwards, as in robotics. Many files break this custom: the other one of the
two axes is taken if it makes the largest floor more than twice as large. Nor do most formats say their unit of
length, which is a metre unless told otherwise.
Left out: doors that are closed in the mesh stay closed; floors steeper than 45 degrees.

Reference: glTF 2.0 specification, 3.4 (axes and units).
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan, MapError, grid_size
from robosim.plans.formats.mesh_bodies import in_bodies
from robosim.plans.formats.mesh_file import MOST_BYTES, Triangles, load_triangles
from robosim.plans.formats.mesh_raster import blocks, cells_touched, cut, section, unit_normals
from robosim.plans.formats.scanline import Windings
from robosim.plans.formats.storeys import LEVEL_COSINE, Storey, find_storeys
from robosim.support.reading import reading

logger = logging.getLogger(__name__)

UpAxis = Literal["auto", "y", "z"]

RESOLUTION_M = 0.05
#: Heights above the floor between which nothing may stand: above doorsills and rugs, below lintels [m].
SLICE_M = (0.2, 1.5)
#: The floor may dip this far below its usual height [m].
_DIP_M = 0.2
#: A storey asked for may lie this far from the height given [m].
_NEAR_M = 0.5
#: Holes in a scanned floor up to this size are closed [m2].
_HOLE_M2 = 0.1
#: The least free area that is believed to be all there is [m2].
_LEFT_M2 = 1.0
_GLTF = (".glb", ".gltf")
_OTHER = {"y": "z", "z": "y"}


def read_mesh(
    path: Path,
    *,
    resolution_m: float = RESOLUTION_M,
    floor_height_m: float | None = None,
    slice_m: tuple[float, float] = SLICE_M,
    up: UpAxis = "auto",
    unit_m: float = 1.0,
) -> FloorPlan:
    """Floor plan of a storey of a mesh file that trimesh reads (GLB, PLY, OBJ, STL and others).

    Args:
        path: The mesh.
        resolution_m: Side of a cell [m].
        floor_height_m: Height of the storey's floor above the mesh's own zero [m], to within half a metre;
            the lowest storey if not given.
        slice_m: Heights above the floor between which nothing may stand in free cells [m].
        up: Axis that points up; "auto" is y for glTF and z for all others, unless the other one of the two
            has a floor more than twice as large.
        unit_m: The mesh's unit of length [m], for example 0.001 for millimetres.

    Raises:
        MapError: If the file cannot be read, has no triangles or vertices that are not finite, or no floor is
            found, or none near the height asked for.
        ValueError: If an option has a senseless value.
    """
    if up not in get_args(UpAxis):
        raise ValueError(f"up is {up!r}, expected one of {', '.join(get_args(UpAxis))}.")
    if not (np.isfinite(unit_m) and unit_m > 0):
        raise ValueError(f"unit_m is {unit_m:g}, expected a positive number of metres, such as 0.001 for mm.")
    remedy = "Export it again, as GLB, PLY, OBJ or STL."
    with reading(path, "a mesh", remedy, most_bytes=MOST_BYTES, kind=MapError) as file:
        triangles = load_triangles(file.read(), path, unit_m)
        axis = up if up != "auto" else _likely_up(path, triangles)
        triangles = turned_up(triangles, axis)
        try:
            return plan_from_triangles(
                triangles,
                resolution_m=resolution_m,
                floor_height_m=floor_height_m,
                slice_m=slice_m,
                name=path.stem,
            )
        except MapError as error:
            raise MapError(
                f"{error} The {axis} axis was taken to point up, and the unit of length for {unit_m:g} m; if "
                f"wrong, pass up={_OTHER[axis]!r} (--up {_OTHER[axis]}), or unit_m=0.001 for mm (--unit 0.001)."
            ) from error


def turned_up(triangles: Triangles, axis: str) -> Triangles:
    """Triangles with z upwards, of ones with the axis "y" or "z" upwards; (x, y, z) becomes (x, -z, y)."""
    return triangles[:, :, [0, 2, 1]] * (1.0, -1.0, 1.0) if axis == "y" else triangles


def _likely_up(path: Path, triangles: Triangles) -> str:
    """The axis that points up by the custom of the format, unless the other one has a far larger floor."""
    usual = "y" if path.suffix.lower() in _GLTF else "z"
    largest = {
        axis: max(
            (s.area_m2 for s in find_storeys(turned_up(triangles, axis), *SLICE_M) if s.has_walls), default=0
        )
        for axis in _OTHER
    }
    if largest[_OTHER[usual]] <= 2 * largest[usual]:
        if largest[_OTHER[usual]] > largest[usual]:
            logger.warning(
                "%s: the %s axis is taken to point up, as usual in such files, but the largest floor has %.0f m2 then, "
                "and %.0f m2 if the %s axis does. If this is wrong, pass up=%r (--up %s).",
                path,
                usual,
                largest[usual],
                largest[_OTHER[usual]],
                *(_OTHER[usual],) * 3,
            )
        return usual
    logger.warning(
        "%s: the %s axis is taken to point up: its largest floor has %.0f m2, %.0f m2 that of the usual %s "
        "axis. If this is wrong, pass up=%r (--up %s).",
        path,
        _OTHER[usual],
        largest[_OTHER[usual]],
        largest[usual],
        usual,
        usual,
        usual,
    )
    return _OTHER[usual]


def plan_from_triangles(
    triangles: Triangles,
    *,
    resolution_m: float = RESOLUTION_M,
    floor_height_m: float | None = None,
    slice_m: tuple[float, float] = SLICE_M,
    name: str = "plan",
) -> FloorPlan:
    """Floor plan of a storey of triangles in memory, z upwards [m]; options as for `read_mesh`.

    Raises:
        MapError: If no floor is found, or none near the height asked for, or nothing of it is free.
        ValueError: If the slice is empty or does not lie above the floor.
    """
    low, high = slice_m
    if not 0 < low < high < np.inf:
        raise ValueError(
            f"slice_m is ({low:g}, {high:g}), expected two heights above the floor [m], the lower first."
        )
    triangles, storeys = _facing_up(triangles, low, high)
    storey = choose_storey(storeys, floor_height_m)
    plan = _slice(triangles, storey.height_m, low, high, resolution_m)
    if not plan[0].any():
        raise MapError(
            f"nothing is free between {low:g} and {high:g} m above the floor at {storey.height_m:.2f} m. "
            "Choose another slice or another floor height."
        )
    free, occupied, origin = plan
    states = np.where(free, FREE, np.where(occupied, OCCUPIED, UNKNOWN)).astype(np.uint8)
    return FloorPlan(occupancy=states, resolution_m=resolution_m, origin=(*origin, 0.0), name=name)


def _facing_up(triangles: Triangles, low: float, high: float) -> tuple[Triangles, list[Storey]]:
    """Triangles and their storeys; turned inside out if only so there is a floor with walls on it."""
    storeys = find_storeys(triangles, low, high)
    with_walls = [storey for storey in storeys if storey.has_walls]
    if with_walls:
        return triangles, with_walls
    turned = triangles[:, ::-1]
    with_walls = [storey for storey in find_storeys(turned, low, high) if storey.has_walls]
    if with_walls:
        logger.warning("the mesh's floor faces down; it is taken to be inside out.")
        return turned, with_walls
    if not storeys:
        raise MapError("no floor found: no level surface of the mesh faces up.")
    return triangles, storeys


def choose_storey(storeys: list[Storey], floor_height_m: float | None) -> Storey:
    """The storey nearest to a height, or the lowest one; says so where there is a choice.

    Raises:
        MapError: If no floor lies within half a metre of the height.
    """
    found = ", ".join(f"{storey.height_m:.2f} m ({storey.area_m2:.0f} m2)" for storey in storeys)
    if floor_height_m is None:
        if len(storeys) > 1:
            logger.warning("floors found at %s; the lowest is taken. Choose by the floor height.", found)
        return storeys[0]
    storey = min(storeys, key=lambda storey: abs(storey.height_m - floor_height_m))
    if not abs(storey.height_m - floor_height_m) <= _NEAR_M:
        raise MapError(f"floor height is {floor_height_m:g} m, but floors were found at {found}.")
    return storey


def _slice(
    triangles: Triangles, height: float, low: float, high: float, resolution_m: float
) -> tuple[Bool[np.ndarray, "ny nx"], Bool[np.ndarray, "ny nx"], tuple[float, float]]:
    """Free cells, occupied cells, and the lower left corner of the grid, which just holds the floor."""
    bottom, top = height - _DIP_M, height + low

    def floor() -> Iterator[Triangles]:
        """Its polygons, cut out of the triangles that face up."""
        for block in blocks(triangles):
            z, facing_up = block[:, :, 2], unit_normals(block)[:, 2] > LEVEL_COSINE
            yield cut(block[facing_up & (z.max(axis=1) >= bottom) & (z.min(axis=1) <= top)], bottom, top)

    corners = (polygons.reshape(-1, 3)[:, :2] for polygons in floor() if len(polygons))
    ends = np.array([(some.min(axis=0), some.max(axis=0)) for some in corners])
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


def _with_holes_closed(
    free: Bool[np.ndarray, "ny nx"], occupied: Bool[np.ndarray, "ny nx"], resolution_m: float
) -> Bool[np.ndarray, "ny nx"]:
    """Free cells with the small holes beside them, in which nothing stands.

    The inside of a column is no such hole: only its occupied cells lie beside free ones.
    """
    hole, n = ndimage.label(~free & ~occupied)
    small = np.bincount(hole.ravel(), minlength=n + 1) * resolution_m**2 <= _HOLE_M2
    beside = np.zeros(n + 1, bool)
    beside[hole[ndimage.binary_dilation(free)]] = True
    at_border = np.zeros(n + 1, bool)
    at_border[np.concatenate([hole[0], hole[-1], hole[:, 0], hole[:, -1]])] = True
    closed = small & beside & ~at_border
    closed[0] = False
    return free | closed[hole]


def _inside_solids(triangles: Triangles, height: float, shape: tuple[int, int]) -> Bool[np.ndarray, "ny nx"]:
    """Cells at whose centre a height is inside a solid; x and y of the triangles in cells.

    Going sideways from there one leaves more solids, through surfaces that face away, than one enters, and so
    does one going up. Closed solids need one of the two; sheets, which bound no solid, seldom pass both: a
    room has walls that face it or a ceiling that does. Going up, only what lies above the height is looked
    at, so that one sum over the edges of all triangles there will do.
    """
    sideways = Windings(shape)
    for block in blocks(triangles):
        sideways.add(*section(block, height))
    above = (cut(block[block[:, :, 2].max(axis=1) > height], height, np.inf) for block in blocks(triangles))
    return (sideways.numbers() > 0) & _covers(above, shape)


def _covers(
    polygons: Iterable[Float[np.ndarray, "n m 3"]], shape: tuple[int, int]
) -> Bool[np.ndarray, "ny nx"]:
    """Cells whose centre lies below (or above) more polygons that face up than polygons that face down."""
    windings = Windings(shape)
    for some in polygons:
        start, end = some[:, :, :2], np.roll(some[:, :, :2], -1, axis=1)
        windings.add(start.reshape(-1, 2), end.reshape(-1, 2))
    return windings.numbers() > 0


def _without_pockets(
    free: Bool[np.ndarray, "ny nx"], solid: Bool[np.ndarray, "ny nx"], resolution_m: float
) -> Bool[np.ndarray, "ny nx"]:
    """Free cells without the closed parts that lie inside solids by most of their cells.

    Where hardly anything would be left, the mesh is a shell of sheets, and the parts are its rooms.
    """
    part, n = ndimage.label(free)
    size = np.bincount(part[free], minlength=n + 1)
    pocket = np.bincount(part[free & solid], minlength=n + 1) > size / 2
    left = free & ~pocket[part]
    return left if np.count_nonzero(left) * resolution_m**2 > _LEFT_M2 else free


def _without_bodies(
    free: Bool[np.ndarray, "ny nx"],
    triangles: Triangles,
    places: Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, "n 3"]],
) -> Bool[np.ndarray, "ny nx"]:
    """Free cells without the closed parts that are in something that stands in another, such as a cupboard.

    Args:
        free: Free cells.
        triangles: Of the mesh [m].
        places: Tells where the middles of cells, by row and column, are in the slice [m].
    """
    part, n = ndimage.label(free)
    if n < 2:
        return free
    # The middle of a part is farthest from all that bounds it.
    depth = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    middle = places(np.array(ndimage.maximum_position(depth, part, np.arange(1, n + 1)), float))
    return free & ~np.append(False, in_bodies(triangles, middle))[part]
