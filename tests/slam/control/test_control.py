"""The controller turns and drives as planned, repeats itself exactly, and does not bump forever."""

import itertools
import math

import numpy as np
import pytest

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.control.controller import Controller
from slam.planning.planner import Planner
from slam.poses import compose
from tests.slam.floors import at_pose, divided, floor, robot_of

MOTION = np.array([[FORWARD_M, 0, 0], [0, 0, TURN_RAD], [0, 0, -TURN_RAD]])


def _act(pose, goal, controller=None):
    estimate = floor(pose)
    plan = Planner().plan(estimate, np.array(goal))
    return (controller or Controller()).act(estimate.pose, plan)


def _follow(estimate, goal, decisions, blocked=lambda pose, after: False):
    """Poses and actions of a robot that carries actions out exactly, unless it is stopped."""
    planner, controller, pose = Planner(), Controller(), estimate.pose
    poses, actions = [pose], []
    for _ in range(decisions):
        plan = planner.plan(at_pose(estimate, pose), np.array(goal))
        action = controller.act(pose, plan)
        after = compose(pose, MOTION[action])
        pose = pose if blocked(pose, after) else after
        poses.append(pose)
        actions.append(action)
    return np.array(poses), actions


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, -math.pi, -1.0])
def test_facing_the_goal_in_the_open_it_goes_forward(yaw):
    """1.5 m away, straight ahead."""
    goal = (1.5 * math.cos(yaw), 1.5 * math.sin(yaw))
    assert _act((0.0, 0.0, yaw), goal) is Action.FORWARD


@pytest.mark.parametrize(
    ("azimuth_deg", "expected"),
    [(90, {Action.LEFT}), (-90, {Action.RIGHT}), (180, {Action.LEFT, Action.RIGHT})],
)
def test_it_turns_to_the_side_of_the_goal(azimuth_deg, expected):
    """Left of it left, right of it right; behind, one of the two."""
    a = math.radians(azimuth_deg)
    assert _act((0.0, 0.0, 0.0), (1.5 * math.cos(a), 1.5 * math.sin(a))) in expected


@pytest.mark.parametrize("goal", [(1.5, 0.0), (-1.5, 0.0), (0.3, -1.4), (-1.0, 1.0)])
def test_the_same_input_gives_the_same_action(goal):
    """From fresh controllers, and after a reset."""
    used = Controller()
    for _ in range(3):
        _act((0.2, 0.1, 1.0), (-1.0, 0.5), used)
    used.reset()
    assert _act((0.1, 0.0, 0.3), goal) is _act((0.1, 0.0, 0.3), goal) is _act((0.1, 0.0, 0.3), goal, used)


def test_a_goal_behind_is_reached_without_turning_to_and_fro():
    """Half a turn is 18 turns, 1.5 m are 6 steps: at most 30 decisions, and never left then right at once."""
    poses, actions = _follow(floor((0.5, 0.0, 0.0)), (-1.0, 0.0), 30)
    assert np.hypot(*(poses[:, :2] - [-1.0, 0.0]).T).min() < 0.2
    arrived = int(np.argmax(np.hypot(*(poses[:, :2] - [-1.0, 0.0]).T) < 0.2))
    for a, b in itertools.pairwise(actions[:arrived]):
        assert {a, b} != {Action.LEFT, Action.RIGHT}


def test_it_drives_through_a_door_without_touching_it():
    """A door 0.45 m wide off the straight line: arrived within 60 decisions, the hull never in an obstacle's centre."""
    estimate = divided(8, (-1.5, -1.0, 0.5))
    poses, _ = _follow(estimate, (1.5, -0.5), 60)
    assert np.hypot(*(poses[:, :2] - [1.5, -0.5]).T).min() < 0.2
    obstacles = estimate.frame.centres(estimate.obstacle)
    points = np.concatenate([np.linspace(a, b, 6)[:, :2] for a, b in itertools.pairwise(poses)])
    assert np.hypot(*(points[:, None] - obstacles[None]).transpose(2, 0, 1)).min() > 0.09


