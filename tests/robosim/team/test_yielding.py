"""Yielding to another robot."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robosim.team.yielding import Yielding, turn_along
from slam.actions import Action
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull
from slam.planning.planner import Planner

_HULL = Hull(radius_m=0.1)


def _corridor(pose: tuple[float, float, float]) -> MapEstimate:
    """A room of 4 m with a corridor of 0.5 m to its right, with the robot in it."""
    probability = np.full((80, 160), 0.95, np.float32)
    probability[2:78, 2:80] = 0.05
    probability[35:45, 80:158] = 0.05
    return MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.05, shape=probability.shape),
        obstacle_probability=probability,
        explored=np.ones(probability.shape, bool),
        blocked=np.zeros(probability.shape, bool),
        pose=np.array(pose),
    )


#: Path of a robot that comes along the corridor, and goes to the left end of the room.
_PATH = np.array([[5.4, 2.0], [1.0, 2.0]])


def _place(
    yielding: Yielding,
    waited: int,
    path: np.ndarray = _PATH,
    another: bool = False,
    here: tuple[float, float] = (4.9, 2.0),
) -> np.ndarray | None:
    estimate = _corridor((*here, 0.0))
    return yielding.place(waited, estimate, [(path, 0.1)], another=another, receives=True)


def test_yielding_goes_to_a_place_next_to_the_path() -> None:
    place = _place(Yielding(0, _HULL), 3)
    assert place is not None
    assert place[0] < 4.0  # out of the corridor
    assert abs(place[1] - 2.0) >= 0.2 + 0.3


def test_yielding_waits_first_and_later_robots_longer() -> None:
    assert _place(Yielding(0, _HULL), 2) is None
    assert _place(Yielding(1, _HULL), 3) is None
    assert _place(Yielding(1, _HULL), 8) is not None


def test_yielding_in_a_dead_end_is_left_to_the_other_at_first() -> None:
    """There is no place with room for the other to pass; it has one, and begins before this robot goes anywhere."""
    into = np.array([[5.0, 2.0], [7.8, 2.0]])
    assert _place(Yielding(0, _HULL), 9, into, here=(6.0, 2.0)) is None
    assert _place(Yielding(1, _HULL), 9, np.array([[6.0, 2.0], [1.0, 2.0]]), here=(5.0, 2.0)) is not None
    assert _place(Yielding(0, _HULL), 23, into, here=(6.0, 2.0)) is not None


def test_yielding_is_left_to_another() -> None:
    assert _place(Yielding(0, _HULL), 9, another=True) is None


def test_yielding_ends_once_the_other_has_passed() -> None:
    yielding = Yielding(0, _HULL)
    assert _place(yielding, 3) is not None
    assert _place(yielding, 0) is not None
    assert _place(yielding, 0, path=np.array([[1.2, 2.0], [1.0, 2.0]])) is None


@pytest.mark.parametrize(("waited", "decisions"), [(1, 25), (0, 100)])
def test_yielding_ends_after_a_while_and_later_if_the_robot_is_not_blocked(
    waited: int, decisions: int
) -> None:
    yielding = Yielding(0, _HULL)
    places = [_place(yielding, 3 if k == 0 else waited) for k in range(decisions + 1)]
    assert all(place is not None for place in places[:-1]) and places[-1] is None


def test_yielding_of_a_robot_with_nothing_to_do_begins_at_once() -> None:
    assert _place(Yielding(3, _HULL), math.inf) is not None


def _back(yielding: Yielding, pose: tuple[float, float, float], goal: tuple[float, float]) -> Action | None:
    estimate = _corridor(pose)
    return yielding.back_along(estimate.pose, Planner().plan(estimate, np.array(goal)))


def test_back_along_turns_the_back_to_the_path_and_steps_back() -> None:
    """The robot looks along the corridor, away from the room that it is to go back to."""
    yielding, room = Yielding(0, _HULL), (3.0, 2.0)
    assert _back(yielding, (5.0, 2.0, 0.0), room) is Action.BACKWARD
    assert _back(yielding, (5.0, 2.0, 0.3), room) is Action.RIGHT
    assert _back(yielding, (5.0, 2.0, -0.3), room) is Action.LEFT
    assert _back(yielding, (5.0, 2.0, 3.0), room) is None


def test_back_along_turns_round_to_the_end_where_a_step_back_is_too_tight() -> None:
    """1.5 cm from the wall, which a step back would come to."""
    yielding, estimate = Yielding(0, _HULL), _corridor((5.0, 1.84, 0.08))
    plan = replace(Planner().plan(estimate, np.array((4.0, 1.84))), path=np.array([[5.0, 1.84], [4.0, 1.84]]))
    along_wall = np.array([5.0, 1.84, -0.02])
    assert yielding.back_along(along_wall, plan) is Action.BACKWARD
    assert yielding.back_along(estimate.pose, plan) is None
    assert yielding.back_along(along_wall, plan) is None


def test_yielding_ends_sooner_if_the_other_does_not_come_nearer() -> None:
    """Once the robot is in its place it stays for few decisions, and for long while the other approaches."""

    def stays(step_m: float) -> int:
        yielding = Yielding(0, _HULL)
        place = _place(yielding, 3)
        assert place is not None
        here = float(place[0]), float(place[1])
        paths = [np.array([[5.4 - step_m * k, 2.0], [1.0, 2.0]]) for k in range(1, 40)]
        return [_place(yielding, 0, path, here=here) is None for path in paths].index(True)

    assert stays(0.0) < 8
    assert stays(0.03) > 15


def test_yielding_does_not_begin_for_a_robot_that_goes_away() -> None:
    """It stands near, but its path leads on along the corridor."""
    assert _place(Yielding(0, _HULL), 9, np.array([[5.4, 2.0], [7.5, 2.0]])) is None


def test_turn_along_turns_to_the_nearer_side() -> None:
    pose = np.array([0.0, 0.0, 0.0])
    assert turn_along(pose, np.array([[0.0, 0.0], [0.0, 1.0]])) is Action.LEFT
    assert turn_along(pose, np.array([[0.0, 0.0], [0.0, -1.0]])) is Action.RIGHT
    assert turn_along(pose, np.array([[0.0, 0.0], [1.0, 0.0]])) is Action.WAIT
    assert turn_along(pose, np.array([[0.0, 0.0]])) is Action.WAIT
