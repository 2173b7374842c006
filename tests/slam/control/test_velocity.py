"""Velocities stay within the limits, follow the arcs that are compared, and lead to the goal without contact."""

import math

import numpy as np
import pytest

from slam.actions import Velocity
from slam.control.controller import ControlConfig
from slam.control.velocity import VelocityController
from slam.planning.clearance import Clearance
from slam.planning.planner import Planner
from slam.poses import compose, wrap
from slam.robot import Robot
from tests.slam.floors import at_pose, divided, floor

#: A slow base, which follows late.
SLOW = Robot(max_speed_mps=0.3, max_turn_rate_radps=0.8, max_accel_mps2=0.4, latency_s=0.3)
STEP_S = 0.01


class Base:
    """A base on two wheels, integrated in steps of 10 ms."""

    def __init__(self, pose, robot):
        self.pose, self.robot, self.speeds = np.array(pose, float), robot, np.zeros(2)
        self.waiting = [np.zeros(2)] * round(robot.latency_s / STEP_S)

    def drive(self, command):
        passed = []
        for _ in range(round(command.duration_s / STEP_S)):
            self.waiting.append(np.array(command[:2]))
            change = self.waiting.pop(0) - self.speeds
            rim = abs(change[0]) + abs(change[1]) * self.robot.track_m / 2
            self.speeds = self.speeds + change * min(
                1.0, self.robot.max_accel_mps2 * STEP_S / max(rim, 1e-12)
            )
            v, w = STEP_S * self.speeds
            self.pose = compose(compose(self.pose, np.array([v, 0, w / 2])), np.array([0, 0, w / 2]))
            passed.append(self.pose)
        return passed


def drive(estimate, goal, robot, decisions=80):
    """Commands, and all poses until the robot is 0.15 m from the goal."""
    planner, controller, base = Planner(), VelocityController(robot), Base(estimate.pose, robot)
    commands, poses = [], [estimate.pose]
    while np.hypot(*(base.pose[:2] - goal)) > ControlConfig.arrived_m and len(commands) < decisions:
        commands.append(controller.act(base.pose, planner.plan(at_pose(estimate, base.pose), np.array(goal))))
        poses += base.drive(commands[-1])
    return np.array(commands), np.array(poses)


def test_it_drives_straight_ahead_and_turns_on_the_spot_for_what_is_behind():
    """Full speed without a turn; left ahead a turn to the left; behind no speed, and the full turn rate."""
    commands = []
    for azimuth in (0.0, 0.5, -0.5, 3.0):
        estimate = floor()
        goal = 1.5 * np.array([math.cos(azimuth), math.sin(azimuth)])
        commands.append(VelocityController().act(estimate.pose, Planner().plan(estimate, goal)))
    ahead, left, right, behind = commands
    assert ahead == Velocity(Robot.max_speed_mps, 0.0, ControlConfig.control_s)
    assert left.w_radps > 0 and right.w_radps < 0 and min(left.v_mps, right.v_mps) > 0.1
    assert behind.v_mps == 0 and abs(behind.w_radps) == pytest.approx(ControlConfig.turn_rate_radps)


@pytest.mark.parametrize("robot", [Robot(), SLOW])
@pytest.mark.parametrize("goal", [(1.5, -0.5), (1.0, 1.5), (-2.5, 1.5)])
def test_it_reaches_goals_through_a_door_within_its_limits(robot, goal):
    """To 0.15 m, in at most twice the time that the straight line takes and 4 s; the hull never in a wall.

    The door is 0.4 m wide. Each wheel keeps its speed, and the robot its turn rate.
    """
    estimate = divided(8, (-1.5, -1.0, 0.5))
    commands, poses = drive(estimate, goal, robot)
    assert np.hypot(*(poses[-1, :2] - goal)) < ControlConfig.arrived_m
    straight_s = np.hypot(*(np.array(goal) - poses[0, :2])) / robot.max_speed_mps
    assert STEP_S * len(poses) < 2 * straight_s + 4
    obstacles = estimate.frame.centres(estimate.obstacle)
    assert min(np.hypot(*(obstacles - pose[:2]).T).min() for pose in poses) > robot.hull.radius_m
    v, w = np.abs(commands[:, :2]).T
    assert (v + w * robot.track_m / 2).max() < robot.max_speed_mps + 1e-9
    assert w.max() < min(ControlConfig.turn_rate_radps, robot.turn_rate_radps) + 1e-9


