"""Small plans with known answers, shared by the tests."""

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter

from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan


def room(width_m: float = 4.0, depth_m: float = 3.0, resolution_m: float = 0.05, **kwargs) -> FloorPlan:
    """One empty rectangular room with its lower-left inner corner at (0, 0)."""
    shape = (round(depth_m / resolution_m), round(width_m / resolution_m))
    return FloorPlan(
        occupancy=np.full(shape, FREE, np.uint8), resolution_m=resolution_m, **{"name": "room", **kwargs}
    )


def turned(plan: FloorPlan, degrees: float) -> FloorPlan:
    """The same plan, turned about its corner."""
    return replace(plan, origin=(*plan.origin[:2], plan.origin[2] + math.radians(degrees)))


def two_rooms(door_m: float, wall_m: float = 0.2, resolution_m: float = 0.05) -> FloorPlan:
    """Two rooms of 3 m by 3 m, side by side, joined by a door in the middle of the wall between them."""
    r = resolution_m
    occupancy = np.full((round(3 / r), round((6 + wall_m) / r)), FREE, np.uint8)
    wall = slice(round(3 / r), round((3 + wall_m) / r))
    occupancy[:, wall] = OCCUPIED
    half = round(door_m / r / 2)
    middle = occupancy.shape[0] // 2
    occupancy[middle - half : middle + half, wall] = FREE
    return FloorPlan(occupancy=occupancy, resolution_m=r, name="two rooms")


def plan_from(
    free: np.ndarray, wall_line: str = "cell_edge", resolution_m: float = 1.0, origin=(0.0, 0.0, 0.0)
) -> FloorPlan:
    """A plan whose cells are free or solid."""
    return FloorPlan(
        occupancy=np.where(free, FREE, OCCUPIED).astype(np.uint8),
        resolution_m=resolution_m,
        origin=origin,
        wall_line=wall_line,
    )


def plan_of(
    rows: list[str], wall_line: str = "cell_edge", resolution_m: float = 1.0, origin=(0.0, 0.0, 0.0)
) -> FloorPlan:
    """A plan from pictures of rows, the top one first; '.' is free."""
    free = np.array([[letter == "." for letter in row] for row in rows])[::-1]
    return plan_from(free, wall_line, resolution_m, origin)


def ragged(seed: int) -> tuple[np.ndarray, tuple[float, float, float]]:
    """Ragged blobs of free cells with every awkward touching there is, and an origin of a turned plan."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(3, 36, 2)
    free = gaussian_filter(rng.standard_normal(shape), rng.choice([0.0, 0.7, 1.5])) > rng.uniform(-0.3, 0.1)
    free[0, 0] = True
    return free, (*rng.uniform(-20, 20, 2), rng.uniform(-np.pi, np.pi))
