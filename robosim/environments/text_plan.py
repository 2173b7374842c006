"""A plan in letters, for terminals: walls, the robot by the way it looks, the target."""

import numpy as np
from jaxtyping import Float

from robosim.plans.floorplan import FloorPlan

#: Letters across; lines are half as many for a square, as letters are twice as high as wide.
_ACROSS = 72
_ARROWS = ">^<v"


def draw_text(plan: FloorPlan, pose: Float[np.ndarray, "3"], target: Float[np.ndarray, "2"]) -> str:
    """Lines from top to bottom: # wall, . floor, X target, and > ^ < v for the robot.

    Args:
        plan: The floor plan.
        pose: Of the robot: x [m], y [m], yaw [rad] in `map`.
        target: x, y [m] in `map`.
    """
    ny, nx = plan.shape
    step = max(1, -(-nx // _ACROSS))
    letters = [
        ["#" if not floor.all() and floor.any() else "." if floor.any() else " " for floor in row]
        for row in _blocks(plan.free, 2 * step, step)
    ]
    turn = pose[2] + plan.origin[2] * -1
    marks = ((target, "X"), (pose[:2], _ARROWS[round(turn / (np.pi / 2)) % 4]))
    for place, letter in marks:
        column, row = np.floor(plan.to_cells(np.asarray(place, float))).astype(int)
        if 0 <= row < ny and 0 <= column < nx:
            letters[row // (2 * step)][column // step] = letter
    return "\n".join("".join(row).rstrip() for row in reversed(letters)) + "\n"


def _blocks(free: np.ndarray, high: int, wide: int) -> list[list[np.ndarray]]:
    """Pieces of the plan, one a letter, row by row."""
    ny, nx = free.shape
    return [
        [free[row : row + high, column : column + wide] for column in range(0, nx, wide)]
        for row in range(0, ny, high)
    ]
