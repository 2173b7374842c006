"""Maps that robots of a team share."""

import numpy as np
import pytest

from robosim.team.shared_map import TILE, SharedMap, TileChanges
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull


def _map(
    origin: tuple[float, float],
    shape: tuple[int, int],
    seen: tuple[slice, slice],
    wall_row: int | None = None,
) -> MapEstimate:
    """A map with floor in a window, and a wall in one row of it."""
    probability, explored = np.full(shape, 0.5, np.float32), np.zeros(shape, bool)
    probability[seen], explored[seen] = 0.1, True
    if wall_row is not None:
        probability[wall_row, seen[1]] = 0.9
    return MapEstimate(
        frame=GridFrame(origin_xy=origin, resolution_m=0.05, shape=shape),
        obstacle_probability=probability,
        explored=explored,
        blocked=np.zeros(shape, bool),
        pose=np.array([origin[0] + 1.0, origin[1] + 1.0, 0.0]),
        surface_offset_m=np.zeros((*shape, 2), np.float32),
        anticipated_probability=probability.copy(),
    )


def _report(other: MapEstimate, local_map: MapEstimate, shared: SharedMap) -> None:
    for _, tile in TileChanges().of(other):
        shared.add("other", tile, local_map)


def test_merge_nothing_received_is_own_map() -> None:
    local_map = _map((0.0, 0.0), (60, 60), np.s_[10:30, 10:30])
    assert SharedMap(Hull(0.1)).merge(local_map) is local_map


def test_merge_continues_own_map_beyond_its_frame() -> None:
    local_map = _map((0.0, 0.0), (60, 60), np.s_[10:30, 10:30])
    other = _map((5.0, -4.0), (100, 120), np.s_[20:90, 5:100], wall_row=40)
    shared = SharedMap(Hull(0.1))
    _report(other, local_map, shared)
    merged = shared.merge(local_map)
    assert merged.explored.sum() == local_map.explored.sum() + other.explored.sum()
    row, column = (int(v) for v in merged.frame.index(np.array([5.0 + 50.5 * 0.05, -4.0 + 40.5 * 0.05])))
    assert merged.obstacle_probability[row, column] == pytest.approx(0.9, abs=0.005)
    assert merged.obstacle[row, column] and not merged.obstacle[row - 1, column]
    assert merged.anticipated_probability is not None
    assert merged.anticipated_probability[row, column] > 0.5


def test_merge_own_sight_counts_where_both_have_seen() -> None:
    local_map = _map((0.0, 0.0), (80, 80), np.s_[10:50, 10:50])
    other = _map((0.0, 0.0), (80, 80), np.s_[10:70, 10:70], wall_row=20)
    shared = SharedMap(Hull(0.1))
    _report(other, local_map, shared)
    merged = shared.merge(local_map)
    at = tuple(int(v) for v in merged.frame.index(np.array([40.5 * 0.05, 20.5 * 0.05])))
    beyond = tuple(int(v) for v in merged.frame.index(np.array([60.5 * 0.05, 20.5 * 0.05])))
    assert merged.obstacle_probability[at] == pytest.approx(0.1)
    assert merged.obstacle_probability[beyond] == pytest.approx(0.9, abs=0.005)


def test_merge_robot_that_others_have_mapped_is_no_obstacle_to_itself() -> None:
    local_map = _map((0.0, 0.0), (80, 80), np.s_[50:70, 10:50])
    other = _map((0.0, 0.0), (80, 80), np.s_[10:70, 10:70], wall_row=20)
    shared = SharedMap(Hull(0.1))
    _report(other, local_map, shared)
    rows, columns, under = local_map.frame.under(local_map.pose, Hull(0.1))
    assert other.obstacle[rows, columns][under].any()
    assert not shared.merge(local_map).obstacle[rows, columns][under].any()


def test_merge_follows_own_map_around_the_robot() -> None:
    local_map = _map((0.0, 0.0), (80, 80), np.s_[10:20, 10:20])
    other = _map((3.0, 3.0), (60, 60), np.s_[10:50, 10:50])
    shared = SharedMap(Hull(0.1))
    _report(other, local_map, shared)
    before = shared.merge(local_map).explored.sum()
    local_map.explored[10:30, 10:30] = True
    assert shared.merge(local_map).explored.sum() == before + 300


def test_merge_places_lattices_to_half_a_cell() -> None:
    local_map = _map((0.0, 0.0), (60, 60), np.s_[10:30, 10:30])
    other = _map((4.02, 1.0), (60, 60), np.s_[10:30, 10:30])
    shared = SharedMap(Hull(0.1))
    _report(other, local_map, shared)
    merged = shared.merge(local_map)
    reported = merged.frame.centres(merged.explored)
    assert reported[:, 0].max() == pytest.approx(4.02 + 29.5 * 0.05, abs=0.0251)


def test_changes_are_reported_once() -> None:
    local_map, changes = _map((-1.0, 2.0), (200, 200), np.s_[5:150, 5:150]), TileChanges()
    first = dict(changes.of(local_map))
    assert len(first) > 4
    assert all(max(tile.codes.shape) <= TILE for tile in first.values())
    assert not dict(changes.of(local_map))
    local_map.obstacle_probability[30, 30] = 0.9
    assert len(dict(changes.of(local_map))) == 1
