"""Floor plans of generated buildings, from a seed.

Size and number of rooms of homes are drawn from distributions fitted to scanned ones, rooms are laid out and
furnished, the whole is turned by an angle and put on a grid. Places that no robot can enter are closed at the end,
so that the free space is connected, also for the centre of the robot's hull. Furniture is cells, or with
``heights=True`` meshes of true height (`FloorPlan.furnishings`), which leave the same passages.

The same seed and configuration give bit-identical plans. With ``navigable=True`` the same building
comes as the published grids of scanned homes do: free where an agent of 0.1 m radius may stand, with walls
through the outermost free cells. Left out: storeys, windows, what furniture looks like from above 0.2 m.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float

from robosim.generator.canvas import Canvas, Rect
from robosim.generator.furniture_cells import furnish, structure
from robosim.generator.layout import Layout, lay_out
from robosim.generator.place_groups import place_pieces
from robosim.generator.subdivision import STYLES
from robosim.generator.wings import AREA_M2, LARGE_STYLES
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan
from robosim.support.checks import SEED, Range, check_choice, check_number, checked

#: Radius of the agent that the published navigable areas were made for [m].
AGENT_RADIUS_M = 0.1
#: Rim of wall around the building; beyond it all is unknown [m].
OUTER_WALL_M = 0.25
#: Width that the raster may take from each side of a door [m].
RASTER_M = 0.06


_STYLES = {**STYLES, **LARGE_STYLES}


@dataclass(frozen=True, kw_only=True)
@checked
class GeneratorConfig:
    """Kind of a generated building. Values of None are drawn from the seed."""

    style: Literal["home", "office", "campus", "school", "hospital", "hall"] = "home"
    """Home, or office: larger, with a wide corridor and desks. Campus (offices), school, hospital and hall: 1,000 to
    5,000 m2 along several corridors."""
    area_m2: Annotated[float | None, Range(4, 5000, "m2")] = None
    """Floor area of all rooms together, before furniture [m2]."""
    rooms: Annotated[int | None, Range(1, 400)] = None
    """Number of rooms, corridors included; for homes and offices only: large buildings have as many as fit."""
    furniture: Annotated[float | None, Range(0, 5)] = None
    """Share of the usual furniture: 0 for an empty building, 1 for the usual, 2 for a crowded one."""
    rotation_deg: Annotated[float | None, Range(-360, 360, "degrees")] = None
    """Angle from the grid's x axis to the building's [deg]."""
    door_width_m: Annotated[tuple[float, float], Range(0, 2, "m")] = (0.7, 1.0)
    """Clear width of doors, narrowest and widest [m]."""
    hull_radius_m: Annotated[float, Range(0.02, 1, "m")] = 0.18
    """Radius of the robot that must get everywhere [m]."""
    resolution_m: Annotated[float, Range(0.01, 0.1, "m")] = 0.05
    """Side of a cell [m]."""
    heights: bool = False
    """Furniture is pieces of true height, which sensors, radio and robots pass over and under, rather than cells up to
    the ceiling. Rooms are the same ones as without."""
    navigable: bool = False
    """Free is where an agent of 0.1 m radius may stand, as in the published grids, rather than all floor."""

    def __post_init__(self) -> None:
        check_choice("style", self.style, _STYLES)
        if self.style in LARGE_STYLES:
            if self.area_m2 is not None:
                check_number(f"area_m2 of style {self.style}", self.area_m2, *AREA_M2, "m2")
            if self.rooms is not None:
                raise ValueError(
                    f"rooms is {self.rooms}, but style {self.style} has as many rooms as fit. Set area_m2 instead."
                )
        if self.heights and self.navigable:
            raise ValueError(
                "heights is True and navigable too, expected one of them: a navigable area is one for all heights."
            )
        narrowest, widest = self.door_width_m
        least = self.passage_m + 2 * RASTER_M
        if not least - 1e-9 <= narrowest <= widest:
            raise ValueError(
                f"door_width_m is {self.door_width_m}, expected a narrowest and a widest from {least:.2f} m "
                f"(for a hull of {self.hull_radius_m:g} m radius) to 2 m. Widen the doors, or take "
                "a smaller hull."
            )

    @property
    def passage_m(self) -> float:
        """Width that stays free for the hull, even where an agent's radius is taken off all walls."""
        return 2 * (self.hull_radius_m + AGENT_RADIUS_M) + 0.02


