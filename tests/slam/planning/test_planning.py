"""Plans are short, keep the hull off the walls, and exist exactly where the hull passes."""

import itertools
import math

import numpy as np
import pytest

from slam.grid import GridFrame, MapEstimate
from slam.planning.planner import Planner
from slam.robot import Robot
from tests.slam.floors import at_pose, divided, floor

RADIUS_M = 0.10


def _length(path) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _samples(path):
    return np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(path)])


def _gap(estimate: MapEstimate, path) -> float:
    """Least distance of the path to the centre of an obstacle cell [m]."""
    obstacles = estimate.frame.centres(estimate.obstacle)
    return float(np.hypot(*(_samples(path)[:, None] - obstacles[None]).transpose(2, 0, 1)).min())


@pytest.mark.parametrize("goal", [(2.0, 0.0), (1.5, 1.2), (-2.0, -1.3)])
def test_in_the_open_the_path_is_straight(goal):
    """From start to goal exactly, at most 1 % longer than straight and within 5 cm of the line."""
    plan = Planner().plan(floor(), np.array(goal))
    straight = math.hypot(*goal)
    np.testing.assert_allclose(plan.path[0], [0, 0], atol=1e-9)
    np.testing.assert_allclose(plan.path[-1], goal, atol=1e-9)
    assert plan.reachable
    assert plan.length_m == pytest.approx(straight, rel=0.01)
    assert plan.length_m == pytest.approx(_length(plan.path))
    unit = np.array(goal) / straight
    assert np.abs(_samples(plan.path) @ [-unit[1], unit[0]]).max() < 0.05


@pytest.mark.parametrize("gap_cells", [5, 6, 10])
def test_a_path_leads_through_a_door_just_wider_than_the_hull(gap_cells):
    """Obstacles are cell centres: n free cells leave (n + 1) cells of 5 cm; 0.3 m for a hull 0.2 m wide at n = 5."""
    estimate = divided(gap_cells)
    plan = Planner().plan(estimate, np.array([1.5, 0.1]))
    assert plan.reachable
    crossing = _samples(plan.path)[np.argmin(np.abs(_samples(plan.path)[:, 0]))]
    assert 0.0 < crossing[1] < gap_cells * 0.05
    assert _gap(estimate, plan.path) >= RADIUS_M - 0.01
    assert plan.length_m < 3.3


@pytest.mark.parametrize("gap_cells", [0, 1, 2])
def test_no_path_leads_through_a_door_narrower_than_the_hull(gap_cells):
    """At n = 2 the door is 0.15 m wide, and the hull 0.2 m: even with 2 cm of overlap a side it does not fit.

    The plan ends on the robot's side, as near to the goal as the wall allows.
    """
    estimate = divided(gap_cells)
    plan = Planner().plan(estimate, np.array([1.5, 0.0]))
    assert not plan.reachable
    assert plan.goal_xy[0] < 0.05
    assert np.isfinite(plan.path).all()
    assert _samples(plan.path)[:, 0].max() < 0.05


def test_a_larger_hull_does_not_pass_where_a_smaller_one_does():
    """A door of 0.3 m: radius 0.10 passes, 0.18 does not."""
    estimate, goal = divided(5), np.array([1.5, 0.1])
    assert Planner().plan(estimate, goal).reachable
    assert not Planner(Robot(radius_m=0.18)).plan(estimate, goal).reachable


