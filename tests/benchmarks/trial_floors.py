"""Floors with little to match, and plans turned against their grid: what homes along the axes do not show.

A corridor gives no position along it, a hall is larger than a depth camera's range, pillars look alike, and a
ring has to close. Walls askew on the grid are staircases of cells.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.plans.floorplan import FREE, OCCUPIED, UNKNOWN, FloorPlan

#: Side of a cell [m].
_CELL_M = 0.05
#: Wall around the floor [m].
_WALL_M = 0.25


def turned(plan: FloorPlan, degrees: float) -> FloorPlan:
    """A plan turned counterclockwise against its grid.

    Cells take what lies at their centre; what is new is unknown.

    Args:
        plan: Any plan; its origin is left where it was.
        degrees: By how much. With 0 the plan is returned unchanged.
    """
    if degrees % 360 == 0:
        return plan
    rows, columns = plan.shape
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    wide = math.ceil(abs(columns * c) + abs(rows * s)) + 2
    high = math.ceil(abs(columns * s) + abs(rows * c)) + 2
    # Pixel centres have whole coordinates. Rows grow with y here, so this turns counterclockwise.
    turn = np.array([[c, -s], [s, c]])
    middle, new_middle = np.array([columns - 1, rows - 1]) / 2, np.array([wide - 1, high - 1]) / 2
    matrix = np.column_stack([turn, new_middle - turn @ middle])

    def warped(grid: UInt8[np.ndarray, "ny nx"], beyond: int) -> UInt8[np.ndarray, "my mx"]:
        """The grid turned, with a value for what is new."""
        return cv2.warpAffine(
            grid,
            matrix,
            (wide, high),
            flags=cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=beyond,
        )

    return replace(
        plan,
        occupancy=warped(plan.occupancy, UNKNOWN),
        material=None if plan.material is None else warped(plan.material, 0),
        name=f"{plan.name}@{degrees:g}",
    )


def _walled(free: Bool[np.ndarray, "ny nx"], name: str) -> FloorPlan:
    """A floor with a wall around it."""
    rim = round(_WALL_M / _CELL_M)
    cells = np.where(np.pad(free, rim), FREE, OCCUPIED).astype(np.uint8)
    return FloorPlan(occupancy=cells, resolution_m=_CELL_M, name=name)


def _floor(wide_m: float, high_m: float) -> Bool[np.ndarray, "ny nx"]:
    return np.ones((round(high_m / _CELL_M), round(wide_m / _CELL_M)), bool)


def _block(
    free: Bool[np.ndarray, "ny nx"], left_m: float, low_m: float, wide_m: float, high_m: float
) -> None:
    """Put something solid on a floor."""
    x, y, w, h = (round(value / _CELL_M) for value in (left_m, low_m, wide_m, high_m))
    free[y : y + h, x : x + w] = False


def hall() -> FloorPlan:
    """An empty hall of 30 x 20 m."""
    return _walled(_floor(30, 20), "hall")


def pillars() -> FloorPlan:
    """The same hall with 15 square pillars of 0.5 m, 5 m apart."""
    free = _floor(30, 20)
    for x in range(5, 30, 5):
        for y in (5, 10, 15):
            _block(free, x - 0.25, y - 0.25, 0.5, 0.5)
    return _walled(free, "pillars")


def corridor() -> FloorPlan:
    """A straight corridor of 200 x 2.4 m."""
    return _walled(_floor(200, 2.4), "corridor")


def ring() -> FloorPlan:
    """A corridor of 2.4 m around a block, 30 x 20 m from wall to wall."""
    free = _floor(30, 20)
    _block(free, 2.4, 2.4, 30 - 4.8, 20 - 4.8)
    return _walled(free, "ring")


def _large(seed: int) -> FloorPlan:
    plan = generate_plan(seed, config=GeneratorConfig(style="office", area_m2=1200, rotation_deg=0))
    return replace(plan, name=f"large-{seed}")


#: Makers of the floors, by name.
TRIAL_FLOORS: Mapping[str, Callable[[], FloorPlan]] = {
    "hall": hall,
    "pillars": pillars,
    "corridor": corridor,
    "ring": ring,
    "large-1": lambda: _large(1),
    "large-2": lambda: _large(2),
}
