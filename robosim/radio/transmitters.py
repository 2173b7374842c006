"""Transmitters at random places of a building's free space."""

import numpy as np
import shapely
from jaxtyping import Float

from robosim.building.building import Building
from robosim.plans.floorplan import MapError
from robosim.plans.outside import lie_outside

#: Transmitters keep this far from walls [m], where there is room.
CLEARANCE_M = 0.1


def random_transmitters(
    building: Building, count: int, height_m: float, rng: np.random.Generator
) -> Float[np.ndarray, "count 3"]:
    """Places drawn evenly over free space at a height within the building [m], rounded to millimetres.

    More of them begin with the same ones. MapError if there is no free space.
    """
    free = building.free_at(height_m)
    room = free.buffer(-CLEARANCE_M)
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
