"""Free space of a floor plan as polygons, whose boundary is its walls.

``"cell_edge"`` plans have a wall on every edge between a free cell and another one. Going along such edges
with the free cell on the left gives closed rings, counter-clockwise around free space and clockwise around
holes. Two free cells that touch by a corner only are not connected: there the line turns so that
different components stay apart and that every ring is simple, as the OGC rules for polygons require. A slanted wall one
cell thick, as many ROS maps and drawn lines have it, would fall apart into posts by that rule: before it is
straightened, its outline passes those corners twice. From one of its steps to the next both sides are equally long
and turn once, the one to the left, the other to the right. Several such pieces in a row, all leading into the same
quadrant or back, are a wall. Fewer are furniture and noise, whose corners touch by chance.

``"cell_centre"`` plans have their walls through the centres of the outermost free cells, on the borders that
`cv2.findContours` follows (Suzuki and Abe 1985; free space 8-connected). A passage one cell wide then has
its two walls on one line: it is closed, has no area and is missing in `free_cells`, but `closed_passages` has
and its walls, which block radio paths.

By default staircases of ``"cell_edge"`` plans become straight walls (`robosim.building.straight`); walls through
centres stay as they are, as what was published with them was made with each of their steps. A tolerance of zero
keeps each corner. One above zero straightens staircases by the Douglas-Peucker rule, never moving a wall by more than
the tolerance and never letting walls cross. Left out: walls with a thickness.
"""

from itertools import pairwise

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from robosim.building.extrusion import polygons_of, rings_of, together
from robosim.building.straight import straightened
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.support.checks import Range, check_number

#: How far walls may be moved to save corners.
TOLERANCE_M = Range(0, 0.5, "m", "Leave it out for straight walls under staircases; 0 is the exact outline.")
#: Least number of pieces between steps, or of edges of cells along one side, of a slanted wall one cell thick.
_PIECES, _EDGES = 4, 24
#: Steps east, north, west and south between corners of cells, as (ix, iy).
STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


def free_cells(plan: FloorPlan, tolerance_m: float | None = None) -> shapely.MultiPolygon:
    """Free space of a plan as polygons in cell coordinates (column, row), one for each connected part.

    The polygons are valid and share at most single points. Vertices lie where walls turn or meet, along the grid on
    whole or half coordinates. Outside of the array nothing is free.

    Args:
        plan: The free cells, and the position of walls between them and the others.
        tolerance_m: Largest distance that a wall may be moved to save corners [m]; None for straight walls under
            staircases. 0 keeps each corner. One cell takes most steps out of slanted walls, 1.4 cells all, since the
            corners of steps lie in a band that wide.

    Raises:
        MapError: If nothing is left, because all passages are one cell wide and walls go through centres.
    """
    check_tolerance(tolerance_m)
    if plan.wall_line == "cell_edge" and tolerance_m is None:
        straight = straightened(*_rings_and_thin_walls(plan.free))
        return straight or _edge_polygons(plan.free)
    free = _edge_polygons(plan.free) if plan.wall_line == "cell_edge" else _centre_polygons(plan.free)
    if free.is_empty:
        raise MapError(
            f"{plan.name}: free cells form lines one cell wide only, and walls through their centres leave "
            'no space between them. Use wall_line="cell_edge", or a finer plan.'
        )
    return simplified(free, tolerance_m / plan.resolution_m) if tolerance_m else free


def closed_passages(plan: FloorPlan) -> Float[np.ndarray, "n 2 2"]:
    """Ends (column, row), in cell coordinates, of the walls in passages too narrow for `free_cells`.

    The two walls of such a passage stand on each of these segments. Only plans with walls through cell centres have
    any.
    """
    if plan.wall_line == "cell_edge":
        return np.empty((0, 2, 2))
    lines = shapely.MultiLineString([ring for ring, _ in _contours(plan.free) if len(ring) > 2])
    left = shapely.line_merge(lines.difference(_centre_polygons(plan.free).boundary))
    pieces = [shapely.get_coordinates(piece) for piece in shapely.get_parts(left)]
    return np.concatenate([np.empty((0, 2, 2)), *(np.stack([p[:-1], p[1:]], axis=1) for p in pieces)])


