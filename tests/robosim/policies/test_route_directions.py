"""Directions of the shortest routes, on maps with known routes."""

import numpy as np
import pytest

from robosim.policies import route_directions as module
from robosim.policies.belief import TargetBelief
from robosim.policies.route_directions import MapSurvey, RouteDirections, cell_shares, route_directions
from slam.grid import GridFrame, MapEstimate

ONTO = GridFrame(origin_xy=(-10.0, -10.0), resolution_m=0.2, shape=(100, 100))


def hall(obstacle: np.ndarray | None = None, anticipated: np.ndarray | None = None) -> MapEstimate:
    """A free map of 12 m by 12 m around the origin, but for obstacles; or unknown, with anticipated ones."""
    frame = GridFrame(origin_xy=(-6.0, -6.0), resolution_m=0.05, shape=(240, 240))
    probability = np.full(frame.shape, 0.1 if anticipated is None else 0.5, np.float32)
    if obstacle is not None:
        probability[obstacle] = 0.9
    guess = None if anticipated is None else np.where(anticipated, 0.95, 0.3).astype(np.float32)
    known = np.full(frame.shape, anticipated is None)
    return MapEstimate(
        frame=frame,
        obstacle_probability=probability,
        explored=known,
        blocked=np.zeros(frame.shape, bool),
        pose=np.zeros(3),
        anticipated_probability=guess,
    )


