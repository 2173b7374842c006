"""Free space around a building: white paper around a drawn floor plan, or the ground of a modelled house.

Such a plan does not mark rooms. But the ground around a house has no wall along its rim, and is wider than doors. So if
most of the rim of all free space, the boundary of its convex hull, has no wall, everything that can be reached from the
rim through openings wider than a door is outside. A frame of unknown cells around a picture is no wall.
"""

import logging
import math
from weakref import WeakKeyDictionary

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from robosim.plans.floorplan import OCCUPIED, FloorPlan

logger = logging.getLogger(__name__)
_FOUND: WeakKeyDictionary[FloorPlan, Bool[np.ndarray, "ny nx"]] = WeakKeyDictionary()

#: Openings up to this width keep the outside out [m].
DOOR_M = 1.3
#: Part of the rim that has no wall, and of the border of the rooms that has walls where the rim is unknown.
_OF_RIM, _WALLED = 0.5, 0.5
#: Rim and free cells may be this far apart [cells], since a slanted rim is a staircase.
_RIM_CELLS = 2
#: Smaller nooks of an outer wall are outside too, and without more floor than this there is no inside [m2].
_NOOK_M2 = 2.0


def outside_of(plan: FloorPlan) -> Bool[np.ndarray, "ny nx"]:
    """Free cells around the building, which do not count as floor; found once per plan, with a warning."""
    if plan not in _FOUND:
        _FOUND[plan] = outside = find_outside(plan)
        if outside.any():
            logger.warning(
                f"{plan.name}: {outside.sum() * plan.resolution_m**2:.0f} m2 of free space around the building reach "
                "the edges of the plan and are outside: they do not count as floor, and nothing is placed there. "
                "Make them unknown or occupied to shut them off."
            )
    return _FOUND[plan]


def find_outside(plan: FloorPlan) -> Bool[np.ndarray, "ny nx"]:
    """Free cells of a plan that lie outside of the building; none if walls stand along most of the rim."""
    free, wall = plan.free, plan.occupancy == OCCUPIED
    nothing = np.zeros_like(free)
    within = hull_of(free)
    rim = within & ~_shrunk(within, 1)
    if (grown(free, 1) & ~grown(wall, _RIM_CELLS))[rim].mean() < _OF_RIM:
        return nothing
    cell_m, half_m = plan.resolution_m, DOOR_M / 2
    margin = math.ceil(half_m / cell_m) + 2
    around = np.pad(free | ~(_shrunk(within, _RIM_CELLS) | wall), margin, constant_values=True)
    gap_m = cv2.distanceTransform(around.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
    gap_m[:2], gap_m[-2:], gap_m[:, :2], gap_m[:, -2:] = (2 * half_m,) * 4
    wide, _ = ndimage.label(gap_m > half_m)
    away = (wide != wide[0, 0]).astype(np.uint8)
    reach_m = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
    outside = free & (around & (reach_m <= half_m + cell_m))[margin:-margin, margin:-margin]
    rooms, count = ndimage.label(free & ~outside)
    small = np.bincount(rooms.ravel(), minlength=count + 1) * cell_m**2 < _NOOK_M2
    small[0] = False
    outside |= small[rooms]
    inside = free & ~outside
    border = grown(inside, 1) & ~free
    edge = np.concatenate([free[0], free[-1], free[:, 0], free[:, -1]])
    if not inside.any() or (edge.mean() < _OF_RIM and wall[border].mean() < _WALLED):
        return nothing
    return outside


def hull_of(cells: Bool[np.ndarray, "ny nx"]) -> Bool[np.ndarray, "ny nx"]:
    """Cells within the convex hull of some."""
    filled = np.zeros(cells.shape, np.uint8)
    rows = np.flatnonzero(cells.any(axis=1))
    ends = [cells[rows].argmax(axis=1), cells.shape[1] - 1 - cells[rows, ::-1].argmax(axis=1)]
    points = np.concatenate([np.column_stack([end, rows]) for end in ends]).astype(np.int32)
    return cv2.fillConvexPoly(filled, cv2.convexHull(points), 1) > 0


def grown(cells: Bool[np.ndarray, "ny nx"], by: int) -> Bool[np.ndarray, "ny nx"]:
    """Cells and all others within a distance of `by` cells along both axes."""
    return cv2.dilate(cells.astype(np.uint8), np.ones((2 * by + 1, 2 * by + 1), np.uint8)) > 0


def _shrunk(cells: Bool[np.ndarray, "ny nx"], by: int) -> Bool[np.ndarray, "ny nx"]:
    return ~grown(np.pad(~cells, by, constant_values=True), by)[by:-by, by:-by]


def lie_outside(plan: FloorPlan, points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Whether points (x, y) [m] of `map` are in cells outside; a wall may stand half a cell beyond the last."""
    cell = np.floor(plan.to_cells(points)).astype(int)[:, ::-1]
    row, column = np.clip(cell, 0, np.array(plan.shape) - 1).T
    return outside_of(plan)[row, column]
