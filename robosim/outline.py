"""Where free space ends: the walls of a floor plan, as lines.

``"cell_edge"`` plans have a wall on every edge between a free cell and another one. Going along such edges
with the free cell on the left gives closed rings, counter-clockwise around free space and clockwise around
holes. Where two free cells touch by a corner only, no way leads through: there the line turns so that
different components stay apart and that every ring is simple, as the OGC rules for polygons ask.

``"cell_centre"`` plans have their walls through the centres of the outermost free cells, on the borders that
`cv2.findContours` follows (Suzuki and Abe 1985; free space 8-connected). A passage one cell wide then has
its two walls on one line: it is closed, has no area and is missing in `free_polygons`, but `wall_lines` has
both its walls, since a traced radio path knows them.

A tolerance above zero straightens staircases by the Douglas-Peucker rule, never moving a wall by more than
the tolerance and never letting walls cross. Left out: walls with a thickness.
"""

from collections.abc import Iterable

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from robosim.floorplan import FloorPlan, MapError

#: Steps east, north, west and south between corners of cells, as (ix, iy).
STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


def free_polygons(plan: FloorPlan, tolerance_m: float = 0.0) -> shapely.MultiPolygon:
    """Free space of a plan as polygons [m] in `map`, one for each room that no free way leads out of.

    The polygons are valid, share at most single points, and have their vertices only where walls turn.

    Args:
        plan: Where the free cells are, and where walls stand between them and the others. Outside of the
            array nothing is free.
        tolerance_m: How far a wall may be moved to save corners. 0 keeps each one. About one cell turns
            staircases into slanted walls; zero-width passages are never kept.

    Raises:
        ValueError: If the tolerance is negative or not finite.
        MapError: If nothing is left, because all passages are one cell wide and walls go through centres.
    """
    check_tolerance(tolerance_m)
    free = _edge_polygons(plan.free) if plan.wall_line == "cell_edge" else _centre_polygons(plan.free)
    if free.is_empty:
        raise MapError(
            f"{plan.name}: free cells form lines one cell wide only, and walls through their centres leave no "
            'space between them. Use wall_line="cell_edge", or a finer plan.'
        )
    if tolerance_m > 0:
        free = simplified(free, tolerance_m / plan.resolution_m)
    return shapely.transform(free, plan.to_map)


def wall_lines(plan: FloorPlan, tolerance_m: float = 0.0) -> list[Float[np.ndarray, "_ 2"]]:
    """Walls of a plan as closed lines [m] in `map`; the last point repeats the first.

    With walls through cell centres and no tolerance these are the lines of
    ``cv2.findContours(free, RETR_CCOMP, CHAIN_APPROX_SIMPLE)`` as they come: a passage one cell wide is
    walked forth and back, so that rings may touch themselves, and the direction of a ring means nothing.
    Free cells all alone have no line. Otherwise they are the boundaries of `free_polygons`, with free space
    on the left.

    Args:
        plan: Where the free cells are.
        tolerance_m: How far a wall may be moved to save corners; above 0, zero-width passages are dropped.

    Raises:
        ValueError: If the tolerance is negative or not finite.
        MapError: If there is no free area.
    """
    check_tolerance(tolerance_m)
    if plan.wall_line == "cell_centre" and tolerance_m == 0:
        rings = [ring for ring, _ in _contours(plan.free) if len(ring) > 2]
        return [plan.to_map(ring) for ring in rings]
    free = shapely.get_rings(shapely.get_parts(free_polygons(plan, tolerance_m)))
    return [shapely.get_coordinates(ring) for ring in free]


def simplified(free: shapely.MultiPolygon, tolerance: float) -> shapely.MultiPolygon:
    """Polygons with fewer corners, each wall within `tolerance` of where it was, and the same topology.

    Raises:
        RuntimeError: If no valid simplification was found, which means a fault of the geometry library.
    """
    simple = shapely.simplify(free, tolerance, preserve_topology=True)
    if not shapely.is_valid(simple):
        raise RuntimeError(
            f"simplifying the outline by {tolerance} gave an invalid polygon "
            f"({shapely.is_valid_reason(simple)}). Use a smaller tolerance."
        )
    return _multi(shapely.get_parts(simple))


def check_tolerance(tolerance_m: float) -> None:
    """Complain of a tolerance that is negative or not finite."""
    if not (np.isfinite(tolerance_m) and tolerance_m >= 0):
        raise ValueError(
            f"tolerance_m is {tolerance_m}, expected a finite number of metres >= 0. Use 0 for the exact "
            "outline, about one cell to straighten staircases."
        )


def _edge_polygons(free: Bool[np.ndarray, "ny nx"]) -> shapely.MultiPolygon:
    """Polygons around the 4-connected components of the free cells, in cell coordinates."""
    cells = np.pad(free, 1)
    _, label = cv2.connectedComponents(cells.astype(np.uint8), connectivity=4)
    rings, component = _trace(cells, label)
    parts: dict[int, tuple[list, list]] = {}
    for ring, number in zip(rings, component, strict=True):
        around, holes = parts.setdefault(number, ([], []))
        (around if _signed_area(ring) > 0 else holes).append(ring - 1.0)
    return _multi([shapely.Polygon(around[0], holes) for around, holes in parts.values()])