def test_after_repeated_bumps_it_tries_something_else():
    """An invisible wall at x = 0.3, 0.6 m wide, that the map never shows: it does not push against it for ever."""

    def invisible(pose, after):
        return after[0] > 0.3 and pose[0] <= 0.3 and abs(after[1]) < 0.3

    poses, actions = _follow(floor((0.0, 0.0, 0.0)), (2.0, 0.0), 40, invisible)
    still = np.hypot(*np.diff(poses[:, :2], axis=0).T) < 1e-9
    pushes = int((still & (np.array(actions) == Action.FORWARD)).sum())
    assert 1 <= pushes < 20
    assert len(set(actions)) > 1
    assert np.abs(poses[:, 1]).max() > 0.05


def test_an_action_that_was_not_done_is_no_bump():
    """Twenty waits instead of steps on a free floor: it goes on straight ahead, where bumps would turn it away."""
    chosen = {}
    for withdrawn in (True, False):
        controller = Controller()
        chosen[withdrawn] = []
        for _ in range(20):
            chosen[withdrawn].append(_act((0.0, 0.0, 0.0), (2.0, 0.0), controller))
            if withdrawn:
                controller.withdraw()
    assert set(chosen[True]) == {Action.FORWARD}
    assert set(chosen[False]) > {Action.FORWARD}


#: A base that turns about a point 0.1 m behind its middle, as the one does on which the noise was measured.
SWINGS = ((0.245, 0.0, 0.0), (-0.0015, 0.0196, 0.1965), (-0.0008, -0.0195, -0.1936))


def test_it_begins_with_what_its_actions_do():
    """As a calibration found; what is no such action at all is not believed."""
    np.testing.assert_array_equal(Controller(robot_of(SWINGS)).motion[:3], SWINGS)
    senseless = ((0.0, 0.0, 0.0), SWINGS[2], None)
    np.testing.assert_array_equal(Controller(robot_of(senseless)).motion[:3], MOTION)


def test_a_turn_that_is_stopped_teaches_nothing():
    """A robot that swings against a wall at each turn still knows, after 20 of them, that the turn swings it."""
    controller, planner = Controller(robot_of(SWINGS)), Planner()
    estimate = floor((0.0, 0.0, 0.0))
    pose, goal = estimate.pose, np.array([0.0, -1.5])
    for _ in range(20):
        action = controller.act(pose, planner.plan(at_pose(estimate, pose), goal))
        # It turns on the spot, whatever the command: its hull leans against something.
        pose = pose + np.array([0.0, 0.0, SWINGS[action][2]])
        goal = pose[:2] + 1.5 * np.array([np.sin(pose[2]), -np.cos(pose[2])])
    np.testing.assert_allclose(controller.motion[[1, 2]], np.array(SWINGS)[[1, 2]], atol=1e-9)


def test_it_does_not_swing_into_a_wall():
    """Its right side 5 mm from a wall, the goal half right behind: not by turning right, as it would with no wall."""
    for swings, side, into in ((SWINGS, -1, Action.RIGHT), (_mirrored(SWINGS), 1, Action.LEFT)):
        goal = np.array([-1.0, 0.1 * side])
        wall = (-3.0, -2.0, 3.0, -0.105) if side < 0 else (-3.0, 0.105, 3.0, 2.0)
        chosen = []
        for walls in ([], [wall]):
            estimate = floor((0.0, 0.0, 0.0), walls=walls)
            plan = Planner().plan(estimate, goal)
            chosen.append(Controller(robot_of(swings)).act(estimate.pose, plan))
        assert chosen[0] is into
        assert chosen[1] is not into


def _mirrored(motions):
    """What a base does that is the other's mirror image, left for right."""
    forward, left, right = (tuple(np.array(one) * [1, -1, -1]) for one in motions)
    return forward, right, left