def to_map_exactly(plan: FloorPlan, cells: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """`plan.to_map`, with equal results for equal points, which matrix products do not guarantee."""
    distinct, inverse = np.unique(cells[:, 0] + 1j * cells[:, 1], return_inverse=True)
    return plan.to_map(np.column_stack([distinct.real, distinct.imag]))[inverse]


def simplified(free: shapely.MultiPolygon, tolerance: float) -> shapely.MultiPolygon:
    """Polygons with fewer corners, each wall within `tolerance` of where it was, in their units, and the same topology.

    Three far corners of each ring stay, so that no ring collapses; the walls between them are simplified all
    at once by GEOS' topology-preserving Douglas-Peucker, which looks at crossings between all of them.
    (From closed rings GEOS would also remove the corner they start at, and move walls by up to twice the
    tolerance.) Where walls lie closer to each other than the tolerance, less is simplified.
    """
    rings, owner = rings_of(free)
    walls = shapely.MultiLineString([third for ring in rings for third in _thirds(ring)])
    # A new wall may step over a small ring that it does not touch; then a smaller tolerance will not.
    for attempt in tolerance / 2.0 ** np.arange(8):
        thirds = shapely.get_parts(shapely.simplify(walls, attempt, preserve_topology=True))
        points, third = shapely.get_coordinates(thirds, return_index=True)
        new = np.append(third[1:] == third[:-1], False)  # the last of a third is the first of the next one
        shorter = shapely.linearrings(points[new], indices=third[new] // 3)
        simple = together(shapely.polygons(shorter, indices=owner))
        if shapely.is_valid(simple):
            return simple
    return free


def _thirds(ring: shapely.LinearRing) -> list[Float[np.ndarray, "_ 2"]]:
    """A closed line in three pieces that meet at corners far apart and not on one line."""
    points = shapely.get_coordinates(ring)[:-1]
    first = points[np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1))]
    chord = points - first
    reach = np.linalg.norm(chord, axis=1)
    second = chord[np.argmax(reach)]
    off_line = np.abs(chord @ (-second[1], second[0]))
    cuts = np.sort([np.argmin(reach), np.argmax(reach), np.argmax(off_line)])
    turned = np.roll(points, -cuts[0], axis=0)
    turned = np.vstack([turned, turned[:1]])
    ends = [*(cuts - cuts[0]), len(points)]
    return [turned[start : end + 1] for start, end in pairwise(ends)]


def check_tolerance(tolerance_m: float | None) -> None:
    """Raise ValueError for a tolerance that is negative or larger than walls are thick."""
    if tolerance_m is not None:
        check_number("tolerance_m", tolerance_m, *TOLERANCE_M)


def _edge_polygons(free: Bool[np.ndarray, "ny nx"]) -> shapely.MultiPolygon:
    """Polygons around the 4-connected components of the free cells, in cell coordinates."""
    return polygons_of(*_edge_rings(free, np.zeros((free.shape[0] + 1, free.shape[1] + 1), bool)))


def _rings_and_thin_walls(
    free: Bool[np.ndarray, "ny nx"],
) -> tuple[list[Int[np.ndarray, "_ 2"]], Int[np.ndarray, " n"], Int[np.ndarray, "m 2"]]:
    """Closed lines around the free cells, as `straightened` takes them."""
    corners = (free.shape[0] + 1, free.shape[1] + 1)
    thin = thin_wall_corners(_edge_rings(free, np.ones(corners, bool))[0])
    joined = np.zeros(corners, bool)
    joined[thin[:, 1], thin[:, 0]] = True
    return *_edge_rings(free, joined), thin


def _edge_rings(
    free: Bool[np.ndarray, "ny nx"], joined: Bool[np.ndarray, "ny1 nx1"]
) -> tuple[list[Int[np.ndarray, "_ 2"]], Int[np.ndarray, " n"]]:
    """Closed lines around 4-connected cells, through `joined` corners twice, and their components as in `rings_of`."""
    cells = np.pad(free, 1)
    _, label = cv2.connectedComponents(cells.astype(np.uint8), connectivity=4)
    parts: dict[int, list[np.ndarray]] = {}
    for ring, component in _trace(cells, label, joined.ravel()):
        of_part = parts.setdefault(component, [])
        # The outer line, which alone runs counter-clockwise, comes first.
        of_part.insert(0 if _signed_area(ring) > 0 else len(of_part), ring - 1)
    owner = np.repeat(np.arange(len(parts)), [len(rings) for rings in parts.values()])
    return [ring for rings in parts.values() for ring in rings], owner