def _trace(
    cells: Bool[np.ndarray, "ny nx"], label: Int[np.ndarray, "ny nx"]
) -> tuple[list[Int[np.ndarray, "_ 2"]], list[int]]:
    """Corners (ix, iy) of the closed lines around free cells, and the component each belongs to.

    Args:
        cells: Free cells; the border of the array must not be free.
        label: Number of the 4-connected component of each cell.
    """
    nx = cells.shape[1]
    # The cell (iy, ix) lies north-east of the corner (ix, iy); its neighbours are one row or column down.
    north_east = cells[1:, 1:]
    north_west, south_east, south_west = cells[1:, :-1], cells[:-1, 1:], cells[:-1, :-1]
    leaving = np.stack(  # does an edge with free space on its left leave the corner in this direction?
        [
            north_east & ~south_east,
            north_west & ~north_east,
            south_west & ~north_west,
            south_east & ~south_west,
        ],
        axis=-1,
    )
    edges = np.flatnonzero(leaving)  # corner * 4 + direction
    corner, way = np.divmod(edges, 4)
    step = STEPS[:, 0] + STEPS[:, 1] * (nx - 1)
    reached = corner + step[way]
    leaving = leaving.reshape(-1, 4)
    left, right = (way + 1) % 4, (way + 3) % 4
    goes_left, goes_right = leaving[reached, left], leaving[reached, right]
    # Both: two free cells touch by this corner. Of one component, the line goes over to the other cell.
    label_at = [label[1:, 1:], label[1:, :-1], label[:-1, :-1], label[:-1, 1:]]
    around = np.stack(label_at, axis=-1).reshape(-1, 4)[reached]
    highest = np.sort(around, axis=1)[:, 2:]
    go_right = goes_right & (~goes_left | (highest[:, 0] == highest[:, 1]))
    turn = np.where(go_right, right, np.where(goes_left, left, way))
    following = np.searchsorted(edges, reached * 4 + turn)

    lines = _cycles(following.tolist())
    inside = np.stack(label_at, axis=-1).reshape(-1, 4)[corner, way]  # the free cell on the left of the edge
    is_corner = np.empty(len(edges), bool)
    is_corner[following] = turn != way
    points = np.column_stack([corner % (nx - 1) + 1, corner // (nx - 1) + 1])
    rings = [line[is_corner[line]] for line in lines]
    return [points[ring] for ring in rings], [int(inside[line[0]]) for line in lines]


def _cycles(following: list[int]) -> list[Int[np.ndarray, "_"]]:
    """Cycles of a permutation, each from its lowest element on."""
    seen = bytearray(len(following))
    cycles = []
    for start in range(len(following)):
        if seen[start]:
            continue
        cycle, at = [], start
        while not seen[at]:
            seen[at] = 1
            cycle.append(at)
            at = following[at]
        cycles.append(np.array(cycle))
    return cycles


def _signed_area(ring: Int[np.ndarray, "n 2"]) -> float:
    """Area inside of a closed line of corners, negative when it runs clockwise."""
    x, y = ring.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2


def _contours(free: Bool[np.ndarray, "ny nx"]) -> list[tuple[Float[np.ndarray, "_ 2"], int]]:
    """Closed lines through the centres of the outermost free cells, and for a hole the number of its outside.

    The number is -1 for an outer line.
    """
    padded = np.pad(free, 1).astype(np.uint8)
    lines, hierarchy = cv2.findContours(padded, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    parents = hierarchy.reshape(-1, 4)[:, 3]
    rings = [line.reshape(-1, 2) - 0.5 for line in lines]  # cell (0, 0), now at (1, 1), has its centre at 0.5
    return [(np.vstack([ring, ring[:1]]), int(parent)) for ring, parent in zip(rings, parents, strict=True)]


def _centre_polygons(free: Bool[np.ndarray, "ny nx"]) -> shapely.MultiPolygon:
    """The areas between the lines through the outermost free cells, in cell coordinates.

    Vertices lie on a lattice and no lines cross, so that the overlay below is exact.
    """
    contours = [(ring, parent) for ring, parent in _contours(free)]
    holes: dict[int, list] = {}
    for ring, parent in contours:
        if parent >= 0:
            holes.setdefault(parent, []).append(ring)
    parts = []
    for number, (ring, parent) in enumerate(contours):
        if parent < 0 and len(ring) > 3:
            polygon = shapely.Polygon(ring, holes.get(number))
            valid = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
            parts.extend(p for p in shapely.get_parts(valid) if p.geom_type == "Polygon" and p.area > 0)
    return _multi(parts)


def _multi(polygons: Iterable[shapely.Polygon]) -> shapely.MultiPolygon:
    """The polygons together, with free space on the left of each ring."""
    return shapely.MultiPolygon(list(shapely.orient_polygons(list(polygons))))
