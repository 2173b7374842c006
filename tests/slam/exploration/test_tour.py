"""The order of visits: compared with all permutations, shortest paths and areas of known size."""

import itertools
import math

import numpy as np
import pytest

from slam.exploration.tour import costs_between, shared_areas, values_of_orders
from slam.grid import GridFrame
from slam.planning.cost_map import Box, CostMap, travel_time_to


def values_by_permutations(gain, first, between):
    """All orders, one after another."""
    best = np.zeros(len(gain))
    for order in itertools.permutations(range(len(gain))):
        discount, total = first[order[0]], 0.0
        for k, visit in enumerate(order):
            discount *= between[order[k - 1], visit] if k else 1.0
            total += discount * gain[visit]
        best[order[0]] = max(best[order[0]], total)
    return best


@pytest.mark.parametrize("seed", range(10))
def test_the_best_order_is_that_of_all_permutations(seed):
    """Six visits with drawn gains and discounts, whether or not these obey the triangle inequality."""
    rng = np.random.default_rng(seed)
    gain, first, between = rng.uniform(0, 5, 6), rng.uniform(0, 1, 6), rng.uniform(0, 1, (6, 6))
    np.testing.assert_allclose(
        values_of_orders(gain, first, between), values_by_permutations(gain, first, between), rtol=1e-12
    )


def test_a_small_gain_nearby_is_collected_before_a_large_one_farther_on():
    """A pocket at 5 decisions, 5 m^2 at 30 in the other direction, 35 between: the pocket first from 0.8 m^2 on.

    That is where g (exp(-5/60) - exp(-65/60)) equals 5 (exp(-30/60) - exp(-40/60)).
    """
    first, between = np.exp(-np.array([5, 30]) / 60), np.exp(-np.array([[0, 35], [35, 0]]) / 60)
    pocket, large = values_of_orders(np.array([0.75, 5.0]), first, between)
    assert pocket < large
    pocket, large = values_of_orders(np.array([0.85, 5.0]), first, between)
    assert pocket > large


def field_of(wall, source, cell_m=0.1):
    frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=cell_m, shape=wall.shape)
    costs = CostMap(frame=frame, cost=np.ones(wall.shape, np.float32), passable=~wall)
    return costs, travel_time_to(costs, source)


def test_costs_between_places_are_at_least_the_least_and_at_most_a_quarter_more():
    """Three rooms off a corridor and two places in one of them, by fast marching from each place."""
    wall = np.zeros((60, 100), bool)
    wall[20] = True
    wall[20, [15, 16, 45, 46, 85, 86]] = False
    wall[21:, [30, 65]] = True
    costs, field = field_of(wall, (10, 50))
    places = np.array([[1.5, 5.0], [4.05, 3.5], [5.5, 4.0], [8.5, 4.5], [9.5, 0.5]])
    found = costs_between(field, places)
    np.testing.assert_array_equal(found, found.T)
    assert (np.diag(found) == 0).all()
    for i, place in enumerate(places):
        iy, ix = costs.frame.index(place)
        least = travel_time_to(costs, (int(iy), int(ix))).at(places)
        others = np.arange(len(places)) != i
        assert (found[i][others] > least[others] - 0.15).all()
        assert (found[i][others] < 1.25 * least[others]).all()


def half_seen(shape=(200, 200)):
    """A box that is seen in its left half, and open."""
    explored = np.zeros(shape, bool)
    explored[:, :100] = True
    probability = np.where(explored, 0.05, 0.5).astype(np.float32)
    return Box(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.05, shape=shape),
        probability=probability,
        explored=explored,
        anticipated=np.full(shape, 0.5, np.float32),
        obstacle=np.zeros(shape, bool),
        blocked=np.zeros(shape, bool),
        offset_m=None,
        pose=np.array([4.0, 5.0, 0.0]),
    )


def test_the_area_in_sight_is_a_half_disc_and_places_share_it():
    """Pi r^2 / 2 for one place; two at the same spot have half each; two far apart have all."""
    box, spot, far = half_seen(), [4.975, 5.025], [4.975, 8.0]
    half_disc = math.pi * 2.0**2 / 2
    assert shared_areas(box, np.array([spot]), 2.0)[0] == pytest.approx(half_disc, rel=0.06)
    np.testing.assert_allclose(shared_areas(box, np.array([spot, spot]), 2.0), half_disc / 2, rtol=0.06)
    two = shared_areas(box, np.array([spot, far]), 1.2)
    np.testing.assert_allclose(two, math.pi * 1.2**2 / 2, rtol=0.1)


def test_a_wall_hides_what_lies_behind():
    """Half of the half disc behind a wall from the frontier on."""
    box = half_seen()
    box.probability[98:100, 95:] = 0.95
    area = shared_areas(box, np.array([[4.975, 5.025]]), 2.0)[0]
    assert area == pytest.approx(math.pi * 2.0**2 / 4, rel=0.15)