def _trace(
    cells: Bool[np.ndarray, "ny nx"], label: Int[np.ndarray, "ny nx"], joined: Bool[np.ndarray, " n"]
) -> list[tuple[Int[np.ndarray, "_ 2"], int]]:
    """Corners (ix, iy) of the lines around free cells, none at the border, and each one's component as in `label`."""
    # Cells north-east, north-west, south-west and south-east of each inner corner: counter-clockwise.
    is_free = np.stack([cells[1:, 1:], cells[1:, :-1], cells[:-1, :-1], cells[:-1, 1:]], axis=-1).reshape(
        -1, 4
    )
    # East, north, ...: free cell on the left, none on the right.
    leaves = is_free & ~np.roll(is_free, 1, axis=1)
    edges = np.flatnonzero(leaves)  # corner * 4 + direction
    corner, heading = np.divmod(edges, 4)
    width = cells.shape[1] - 1
    reached = corner + (STEPS @ (1, width))[heading]

    def component(corner: Int[np.ndarray, " n"], side: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        row, column = np.divmod(corner, width)
        return label[row + (side < 2), column + (side % 3 == 0)]

    left, right = (heading + 1) % 4, (heading + 3) % 4
    goes_left, goes_right = leaves[reached, left], leaves[reached, right]
    # If both are possible, two free cells touch by this corner. The line goes over to the other one if they are
    # connected by other cells, which makes a simple ring; else it stays with the cell that it came along.
    here, other = component(reached, left), component(reached, right)
    goes_over = goes_right & (~goes_left | ((here == other) & ~joined[reached]))
    turn = np.where(goes_over, right, np.where(goes_left, left, heading))
    following = np.searchsorted(edges, reached * 4 + turn)

    turns = np.empty(len(edges), bool)
    turns[following] = turn != heading
    points = np.column_stack([corner % width, corner // width]) + 1
    label_of_edge = component(corner, heading)
    lines = _cycles(following.tolist())
    return [(points[line[turns[line]]], int(label_of_edge[line[0]])) for line in lines]


def _cycles(following: list[int]) -> list[Int[np.ndarray, " _"]]:
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
    """Closed lines through the centres of the outermost free cells; for a hole the number of its outside, else -1."""
    padded = np.pad(free, 1).astype(np.uint8)
    lines, hierarchy = cv2.findContours(padded, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    parents = hierarchy.reshape(-1, 4)[:, 3]
    rings = [line.reshape(-1, 2) - 0.5 for line in lines]  # cell (0, 0), now at (1, 1), has its centre at 0.5
    return [(np.vstack([ring, ring[:1]]), int(parent)) for ring, parent in zip(rings, parents, strict=True)]


def _centre_polygons(free: Bool[np.ndarray, "ny nx"]) -> shapely.MultiPolygon:
    """Areas between the lines through the outermost free cells [cells]; on a lattice, so that overlays are exact."""
    contours = _contours(free)
    holes: dict[int, list[np.ndarray]] = {}
    for ring, parent in contours:
        if parent >= 0:
            holes.setdefault(parent, []).append(ring)
    parts: list[shapely.Polygon] = []
    for number, (ring, parent) in enumerate(contours):
        if parent < 0 and len(ring) > 3:
            polygon = shapely.Polygon(ring, holes.get(number))
            valid = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
            parts.extend(p for p in shapely.get_parts(valid) if p.geom_type == "Polygon" and p.area > 0)
    return together(parts)


def thin_wall_corners(outlines: list[Int[np.ndarray, "_ 2"]]) -> Int[np.ndarray, "m 2"]:
    """Corners at which the two sides of slanted walls one cell thick touch; outlines pass these corners twice."""
    corners = np.concatenate(outlines)
    _, place, count = np.unique(corners @ (1, 1j), return_inverse=True, return_counts=True)
    starts, ends, steps = [], [], []
    first = 0
    for outline in outlines:
        at = first + np.flatnonzero(count[place[first : first + len(outline)]] > 1)
        # Touching corners in a row with one turn between them.
        after = np.roll(at, -1)
        near = (after - at) % len(outline) == 2
        at, after = at[near], after[near]
        starts.append(place[at])
        ends.append(place[after])
        steps.append(corners[after] - corners[at])
        first += len(outline)
    start, end, step = np.concatenate(starts), np.concatenate(ends), np.concatenate(steps)
    # The other side goes back from the end of a piece to its start.
    both = np.isin(start * len(count) + end, end * len(count) + start)
    is_thin = np.zeros(len(count), bool)
    for rising in (True, False):
        aligned = both & ((step[:, 0] * step[:, 1] > 0) == rising)
        links = coo_array((np.ones(aligned.sum()), (start[aligned], end[aligned])), shape=(len(count),) * 2)
        _, wall = connected_components(links, directed=False)
        pieces = np.bincount(wall[start[aligned]], minlength=len(count)) / 2
        edges = np.bincount(wall[start[aligned]], np.abs(step[aligned]).sum(axis=1), len(count)) / 2
        long = (pieces >= _PIECES) | (edges >= _EDGES)
        is_thin |= long[wall] & np.isin(np.arange(len(count)), start[aligned])
    return np.unique(corners[is_thin[place]], axis=0)
