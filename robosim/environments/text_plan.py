"""A plan as text for terminals: walls, robot with its heading, target."""

import numpy as np
from jaxtyping import Float

from robosim.plans.floorplan import FloorPlan

#: Largest width in characters; a character stands for twice as many rows as columns.
_WIDTH = 72
_ARROWS = ">^<v"


def draw_text(plan: FloorPlan, pose: Float[np.ndarray, "3"], target: Float[np.ndarray, "2"]) -> str:
    """Lines from top to bottom: # wall, . floor, X target, and > ^ < v for the robot."""
    ny, nx = plan.shape
    step = max(1, -(-nx // _WIDTH))
    rows, columns = range(0, ny, 2 * step), range(0, nx, step)
    free = plan.free.astype(int)
    some = np.maximum.reduceat(np.maximum.reduceat(free, rows, axis=0), columns, axis=1) > 0
    every = np.minimum.reduceat(np.minimum.reduceat(free, rows, axis=0), columns, axis=1) > 0
    letters = np.where(every, ".", np.where(some, "#", " "))
    arrow = _ARROWS[round((pose[2] - plan.origin[2]) / (np.pi / 2)) % 4]
    for place, letter in ((target, "X"), (pose[:2], arrow)):
        column, row = np.floor(plan.to_cells(np.asarray(place, float))).astype(int)
        if 0 <= row < ny and 0 <= column < nx:
            letters[row // (2 * step), column // step] = letter
    return "\n".join("".join(row).rstrip() for row in letters[::-1]) + "\n"
