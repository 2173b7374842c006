"""Receivers on a regular grid over the free space of a floor plan, and transmitters at random places in it.

On most plans the grid starts half a step from the plan's lower-left corner, turned with the plan, and a receiver exists
where its point lies in free space. In the published radio data of mmwRobotNav a receiver stands for a block of 3 x 3
cells of 0.05 m, counted from the top left. It exists where the middle cell of its block is navigable, and its y is one
cell lower than that cell's centre: such a plan with such a step gets exactly those receivers, so that results compare
link by link. A few of them are on a wall or beyond it.
"""

import numpy as np
import shapely
from jaxtyping import Float, Int

from robosim.building.building import Building
from robosim.plans.floorplan import UNKNOWN, FloorPlan, MapError
from robosim.plans.outside import lie_outside
from robosim.support.checks import Range, check_number
from wireless.coverage import CellState
from wireless.coverage import ReceiverGrid as ReceiverGrid
from wireless.tracing.coverage import check_count

#: Cells across a block of the published grids.
BLOCK = 3
#: A receiver is at least this far from a wall [m], on plans that are free to choose.
CLEARANCE_M = 1e-3
#: Transmitters are at least this far from walls [m], where there is room.
TX_CLEARANCE_M = 0.1
#: Steps between receivers.
STEP_M = Range(0.01, 100, "m between receivers", "Try 0.15.")


def receiver_grid(building: Building, step_m: float, height_m: float) -> ReceiverGrid:
    """Receivers in free space, row by row from the bottom; ValueError if step or height do not fit the building."""
    plan = building.plan
    width, height = plan.shape[1] * plan.resolution_m, plan.shape[0] * plan.resolution_m
    check_step(step_m)
    check_count(width * height / step_m**2, step_m, width, height)
    check_height(building, height_m, "height")
    if plan.wall_line == "cell_centre" and abs(step_m - BLOCK * plan.resolution_m) < 1e-9:
        grid = _published(plan, height_m)
    else:
        grid = regular_grid(building, step_m, height_m)
    if not len(grid.position):
        raise ValueError(f"grid is {step_m:g} m, and no receiver fits into {plan.name}; take a finer one.")
    return grid


def check_step(step_m: float) -> None:
    """Raise ValueError if a step between receivers makes no grid, or one of too many cells on each square metre."""
    if 0 < step_m < STEP_M.least:
        raise ValueError(
            f"grid is {step_m:g}, expected {STEP_M.least:g} to {STEP_M.greatest:g} m between receivers: it makes "
            f"{1 / step_m**2:.0f} cells on each square metre. Try 0.15."
        )
    check_number("grid", step_m, *STEP_M)


def check_height(building: Building, height_m: float, name: str) -> None:
    """Raise ValueError if a height is not between floor and ceiling."""
    if not 0 <= height_m <= building.height_m:
        raise ValueError(
            f"{name} is {height_m} m, expected 0 to {building.height_m:g} m, between floor and ceiling."
        )


def _published(plan: FloorPlan, height_m: float) -> ReceiverGrid:
    """The grid of the published data."""
    shape = plan.shape[0] // BLOCK, plan.shape[1] // BLOCK
    left_over = plan.shape[0] - BLOCK * shape[0]  # blocks count from the top
    middle = plan.free[left_over + 1 :: BLOCK, 1::BLOCK][: shape[0], : shape[1]]
    return _grid(plan, np.argwhere(middle), shape, BLOCK, np.array([0.0, left_over - 1]), height_m)


def regular_grid(building: Building, step_m: float, height_m: float) -> ReceiverGrid:
    """A grid of all free points of the building, half a step from the plan's lower-left corner, whatever its format."""
    plan = building.plan
    step = step_m / plan.resolution_m
    ny, nx = (max(1, int(np.floor(n / step + 1e-9))) for n in plan.shape)
    everywhere = np.argwhere(np.ones((ny, nx), bool))
    grid = _grid(plan, everywhere, (ny, nx), step, np.zeros(2), height_m)
    room = building.free_at(height_m).buffer(-CLEARANCE_M)
    shapely.prepare(room)
    inside = shapely.contains_xy(room, grid.position[:, :2])
    inside &= ~lie_outside(plan, grid.position[:, :2])
    return _grid(plan, everywhere[inside], (ny, nx), step, np.zeros(2), height_m)


def _grid(
    plan: FloorPlan,
    cell: Int[np.ndarray, "n 2"],
    shape: tuple[int, int],
    step: float,
    start: Float[np.ndarray, "2"],
    height_m: float,
) -> ReceiverGrid:
    """Receivers at some places of a grid whose lower-left corner and step are given in cells of the plan."""
    everywhere = np.argwhere(np.ones(shape, bool))
    middle = step * (everywhere[:, ::-1] + 0.5) + start
    column, row = np.clip(np.floor(middle).astype(int), 0, np.array(plan.shape[::-1]) - 1).T
    is_outside = (plan.occupancy[row, column] == UNKNOWN) | lie_outside(plan, plan.to_map(middle))
    unreached = np.where(is_outside, np.uint8(CellState.OUTSIDE), np.uint8(CellState.IN_BODY)).reshape(shape)
    unreached[tuple(cell.T)] = CellState.NO_PATH
    at = plan.to_map(step * (cell[:, ::-1] + 0.5) + start)
    corner = np.stack(np.meshgrid(np.arange(shape[1] + 1), np.arange(shape[0] + 1)), axis=-1)
    return ReceiverGrid(
        # Rounded to picometres: a grid of 0.15 m holds 0.3, not 0.30000000000000004.
        position=np.column_stack([np.round(at, 12), np.full(len(at), height_m)]),
        cell=cell,
        shape=shape,
        edges=plan.to_map(step * corner + start),
        unreached=unreached,
    )


def random_transmitters(
    building: Building, count: int, height_m: float, rng: np.random.Generator
) -> Float[np.ndarray, "count 3"]:
    """Places drawn evenly over free space at a height within the building [m], rounded to millimetres.

    More of them begin with the same ones. MapError if there is no free space.
    """
    free = building.free_at(height_m)
    room = free.buffer(-TX_CLEARANCE_M)
    room = free if room.is_empty else room
    if room.is_empty:
        raise MapError(f"{building.plan.name}: no free space for a transmitter.")
    shapely.prepare(room)
    low, high = np.reshape(room.bounds, (2, 2))
    places: list[list[float]] = []
    while len(places) < count:
        x, y = np.round(rng.uniform(low, high), 3)
        if shapely.contains_xy(room, x, y) and not lie_outside(building.plan, np.array([[x, y]])):
            places.append([float(x), float(y), height_m])
    return np.array(places)
