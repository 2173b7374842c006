"""Free space around a building: where the paper round a drawn floor plan is white, like its rooms.

Nothing in such a plan says that one is a room and the other is not. But the paper reaches the edges of the picture, and
doors are narrower than the space around a house: what can be come to from the edges without passing through anything as
narrow as a door is outside.
"""

import logging
import math

import cv2
import numpy as np
from jaxtyping import Bool
from scipy import ndimage

from robosim.plans.floorplan import FloorPlan

logger = logging.getLogger(__name__)

#: Openings up to this width keep the outside out [m].
DOOR_M = 1.3
#: Part of the picture's edge that has to be free.
_OF_EDGE = 0.5
#: Smaller nooks of an outer wall are outside too, and without more floor than this there is no inside [m2].
_NOOK_M2 = 2.0


def outside_of(plan: FloorPlan) -> Bool[np.ndarray, "ny nx"]:
    """Free cells of a plan that lie outside of the building; none where its edges are walls or unknown."""
    free = plan.free
    edge = np.concatenate([free[0], free[-1], free[:, 0], free[:, -1]])
    nothing = np.zeros_like(free)
    if edge.mean() < _OF_EDGE:
        return nothing
    cell_m, half_m = plan.resolution_m, DOOR_M / 2
    rim = math.ceil(half_m / cell_m) + 2
    around = np.pad(free, rim, constant_values=True)
    gap_m = cv2.distanceTransform(around.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
    gap_m[:2], gap_m[-2:], gap_m[:, :2], gap_m[:, -2:] = (2 * half_m,) * 4
    wide, _ = ndimage.label(gap_m > half_m)
    away = (wide != wide[0, 0]).astype(np.uint8)
    reach_m = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
    outside = (around & (reach_m <= half_m + cell_m))[rim:-rim, rim:-rim]
    rooms, count = ndimage.label(free & ~outside)
    small = np.bincount(rooms.ravel(), minlength=count + 1) * cell_m**2 < _NOOK_M2
    small[0] = False
    outside |= small[rooms]
    return nothing if not (free & ~outside).any() else outside


def tell_outside(plan: FloorPlan, outside: Bool[np.ndarray, "ny nx"]) -> None:
    """Warn where some of a plan's free space lies outside of the building."""
    area_m2 = float(outside.sum()) * plan.resolution_m**2
    if area_m2:
        logger.warning(
            "%s: %.0f m2 of free space around the building reach the edges of the plan and are taken for outside; "
            "nothing is drawn there. Make them unknown or occupied to shut them off.",
            plan.name,
            area_m2,
        )