def generate_plan(seed: int, *, config: GeneratorConfig = GeneratorConfig()) -> FloorPlan:
    """Generate a building from a seed.

    Free cells of the plan are 4-connected, and so are the places of the hull's centre in it. Cells well outside of the
    building are unknown.
    """
    check_number("seed", seed, *SEED, whole=True)
    rng = np.random.default_rng(seed)
    area_m2, rooms, furniture, yaw = _draft(rng, config)
    style = _STYLES[config.style]
    layout = lay_out(rng, area_m2=area_m2, rooms=rooms, door_m=config.door_width_m, style=style)
    canvas = Canvas(layout.bounds(), yaw, config.resolution_m)
    _paint(canvas, layout)
    floor = canvas.free.copy()
    density, name = furniture * style.crowding, f"{config.style}-{seed}"
    if not config.heights:
        furnish(canvas, layout, rng, density=density, passage_m=config.passage_m)
        return _plan(canvas.free, floor, name, config)
    furnish(canvas, layout, rng, density=density, passage_m=config.passage_m, things=structure)
    plan = _plan(canvas.free, floor, name, config)
    placed = place_pieces(canvas, layout, rng, plan.free, density=density, passage_m=config.passage_m)
    return replace(plan, furnishings=tuple(placed))


def _draft(rng: np.random.Generator, config: GeneratorConfig) -> tuple[float, int, float, float]:
    """Area [m2], number of rooms, share of furniture, yaw [rad]; fixing one does not change the draws of the others."""
    size, room_size, crowd, turn, empty = (
        rng.random(),
        rng.standard_normal(),
        rng.random(),
        rng.random(),
        rng.random(),
    )
    if config.style in LARGE_STYLES:
        area_m2, typical_m2 = AREA_M2[0] * (AREA_M2[1] / AREA_M2[0]) ** size, 18.0
    elif config.style == "office":
        area_m2, typical_m2 = 120 + 280 * size, 18.0
    else:
        area_m2, typical_m2 = 76 * (-np.log1p(-np.clip(size, 0.01, 0.98))) ** (1 / 2.3), 12.0
    area_m2 = config.area_m2 or max(14.0, float(area_m2))
    typical_m2 *= (area_m2 / 70) ** 0.3
    rooms = config.rooms or max(1, round(area_m2 / (typical_m2 * np.exp(0.4 * room_size))))
    furniture = 0.2 * crowd if empty < 0.2 else 0.7 + 1.1 * crowd
    if config.furniture is not None:
        furniture = config.furniture
    yaw = 2 * np.pi * turn if config.rotation_deg is None else np.radians(config.rotation_deg)
    return area_m2, rooms, furniture, float(yaw)


def _paint(canvas: Canvas, layout: Layout) -> None:
    """Floor, bays and alcoves, slanted walls, and the holes of doors."""
    for room in layout.rooms:
        canvas.paint(room.floor.polygon(), free=True)
    for _, floor in layout.recesses:
        canvas.paint(floor, free=True)
    for _, wedge in layout.wedges:
        canvas.paint(wedge, free=False)
    # Cells belong to a polygon by their centres: at worst half a diagonal is lost on either side.
    rim = np.sqrt(0.5) * canvas.resolution_m
    for opening in layout.openings:
        x0, y0, x1, y1 = opening.hole
        dx, dy = (rim, 0.0) if opening.along_x else (0.0, rim)
        canvas.paint(Rect(x0 - dx, y0 - dy, x1 + dx, y1 + dy).polygon(), free=True)


