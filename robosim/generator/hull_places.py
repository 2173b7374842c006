"""Where the centre of a round hull fits on a floor plan."""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from robosim.plans.floorplan import FloorPlan


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
