"""Places of transmitters: free, clear of walls, even over the floor."""

import numpy as np
import shapely

from robosim.building.building import make_building
from robosim.radio.receivers import TX_CLEARANCE_M, random_transmitters
from tests.plans import two_rooms


def test_places_are_even_over_free_space():
    """In halves of the floor that a wall parts, their shares are those of the areas, within 4 standard deviations."""
    building = make_building(two_rooms(0.8))
    places = random_transmitters(building, 1500, 1.5, np.random.default_rng(0))
    points = shapely.points(places[:, :2])
    assert shapely.contains(building.free, points).all()
    assert shapely.distance(building.free.boundary, points).min() >= TX_CLEARANCE_M - 1e-6
    assert set(places[:, 2]) == {1.5}
    room = building.free.buffer(-TX_CLEARANCE_M)
    low = shapely.intersection(room, shapely.box(-1, -1, 2.0, 9)).area / room.area
    spread = np.sqrt(low * (1 - low) / len(places))
    assert abs(np.mean(places[:, 0] < 2.0) - low) < 4 * spread


def test_more_places_begin_with_the_same():
    building = make_building(two_rooms(0.8))
    few, more = (random_transmitters(building, n, 1.5, np.random.default_rng(7)) for n in (2, 5))
    assert few.tolist() == more[:2].tolist()