def _plan(free: np.ndarray, floor: np.ndarray, name: str, config: GeneratorConfig) -> FloorPlan:
    """A connected plan of free cells (without walls and furniture) and floor (without walls)."""
    if config.navigable:
        from_wall_m = config.resolution_m * (_distance(free) - 0.5)
        plan = FloorPlan(
            occupancy=np.where(from_wall_m >= AGENT_RADIUS_M, FREE, OCCUPIED).astype(np.uint8),
            resolution_m=config.resolution_m,
            name=name,
            wall_line="cell_centre",
            eroded_m=AGENT_RADIUS_M,
        )
    else:
        near = _distance(~floor) * config.resolution_m <= OUTER_WALL_M
        plan = FloorPlan(
            occupancy=np.where(free, FREE, np.where(near, OCCUPIED, UNKNOWN)).astype(np.uint8),
            resolution_m=config.resolution_m,
            name=name,
        )
    return in_one_piece(plan, config.hull_radius_m)


def _distance(mask: np.ndarray) -> np.ndarray:
    """Distance [cells] from each cell of a mask to the nearest one outside of it, between centres; 0 for others."""
    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def in_one_piece(plan: FloorPlan, hull_radius_m: float) -> FloorPlan:
    """Close places that a hull cannot reach from the largest piece of a plan; ValueError if it fits nowhere.

    Narrow places in which no hull fits stay open if they are connected to the rest.
    """
    occupancy = plan.occupancy.copy()
    while True:
        plan = replace(plan, occupancy=occupancy.copy())
        places = hull_places(plan, hull_radius_m)
        main = largest_piece(places)
        pockets = places & ~main
        _, pieces = cv2.connectedComponents(plan.free.astype(np.uint8), connectivity=4)
        lost = plan.free & (pieces != pieces[main][0])
        if pockets.any():
            radius = hull_radius_m / plan.resolution_m
            lost |= plan.free & (_distance(~pockets) <= radius) & (_distance(~main) > radius)
            lost |= pockets
        if not lost.any():
            return plan
        occupancy[lost] = OCCUPIED


def hull_places(plan: FloorPlan, hull_radius_m: float) -> Bool[np.ndarray, "ny nx"]:
    """Cells at whose centre the centre of a round hull can be; ValueError if there are none."""
    fits = plan.free & (distance_m(plan)[1::2, 1::2] >= hull_radius_m - 1e-6)
    if not fits.any():
        raise ValueError(
            f"hull_radius_m = {hull_radius_m:g}, expected a hull that fits somewhere in plan '{plan.name}'. "
            "Take a smaller one, or check the plan's resolution."
        )
    return fits


def largest_piece(mask: Bool[np.ndarray, "ny nx"]) -> Bool[np.ndarray, "ny nx"]:
    """The largest 4-connected piece of a mask that is not empty."""
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    return pieces == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))


def distance_m(plan: FloorPlan) -> Float[np.ndarray, "h w"]:
    """Distance [m] to walls on the lattice of half cells (2 ny + 1, 2 nx + 1); 0 outside of them."""
    interior = np.pad(_interior(plan), 1)
    half_cells = cv2.distanceTransform(interior, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    return half_cells.astype(float) * (plan.resolution_m / 2)


def _interior(plan: FloorPlan) -> np.ndarray:
    """Lattice of half cells, (2 ny + 1, 2 nx + 1) with cell centres at odd indices: 1 strictly inside."""
    ny, nx = plan.shape
    lattice = np.zeros((2 * ny + 1, 2 * nx + 1), np.uint8)
    if plan.wall_line == "cell_centre":
        outlines, _ = cv2.findContours(plan.free.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
        on_lattice = [2 * outline + 1 for outline in outlines]
        cv2.fillPoly(lattice, on_lattice, 1)
        cv2.polylines(lattice, on_lattice, True, 0)
        return lattice
    lattice[1::2, 1::2] = ~plan.free
    lattice = 1 - np.asarray(cv2.dilate(lattice, np.ones((3, 3), np.uint8)), np.uint8)
    lattice[[0, -1]] = 0
    lattice[:, [0, -1]] = 0
    return lattice