def box(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    at = np.arange(240) * 0.05 - 6 + 0.025
    return ((at >= y0) & (at <= y1))[:, None] & ((at >= x0) & (at <= x1))[None]


def directions(routes, place):
    """Directions of the route to a place and of the route back [rad]."""
    iy, ix = (int(i) for i in ONTO.index(np.array(place)))
    out, back = (
        routes.out[iy - routes.rows.start, ix - routes.columns.start],
        routes.back[iy - routes.rows.start, ix - routes.columns.start],
    )
    return float(np.arctan2(out[1], out[0])), float(np.arctan2(back[1], back[0]))


def test_on_free_ground_routes_are_straight():
    """Within 3 degrees of the straight line, all round; the cells' own size included."""
    routes = MapSurvey(hall(), ONTO, 2.0).routes(np.zeros(2))
    for angle in np.linspace(-3, 3, 13):
        out, back = directions(routes, 4.5 * np.array([np.cos(angle), np.sin(angle)]))
        assert abs(np.angle(np.exp(1j * (out - angle)))) < np.deg2rad(3)
        assert abs(np.angle(np.exp(1j * (back - angle - np.pi)))) < np.deg2rad(3)


@pytest.mark.parametrize("kind", ["known", "anticipated"])
def test_routes_bend_around_the_end_of_a_wall(kind):
    """A wall from (2, -1) up to the edge of the grid; routes behind it begin towards its lower end."""
    stands = box(2.0, 2.2, -1.0, 6.0)
    map_ = hall(stands) if kind == "known" else hall(anticipated=stands)
    routes = MapSurvey(map_, ONTO, 0.0).routes(np.array([0.0, 3.0]))
    end = np.array([2.1, -1.1])
    out, back = directions(routes, (5.0, 4.0))
    assert out == pytest.approx(np.arctan2(end[1] - 3.0, end[0]), abs=0.2)
    assert back == pytest.approx(np.arctan2(end[1] - 4.0, end[0] - 5.0), abs=0.2)


@pytest.mark.parametrize("x", [2.0, 2.05, 2.1, 2.15])
def test_walls_of_one_cell_block_routes(x):
    """A wall of 5 cm to the upper edge, wherever it lies in the larger cells: the route leads around its lower end."""
    routes = MapSurvey(hall(box(x, x + 0.05, -1.0, 6.0)), ONTO, 0.0).routes(np.array([0.0, 3.0]))
    iy, ix = (int(i) for i in ONTO.index(np.array([5.0, 4.0])))
    around = np.hypot(x, 4.0) + np.hypot(5.0 - x, 5.0)
    assert routes.length_m[iy - routes.rows.start, ix - routes.columns.start] == pytest.approx(
        around, rel=0.06
    )


def test_reception_out_of_sight_is_as_fitted():
    """At 28 GHz: a route of 4.5 m with a bend of half a metre and 2 m of it unseen, 83 %; less with each of them."""
    metres = np.ones((1, 2), np.float32)
    routes = RouteDirections(
        slice(0, 1), slice(0, 2), np.zeros((1, 2, 2)), np.zeros((1, 2, 2)),
        length_m=np.array([[4.5, 2.5]], np.float32), entry=np.array([[1, -1]], np.int32),
    )  # fmt: skip
    assert routes.unexplored_m().tolist() == [[2.0, 0.0]]
    received = routes.received(np.array([[4.0, 2.0]]))
    odds = 3.54 - 3.11 * np.log10(4.5) - 1.5 * np.log10(0.55) - 0.81 * np.log10(2.3)
    assert received[0, 0] == pytest.approx(1 / (1 + np.exp(-odds)), rel=1e-3) == pytest.approx(0.83, abs=0.01)
    assert received[0, 1] > received[0, 0] > routes.received(np.array([[3.0, 1.0]]))[0, 0]
    assert (
        routes._replace(length_m=np.inf * metres, entry=np.full((1, 2), -1)).received(2 * metres) == 0
    ).all()


def test_a_place_in_a_wall_has_the_directions_of_its_neighbour():
    """The first cells inside of a wall have the direction of those before it; its middle has none."""
    routes = MapSurvey(hall(box(2.0, 4.0, -6.0, 6.0)), ONTO, 0.0).routes(np.zeros(2))
    out, _ = directions(routes, (2.1, 0.1))
    assert abs(out) < 0.2
    iy, ix = (int(i) for i in ONTO.index(np.array([3.1, 0.1])))
    assert not routes.out[iy - routes.rows.start, ix - routes.columns.start].any()


def test_cells_are_filled_by_what_stands_in_them():
    """A wall of 0.1 m fills half of cells of 0.2 m; what is thought likely, but not surely, fills nothing."""
    _, share = MapSurvey(hall(box(2.0, 2.1, -2.0, 2.0)), ONTO).shares(ONTO)
    iy, ix = (int(i) for i in ONTO.index(np.array([2.05, 0.1])))
    assert share[iy, ix] == pytest.approx(0.5)
    assert share.max() <= 1
    map_ = hall(anticipated=box(2.0, 2.1, -2.0, 2.0))
    unsure = MapEstimate(**{**vars(map_), "anticipated_probability": map_.anticipated_probability * 0.9})
    assert not MapSurvey(unsure, ONTO).shares(ONTO)[1].any()


def test_shares_equal_counts_cell_by_cell():
    """Grids of many sizes and places, larger and smaller cells, overlapping partly or not at all: bit-identical."""
    rng = np.random.default_rng(0)
    for k in range(60):
        fine = GridFrame(
            origin_xy=tuple(rng.uniform(-10, 10, 2)),
            resolution_m=float(rng.choice([0.05, 0.1, 0.2])),
            shape=tuple(int(n) for n in rng.integers(1, 200, 2)),
        )
        part = GridFrame(
            origin_xy=tuple(rng.uniform(-15, 15, 2)) if k % 2 else fine.origin_xy,
            resolution_m=float(rng.choice([0.05, 0.2, 0.25])),
            shape=tuple(int(n) for n in rng.integers(1, 150, 2)),
        )
        holds = rng.random(fine.shape) < 0.3
        map_ = MapEstimate(
            frame=fine,
            obstacle_probability=np.zeros(fine.shape, np.float32),
            explored=holds,
            blocked=holds,
            pose=np.zeros(3),
        )
        row, column = part.index(fine.centres(holds))
        inside = part.inside(row, column)
        count = np.zeros(part.shape, int)
        np.add.at(count, (row[inside], column[inside]), 1)
        expected = ((fine.resolution_m / part.resolution_m) ** 2 * count).astype(np.float32)
        assert cell_shares(holds, map_, part).tolist() == expected.tolist()


def test_a_map_is_surveyed_once_per_decision(monkeypatch):
    """Routes are cached for one map, grid and place."""
    map_, belief, calls = hall(), TargetBelief(np.zeros(2)), []
    monkeypatch.setattr(module, "route_directions", lambda *a: calls.append(a) or route_directions(*a))
    first = belief.survey(map_)
    routes = first.routes(np.zeros(2))
    assert belief.survey(map_) is first and belief.survey(map_).routes(np.zeros(2)) is routes
    assert len(calls) == 1
    first.routes(np.array([1.0, 0.0]))
    other = belief.survey(hall())
    assert other is not first and len(calls) == 2
    belief._grow(np.array([[100.0, 0.0]]))
    assert belief.survey(other.estimate) is not other