def test_arcs_through_a_wall_are_never_chosen():
    """At full speed towards a wall 0.4 m ahead: a price is infinite where an arc has come nearer than slack allows."""
    estimate = floor((0.0, 0.0, 0.0), walls=[(0.4, -2, 0.5, 2)])
    controller, plan = VelocityController(), Planner().plan(estimate, np.array([0.0, 1.5]))
    config = controller.config
    arcs, distance_m = controller._arcs(estimate.pose, (Robot.max_speed_mps, 0.0))
    space = plan.clearance.space(controller.hull, arcs[..., :2], arcs[..., 2])
    too_near = np.minimum.accumulate(space, axis=1)[:, controller._first :] < config.slacks_m[0]
    assert 0.2 < too_near.mean() < 0.9
    np.testing.assert_array_equal(np.isinf(controller._price(arcs, distance_m, plan)), too_near)


def test_a_hull_with_corners_backs_out_of_where_it_cannot_turn():
    """36 cm by 20 cm with its nose in a niche 30 cm wide; the goal lies behind: it arrives, and touches nothing.

    It drives backward until it can turn, and turns once.
    """
    outline = ((-0.18, -0.1), (0.18, -0.1), (0.18, 0.1), (-0.18, 0.1))
    robot = Robot(outline_m=outline)
    estimate = floor((0.25, 0.0, 0.0), walls=[(0, 0.15, 0.6, 1), (0, -1, 0.6, -0.15), (0.5, -1, 0.6, 1)])
    commands, poses = drive(estimate, (-2.0, 0.2), robot)
    assert np.hypot(*(poses[-1, :2] - (-2.0, 0.2))) < ControlConfig.arrived_m
    assert commands[0, 0] < 0 and (commands[-4:, 0] > 0.2).all()
    assert Clearance.around(estimate, 4.0).space(robot.hull, poses[:, :2], poses[:, 2]).min() > 0


@pytest.mark.parametrize("robot", [Robot(), SLOW])
def test_the_base_follows_the_arcs_that_are_compared(robot):
    """From rest and from full speed, all candidates for a second: within 1 cm and 0.02 rad (0.0054, 0.013)."""
    controller = VelocityController(robot)
    worst = np.zeros(3)
    for before in (None, Velocity(robot.max_speed_mps, 0.0, 2.0)):
        controller.reset()
        base = Base((0.3, 0.2, 1.0), robot)
        if before is not None:
            base.drive(before)
            controller._command = controller._speeds = before[:2]
        arcs, _ = controller._arcs(controller._at_next_command(base.pose), controller._speeds)
        for v, w, arc in zip(controller._v, controller._w, arcs, strict=True):
            own = Base(base.pose, robot)
            own.speeds, own.waiting = base.speeds.copy(), list(base.waiting)
            off = own.drive(Velocity(v, w, robot.latency_s + 1.0))[-1] - arc[7]
            worst = np.maximum(worst, np.abs([*off[:2], wrap(off[2])]))
    assert worst[:2].max() < 0.01 and worst[2] < 0.02


def test_at_the_end_it_turns_to_the_goal_and_looks_around():
    """Next to an unreachable goal: to it at first, then with the full turn rate, in one direction; it never drives."""
    estimate = floor((1.2, 0.0, 0.0), walls=[(1.0, 0.4, 1.5, 0.9)])
    planner, controller, base = Planner(), VelocityController(), Base(estimate.pose, Robot())
    goal, commands, yaws = np.array([1.25, 0.65]), [], []
    end = planner.plan(estimate, goal).path[-1]
    base.pose = np.array([*end, -0.5])
    for _ in range(24):
        commands.append(controller.act(base.pose, planner.plan(at_pose(estimate, base.pose), goal)))
        yaws.append(base.drive(commands[-1])[-1][2])
    v, w, _ = np.array(commands).T
    assert (v == 0).all() and (w[-14:] == w[-1]).all()
    assert abs(w[-1]) == pytest.approx(ControlConfig().turn_rate_radps)
    assert abs(np.unwrap(yaws)[-1] - yaws[9]) > 2 * math.pi


def test_a_robot_that_gets_nowhere_drives_to_where_there_is_room():
    """Held in place in a niche: after 45 decisions it turns to the open side, and drives slowly."""
    estimate = floor((0.0, 0.0, 0.0), walls=[(0.2, -1, 0.5, 1), (-1, 0.2, 0.5, 0.5), (-1, -0.5, 0.5, -0.2)])
    controller, plan = VelocityController(), Planner().plan(estimate, np.array([1.5, 0.0]))
    pose, speeds = estimate.pose, []
    for _ in range(70):
        command = controller.act(pose, plan)
        pose = pose + np.array([0, 0, 0.5 * command.w_radps])  # its wheels slip
        speeds.append(command.v_mps)
        if len(speeds) > 45 and command.v_mps:
            break
    assert speeds[-1] == pytest.approx(0.2) and abs(wrap(pose[2] - math.pi)) < math.radians(25)
