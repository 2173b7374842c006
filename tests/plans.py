"""Small plans with known answers, shared by the tests."""

import math
from dataclasses import replace

import numpy as np

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


def two_rooms(door_m: float, wall_m: float = 0.2) -> FloorPlan:
    """Two rooms of 3 m by 3 m, side by side, joined by a door in the middle of the wall between them."""
    r = 0.05
    occupancy = np.full((round(3 / r), round((6 + wall_m) / r)), FREE, np.uint8)
    wall = slice(round(3 / r), round((3 + wall_m) / r))
    occupancy[:, wall] = OCCUPIED
    half = round(door_m / r / 2)
    middle = occupancy.shape[0] // 2
    occupancy[middle - half : middle + half, wall] = FREE
    return FloorPlan(occupancy=occupancy, resolution_m=r, name="two rooms")
