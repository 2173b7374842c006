"""Turns of a base that does not turn about its middle: where they lead, and that they spare the hull."""

import math

import numpy as np
import pytest

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.control.controller import ControlConfig, Controller
from slam.control.manoeuvre import pushes, swung, turns_round
from slam.hull import Hull
from slam.planning.clearance import Clearance
from slam.planning.planner import Planner
from tests.slam.floors import floor, robot_of

#: What actions of a base do that swings 2 cm to the side with each turn of 10 degrees.
SWING_M = 0.02
SWINGS = (
    (FORWARD_M, 0.0, 0.0),
    (0.0, SWING_M, TURN_RAD),
    (0.0, -SWING_M, -TURN_RAD),
    (-FORWARD_M, 0.0, 0.0),
)


def _around(estimate) -> Clearance:
    return Clearance.around(estimate, 2.0)


def _looks(walls, motions=SWINGS, yaw=0.0) -> Action:
    """First action of a robot at the origin whose goal is where it stands."""
    estimate = floor((0.0, 0.0, yaw), walls=walls)
    plan = Planner().plan(estimate, estimate.pose[:2])
    return Controller(robot_of(motions)).act(estimate.pose, plan)


def test_turns_go_round_a_circle():
    """36 turns end where they began; the farthest place lies across the circle, of diameter d / sin(10 deg / 2)."""
    pose = np.array([1.0, 2.0, 0.7])
    poses = swung(pose, np.array(SWINGS[Action.LEFT]), turns_round(TURN_RAD))
    assert len(poses) == 37
    assert np.allclose(poses[-1, :2], pose[:2], atol=1e-12)
    far_m = np.hypot(*(poses[:, :2] - pose[:2]).T).max()
    assert far_m == pytest.approx(SWING_M / math.sin(TURN_RAD / 2), rel=1e-12)


def test_turns_push_where_they_bring_the_hull_nearer_than_its_room():
    """A wall to the left: compared turn by turn with the wall's cells; turns to the right push nowhere.

    The turns that push are among the first nine: after a quarter round the circle leads away from the wall.
    """
    estimate = floor(walls=[(-1.0, 0.15, 1.0, 0.2)])
    poses = swung(estimate.pose, np.array(SWINGS[Action.LEFT]), 18)
    wall = np.column_stack([np.arange(-0.975, 1.0, 0.05), np.full(40, 0.175)])
    room = np.hypot(*(poses[:, None, :2] - wall).transpose(2, 0, 1)).min(axis=1) - 0.1
    expected = [room[k + 1] < 0.005 and room[k + 1] < room[k] - 0.002 for k in range(18)]
    pushed = pushes(poses, _around(estimate), Hull(0.1))
    assert np.array_equal(np.diff(pushed), expected)
    assert 4 <= sum(expected[:10]) == sum(expected)
    assert not pushes(
        swung(estimate.pose, np.array(SWINGS[Action.RIGHT]), 18), _around(estimate), Hull(0.1)
    ).any()


def test_it_looks_around_to_the_side_that_is_free():
    """To the left in the open, and where the base does not swing. By a wall it sees all round, and pushes nowhere."""
    wall = [(-2.5, 0.15, 2.5, 0.2)]
    assert _looks([]) is Action.LEFT
    in_place = (SWINGS[0], (0.0, 0.0, TURN_RAD), (0.0, 0.0, -TURN_RAD), SWINGS[3])
    assert _looks(wall, in_place) is Action.LEFT
    controller, pose, seen = Controller(robot_of(SWINGS)), np.zeros(3), set()
    for _ in range(50):
        estimate = floor(pose, walls=wall)
        action = controller.act(pose, Planner().plan(estimate, np.zeros(2)))
        turned = swung(pose, np.array(SWINGS[action]), 1)
        assert not pushes(turned, _around(estimate), Hull(0.1))[-1]
        pose = turned[-1]
        seen.add(round(pose[2] / TURN_RAD) % 36)
    assert len(seen) == 36


def test_it_steps_out_of_a_niche_before_it_looks_around():
    """Walls on both sides and behind, open floor ahead: forward first. Closed ahead too, it turns where it is."""
    niche = [(-0.2, 0.15, 0.1, 0.2), (-0.2, -0.2, 0.1, -0.15), (-0.25, -0.2, -0.2, 0.2)]
    assert _looks(niche) is Action.FORWARD
    assert _looks([*niche, (0.25, -0.3, 0.3, 0.3)]) is not Action.FORWARD


#: A dead end 0.28 m wide, open towards -x, that begins 0.4 m behind the robot's middle.
DEAD_END = [(-0.4, 0.14, 0.2, 0.2), (-0.4, -0.2, 0.2, -0.14), (0.15, -0.2, 0.2, 0.2)]


def _leaves(reverses: bool, motions=SWINGS) -> tuple[list[Action], int]:
    """What a robot does that stands in the dead end and is to go 2 m behind it, and how often it pushes."""
    controller = Controller(robot_of(motions), ControlConfig(reverses=reverses))
    pose, done, pushed = np.zeros(3), [], 0
    for _ in range(60):
        estimate = floor(pose, walls=DEAD_END)
        plan = Planner().plan(estimate, np.array([-2.0, 0.0]))
        action = controller.act(pose, plan)
        done.append(action)
        turned = swung(pose, np.array(motions[action]), 1)
        if action in (Action.LEFT, Action.RIGHT):
            pushed += int(pushes(turned, _around(estimate), Hull(0.1))[-1])
        pose = turned[-1]
        if np.hypot(*(pose[:2] - (-2.0, 0.0))) < 0.3:
            break
    return done, pushed


def test_it_backs_out_of_a_dead_end_in_which_it_cannot_turn():
    """Once back, some steps on end, and no turn pushes. One that cannot step back pushes in turning."""
    done, pushed = _leaves(reverses=True)
    first, back = done.index(Action.BACKWARD), done.count(Action.BACKWARD)
    assert first <= 4 and 1 <= back <= 4 and done[first : first + back] == [Action.BACKWARD] * back
    assert pushed == 0 and len(done) < 40
    done, pushed = _leaves(reverses=False)
    assert Action.BACKWARD not in done and pushed > 0


def test_a_base_that_turns_about_its_middle_turns_where_it_is():
    in_place = (SWINGS[0], (0.0, 0.0, TURN_RAD), (0.0, 0.0, -TURN_RAD), SWINGS[3])
    done, pushed = _leaves(reverses=True, motions=in_place)
    assert Action.BACKWARD not in done and pushed == 0


def test_it_does_not_back_into_a_wall():
    """Closed on all sides there is nowhere to go back to: it turns where it is."""
    closed = [*DEAD_END, (-0.2, -0.2, -0.15, 0.2)]
    assert _looks(closed) in (Action.LEFT, Action.RIGHT)