@pytest.mark.parametrize(("cell_m", "radius_m"), [(0.1, 0.10), (0.1, 0.03), (0.2, 0.25), (0.5, 0.18)])
def test_walls_of_one_large_cell_are_closed(cell_m, radius_m):
    """A hall of 20 m with a wall across, one cell thick: a path leads through its door 10 m aside, or not at all.

    Paths led through the wall, where its cells, or those next to it, are larger than the hull reaches.
    """
    robot, n = Robot(radius_m=radius_m, track_m=0.06), round(20 / cell_m)
    probability = np.full((n, n), 0.05, np.float32)
    probability[[0, n // 2, -1]] = probability[:, [0, -1]] = 0.95
    estimate = MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=cell_m, shape=(n, n)),
        obstacle_probability=probability,
        explored=np.ones((n, n), bool),
        blocked=np.zeros((n, n), bool),
        pose=np.array([15.0, 5.0, 0.0]),
    )
    assert not Planner(robot).plan(estimate, np.array([15.0, 15.0])).reachable
    door = slice(n // 4, n // 4 + round(1.0 / cell_m))
    probability[n // 2, door] = 0.05
    plan = Planner(robot).plan(estimate, np.array([15.0, 15.0]))
    assert plan.reachable
    assert plan.length_m == pytest.approx(2 * math.hypot(15.0 - (5.0 + 1.0), 5.0), rel=0.05)


def test_a_goal_in_an_obstacle_is_replaced_by_the_nearest_spot_the_hull_reaches():
    """A block of 0.8 m x 0.8 m, the goal 0.1 m inside its near face: the path ends in front of that face.

    The hull may come to 0.1 m of the outermost obstacle centre, at x = 0.625; so the end is near (0.5, 0), within
    two cells, and not inside.
    """
    estimate = floor((-1.0, 0.0, 0.0), walls=[(0.6, -0.4, 1.4, 0.4)])
    plan = Planner().plan(estimate, np.array([0.7, 0.0]))
    assert not plan.reachable
    assert np.hypot(*(plan.goal_xy - [0.5, 0.0])) < 0.1
    assert math.isfinite(plan.length_m)
    np.testing.assert_allclose(plan.path[-1], plan.goal_xy, atol=1e-6)


def test_round_an_obstacle_the_path_is_the_taut_string_about_the_inflated_corner():
    """A wall from below to y = 0.5 between start and goal bounds the length from both sides.

    At least the string about its bare end, at most 10 % more than about the end inflated by the hull.
    """
    estimate = floor((-1.5, -1.0, 0.0), walls=[(-0.05, -2.0, 0.05, 0.5)])
    plan = Planner().plan(estimate, np.array([1.5, -1.0]))
    assert plan.reachable
    bare, inflated = 2 * math.hypot(1.5, 1.475), 2 * math.hypot(1.5, 1.475 + RADIUS_M) + 0.2
    assert bare - 0.1 < plan.length_m < 1.1 * inflated
    assert _gap(estimate, plan.path) >= RADIUS_M - 0.01


@pytest.mark.parametrize("goal", [(30.0, 0.0), (-500.0, 400.0)])
def test_a_goal_off_the_map_gives_a_finite_path(goal):
    """Off the map all is unknown, and the walls are closed: the plan stays inside and is finite."""
    plan = Planner().plan(floor(), np.array(goal))
    assert np.isfinite(plan.path).all()
    assert not plan.reachable
    assert np.abs(plan.path[-1]).max() < 3.0


def _niche(pose) -> MapEstimate:
    """A hall, off which a niche leads along +x from x = 0: 0.3 m wide, 1.5 m deep, 5 cm on each side of the hull."""
    return floor(pose, walls=[(0.0, -2.0, 1.5, -0.1), (0.0, 0.15, 1.5, 2.0)])


def test_a_goal_to_be_looked_at_is_looked_at_from_where_the_hull_can_turn():
    """The goal is 0.7 m deep in a niche with 5 cm on each side of the hull: the path ends before it, in its line."""
    estimate, goal = _niche((-1.5, 0.0, 0.0)), np.array([0.7, 0.02])
    into, look = Planner().plan(estimate, goal), Planner().plan(estimate, goal, look=True)
    np.testing.assert_allclose(into.path[-1], goal, atol=0.03)
    assert 0.0 < -look.path[-1][0] < 0.31
    assert look.length_m == pytest.approx(_length(look.path))
    assert float(look.clearance.at(look.path[-1])) >= RADIUS_M + 0.1 - 0.01
    np.testing.assert_array_equal(look.asked_xy, goal)


def test_in_the_open_a_goal_is_looked_at_from_itself():
    """There is room everywhere, so nothing is cut off."""
    plan = Planner().plan(floor(), np.array([1.5, 1.2]), look=True)
    np.testing.assert_allclose(plan.path[-1], [1.5, 1.2], atol=1e-9)


def test_on_an_empty_map_the_path_is_straight():
    """All unknown: passable, so the straight line."""
    frame = GridFrame(origin_xy=(-4.0, -4.0), shape=(160, 160))
    nothing = np.zeros(frame.shape, bool)
    estimate = MapEstimate(
        frame=frame,
        obstacle_probability=np.full(frame.shape, 0.5, np.float32),
        explored=nothing,
        blocked=nothing,
        pose=np.zeros(3),
    )
    plan = Planner().plan(estimate, np.array([2.0, 1.0]))
    assert plan.reachable
    assert plan.length_m == pytest.approx(math.hypot(2, 1), rel=0.02)


def test_a_robot_inside_an_obstacle_is_let_out():
    """The map errs by 5 cm at a wall: a path out exists all the same."""
    plan = Planner().plan(floor((0.0, 1.93, 0.0)), np.array([0.0, 0.0]))
    assert plan.reachable
    assert math.isfinite(plan.length_m)


def test_along_the_path_the_rest_gets_shorter():
    """Carried along its own path, the planner keeps to it: each 0.1 m less by 0.1 m, within 3 cm."""
    estimate, planner, goal = divided(10), Planner(), np.array([1.5, 0.8])
    plan = planner.plan(estimate, goal)
    points = _samples(plan.path)
    arc_length = np.append(0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    for s in np.arange(0.1, arc_length[-1] - 0.2, 0.1):
        here = points[np.searchsorted(arc_length, s)]
        now = planner.plan(at_pose(estimate, (*here, 0.0)), goal)
        assert now.reachable
        assert now.length_m == pytest.approx(arc_length[-1] - s, abs=0.06)


def test_a_goal_that_is_not_finite_is_rejected():
    """Not planned for."""
    with pytest.raises(ValueError, match="goal_xy"):
        Planner().plan(floor(), np.array([math.nan, 0.0]))


def test_the_same_map_gives_the_same_plan():
    """Bit for bit, with a planner used before and reset."""
    planner = Planner()
    planner.plan(floor(), np.array([1.0, 1.0]))
    planner.reset()
    goal = np.array([1.5, 0.1])
    first, second = planner.plan(divided(6), goal), Planner().plan(divided(6), goal)
    np.testing.assert_array_equal(first.path, second.path)


def _driven(estimate: MapEstimate, goal: np.ndarray, decisions: int) -> np.ndarray:
    """Places of a robot that moves by a quarter metre along each plan."""
    planner, places = Planner(), [estimate.pose[:2]]
    for _ in range(decisions):
        plan = planner.plan(at_pose(estimate, (*places[-1], 0.0)), goal)
        step = plan.path[1] - plan.path[0]
        gap = float(np.hypot(*step))
        places.append(places[-1] + step * min(1.0, 0.25 / max(gap, 1e-9)))
        if np.hypot(*(places[-1] - goal)) < 0.1:
            break
    return np.array(places)


def test_a_neck_that_only_coarse_cells_pass_is_not_tried_again_and_again():
    """On the straight path stands a wall with a gap of 0.2 m, which the hull fills; a door is 12 m aside.

    From far off, on cells twice as large, the gap looks open; before it, it is not. The robot goes there once at most:
    7 m to the gap, 12 m to the door, 14 m from there.
    """
    wall = [(0.0, -10.0, 0.05, -4.1), (0.0, -3.95, 0.05, 8.0)]
    estimate = floor((-7.0, -4.0, 0.0), low_xy=(-10.0, -10.0), size_m=(20.0, 20.0), walls=wall)
    goal = np.array([7.0, -4.0])
    places = _driven(estimate, goal, 400)
    assert np.hypot(*(places[-1] - goal)) < 0.1
    assert _length(places) < 35
