"""The published protocol of MapEx: what the lidar sees, which paths are taken, and which goals are chosen."""

import math

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from slam.grid import GridFrame, MapEstimate
from tests.benchmarks import mapex
from tests.benchmarks.harness import Options

SEVEN = (
    "50010535_PLAN2", "50010536_PLAN3", "50015848", "50037765_PLAN3", "50052749", "50052752", "50052753",
)  # fmt: skip


def hall(rows=60, columns=80):
    """A hall with a wall across at column 40 that leaves an opening of ten cells."""
    wall = np.zeros((rows, columns), bool)
    wall[[0, -1]], wall[:, [0, -1]], wall[:50, 40] = True, True, True
    return wall


def floor_of(wall, start):
    return mapex.Floor(wall=wall, drawn=wall, rooms=~wall, starts=(start,))


def estimate_of(free, wall, cell):
    """A map with known free cells and walls, and the robot in a cell."""
    probability = np.full(free.shape, 0.5, np.float32)
    probability[free], probability[wall] = 0.05, 0.95
    return MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=mapex.CELL_M, shape=free.shape),
        obstacle_probability=probability,
        explored=probability != 0.5,
        blocked=np.zeros(free.shape, bool),
        pose=np.array([(cell[1] + 0.5) * mapex.CELL_M, (cell[0] + 0.5) * mapex.CELL_M, 0.0]),
    )


@pytest.mark.parametrize("name", SEVEN)
def test_starts_stand_on_free_floor_of_a_room(shared, name):
    """With 0.2 m of free floor around them; as (column, row), half of the published ones would lie outside."""
    floor = mapex.read_floor(shared / "maps" / "kth", name)
    assert len(set(floor.starts)) == 4
    for row, column in floor.starts:
        assert floor.rooms[row, column]
        assert not floor.wall[row - 2 : row + 3, column - 2 : column + 3].any()


def test_the_lidar_sees_its_half_of_a_hall_and_what_the_opening_shows():
    """All cells of the own half; nothing in the shadow of the wall, by the line past the wall's end."""
    walk = mapex.LidarWalk(floor_of(hall(), (20, 20)), 0)
    known = walk.estimate().explored
    assert known[1:-1, 1:40].all()
    # The line from the robot past the end of the wall climbs 29.5 rows on 19.5 columns.
    rows, columns = np.indices(known.shape)
    shadow = (columns > 41) & (rows - 20 < (columns - 20) * 29.5 / 19.5 - 3)
    assert not known[shadow].any()
    assert known[58, 41:44].all()
    assert walk.coverage() == pytest.approx(known[~hall()].mean())


def test_paths_cost_what_scipy_says():
    """On 20 drawn fields: the sum over entered cells is Dijkstra's, and neighbours follow each other."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        cost = np.pad(rng.integers(1, 11, (14, 17)) * (rng.random((14, 17)) < 0.75), 1)
        cost[3, 3] = cost[12, 15] = 4
        width, flat = cost.shape[1], cost.ravel()
        pairs = [
            (i, i + step) for i in np.flatnonzero(flat) for step in (-width, -1, 1, width) if flat[i + step]
        ]
        start, goal = 3 * width + 3, 12 * width + 15
        cells = mapex._path(flat.astype(np.int32), start, goal, width)
        assert set(np.abs(np.diff(cells))) <= {1, width}
        tails, heads = np.array(pairs).T
        graph = csr_array((flat[heads].astype(float), (tails, heads)), shape=(len(flat), len(flat)))
        least = dijkstra(graph, indices=start)
        if np.isfinite(least[goal]):
            assert cells[-1] == goal
            assert flat[cells[1:]].sum() == least[goal]
        else:
            reached = np.flatnonzero(np.isfinite(least))
            gaps = np.hypot(reached // width - 12, reached % width - 15)
            assert math.hypot(cells[-1] // width - 12, cells[-1] % width - 15) == gaps.min()


def test_a_step_costs_ten_less_the_distance_to_walls_and_unknown_cells():
    """A corridor of 13 free cells between walls: their neighbours are closed, then 9, ..., 5 in the middle."""
    wall = np.zeros((15, 41), bool)
    wall[[0, -1]] = True
    free = ~wall
    free[:, 40] = False
    cost = mapex.planning_cost(estimate_of(free, wall, (7, 5)))
    assert cost[:, 20].tolist() == [0, 0, 9, 8, 7, 6, 5, 4, 5, 6, 7, 8, 9, 0, 0]
    assert cost[7, 40] == 10 and cost[7, 39] == 9


def test_the_published_goal_is_nearest_in_a_straight_line_but_not_within_a_metre():
    """Behind a wall at 1.9 m rather than at 2.6 m on this side; one at 0.5 m, or of ten cells, does not count."""
    wall = hall(80, 100)
    free = ~wall
    for patch in (np.s_[24:31, 50:60], np.s_[24:31, 5:15], np.s_[31:32, 33:36], np.s_[27:28, 22:24]):
        free[patch] = False
    x, y = mapex.PublishedNearest().goal(estimate_of(free, wall, (27, 35))) / mapex.CELL_M
    assert int(x) in (54, 55) and int(y) in (23, 31)


def test_a_run_keeps_its_goal_until_within_a_metre():
    """Steps of at most three cells; the goal changes only within a metre of the last one."""
    walk, chooser = mapex.LidarWalk(floor_of(hall(), (20, 20)), 0), mapex.PublishedNearest()
    goals, places = [], []
    while (goal := chooser.goal(walk.estimate())) is not None and len(goals) < 100:
        goals.append(goal)
        places.append(walk.estimate().pose[:2])
        walk.advance(goal)
    assert walk.coverage() > 0.99 and len(goals) < 100
    legs = np.abs(np.diff(places, axis=0)).sum(axis=1) / mapex.CELL_M
    assert legs.max() < 3 + 1e-6
    for before, after, place in zip(goals[:-1], goals[1:], places[1:], strict=True):
        assert (before == after).all() or math.hypot(*(before - place)) < 1.0


def test_a_ratio_of_two_on_all_starts_has_no_width():
    assert mapex.geometric_mean(np.full(5, 2.0)) == pytest.approx((2.0, 2.0, 2.0))
    middle, low, high = mapex.geometric_mean(np.array([0.5, 2.0]))
    assert middle == pytest.approx(1.0) and low < 0.6 and high > 1.6


@pytest.mark.usefixtures("in_process")
def test_sixty_steps_on_a_floor(shared, tmp_path):
    """All explorers see more than at the start; ratios of the published choice to itself are 1."""
    results = mapex.main(
        shared / "maps" / "kth",
        explorers=("gain",),
        floors=("50052752",),
        steps=60,
        options=Options(out=tmp_path),
    )
    assert results.find("mapex", mapex.PUBLISHED, "ratio")["value"] == 1
    seen = [results.find("mapex", row, "seen after 1000")["value"] for row in (mapex.PUBLISHED, "gain")]
    assert min(seen) > 20
