"""Regions: the belief behind each frontier, and the order in which regions are searched."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robosim.policies.regions import Region, find_regions, regions_won, values_first
from robosim.policies.route_directions import MapSurvey
from slam.exploration.frontiers import Frontier
from slam.grid import Claim, GridFrame, MapEstimate
from slam.planning.travel_time import travel_time

ONTO = GridFrame(origin_xy=(-10.0, -10.0), resolution_m=0.2, shape=(100, 100))
HERE = np.zeros(3)


def seen_room(half_m: float, walls: bool = False) -> MapEstimate:
    """A square around the origin was seen and is free; nothing is known beyond, or walls of one cell around it."""
    frame = GridFrame(origin_xy=(-6.0, -6.0), resolution_m=0.05, shape=(240, 240))
    middle = np.abs(np.arange(240) * 0.05 - 6 + 0.025)
    inside, within = (
        (middle <= half)[:, None] & (middle <= half)[None] for half in (half_m, half_m + 0.05 * walls)
    )
    probability = np.where(inside, 0.1, np.where(within, 0.9, 0.5)).astype(np.float32)
    if walls:  # with a door of 1 m to the right
        probability[110:130, 160:] = np.where(inside, 0.1, 0.5)[110:130, 160:]
    return MapEstimate(
        frame=frame,
        obstacle_probability=probability,
        explored=within,
        blocked=np.zeros(frame.shape, bool),
        pose=HERE,
    )


def at(x: float, y: float) -> np.ndarray:
    """All of the belief in one cell."""
    p = np.zeros(ONTO.shape, np.float32)
    p[tuple(int(i) for i in ONTO.index(np.array([x, y])))] = 1
    return p


def frontier(x: float, y: float, length_m: float = 1.5) -> Frontier:
    place = np.array([x, y])
    return Frontier(goal_xy=place, near_xy=place, cost_m=math.hypot(x, y), length_m=length_m)


def beliefs(
    frontiers: list[Frontier], p: np.ndarray, map_: MapEstimate, pose=HERE, line_m: float = 15.0
) -> np.ndarray:
    lines_m = np.full(len(frontiers), line_m)
    return np.array([one.belief for one in find_regions(frontiers, lines_m, MapSurvey(map_, ONTO), p, pose)])


def test_belief_belongs_to_the_frontier_next_to_it():
    """The target 3 m beyond the frontier ahead."""
    ahead, left = beliefs([frontier(2.0, 0.0), frontier(0.0, 2.0)], at(5.1, 0.1), seen_room(2.0))
    assert ahead > 0 and left == 0


@pytest.mark.parametrize(("line_m", "fade_m"), [(1.0, 4.0), (9.0, 9.0), (15.0, 15.0), (80.0, 40.0)])
def test_belief_counts_less_far_behind_a_frontier(line_m, fade_m):
    """By a factor of e for each length of the line across it, of 4 m at least and 40 m at most."""
    near, far = (
        beliefs([frontier(2.0, 0.0)], at(x, 0.1), seen_room(2.0), line_m=line_m)[0] for x in (3.1, 6.1)
    )
    assert near / far == pytest.approx(math.exp(3 / fade_m), rel=0.05)


def test_regions_do_not_depend_on_the_robot():
    """On the other side of the room: only the decisions differ, 8 and 8 more, and 18 for half a turn."""
    frontiers, map_ = [frontier(2.0, 0.0), frontier(-2.0, 0.0)], seen_room(2.0)
    belief = np.full(ONTO.shape, 1e-4, np.float32)
    assert beliefs(frontiers, belief, map_, np.array([1.9, 0.1, 0.0])) == pytest.approx(
        beliefs(frontiers, belief, map_), rel=0.02
    )
    ahead, behind = find_regions(frontiers, np.full(2, 15.0), MapSurvey(map_, ONTO), belief, HERE)
    assert (ahead.decisions, behind.decisions) == pytest.approx((8, 8 + 18))


def test_walls_of_one_cell_close_a_region():
    """Beyond the wall on the left the route leads through the door on the right, 12 m at least."""
    door, gap = beliefs([frontier(2.0, 0.0), frontier(-2.0, 0.0)], at(-2.5, 0.1), seen_room(2.0, walls=True))
    assert gap == 0 and 0 < door < math.exp(-8 / 15)


def test_belief_that_walls_enclose_is_behind_a_gap_narrower_than_the_cells():
    """A gap of 0.1 m in the walls around: it closes cells of 0.2 m, and counts if no belief is behind a frontier."""
    room = seen_room(2.0, walls=True)
    probability = room.obstacle_probability.copy()
    probability[110:130, 160] = 0.9
    probability[118:120, 160] = 0.1
    closed, door = replace(room, obstacle_probability=probability), [frontier(2.0, 0.0)]
    assert beliefs(door, at(3.1, 0.1), closed)[0] > 0.5


def test_a_gap_narrower_than_a_door_counts_little():
    """Half a metre: an eighth."""
    wide, narrow = (
        beliefs([frontier(2.0, 0.0, length_m)], at(5.1, 0.1), seen_room(2.0))[0] for length_m in (1.0, 0.5)
    )
    assert narrow == pytest.approx(wide / 8)


def test_without_frontiers_there_are_no_regions():
    assert find_regions([], np.zeros(0), MapSurvey(seen_room(0.4), ONTO), at(3.0, 0.0), HERE) == []


def test_the_best_order_begins_with_the_region_on_the_route_to_others():
    """Open floor of 20 m: 0.1 at 4 m, 0.3 at 8 m behind it, 0.3 at 8 m on the other side.

    The values are those of all orders of three, counted out.
    """
    shape, cell = (21, 101), 0.2
    frame = GridFrame(origin_xy=(-10.1, -2.1), resolution_m=cell, shape=shape)
    field = travel_time(frame, np.ones(shape), np.ones(shape, bool), (10, 50))
    xs, amounts = (4.0, 8.0, -8.0), (0.1, 0.3, 0.3)
    regions = [Region(frontier(x, 0.0), amount, abs(x) / 0.25) for x, amount in zip(xs, amounts, strict=True)]
    values = values_first(regions, field, head_start=10.0, horizon=100.0)

    def worth(*order: int) -> float:
        total, late, place = 0.0, 0.0, 0.0
        for k in order:
            late += abs(xs[k] - place) / 0.25 + 10
            total, place = total + amounts[k] * math.exp(-late / 100), xs[k]
        return total

    best = [
        max(worth(0, 1, 2), worth(0, 2, 1)),
        max(worth(1, 0, 2), worth(1, 2, 0)),
        max(worth(2, 0, 1), worth(2, 1, 0)),
    ]
    assert values == pytest.approx(best, rel=0.03)
    assert values.argmax() == 0


def test_frontier_without_space_behind_it_has_no_belief():
    assert beliefs([frontier(9.0, 9.0)], at(5.1, 0.1), seen_room(2.0)).tolist() == [0.0]


def test_regions_are_left_to_a_robot_that_is_bound_for_them_unless_it_has_nearer_ones():
    """Open floor of 20 m with regions at -4, 6 and 8 m; the robot stands at 0, and the other 1 m before its goal."""
    shape, cell = (21, 101), 0.2
    frame = GridFrame(origin_xy=(-10.1, -2.1), resolution_m=cell, shape=shape)
    field = travel_time(frame, np.ones(shape), np.ones(shape, bool), (10, 50))
    regions = [Region(frontier(x, 0.0), 0.2, abs(x) / 0.25) for x in (-4.0, 6.0, 8.0)]

    def won(*goals: float) -> list[Region]:
        claims = [Claim(np.array([x, 0.0]), 1.0) for x in goals]
        return regions_won(regions, field, claims, head_start=10.0, horizon=400.0)

    assert won(6.0) == regions[:1]
    assert won(-4.0) == regions[1:]
    assert won(-4.0, 6.0, 8.0) == regions
