"""Mapper, explorer, planner and controller together go on deciding when the senses fail, and after.

A room in closed form, exact motion, odometry with the noise of the published robot. Whatever the camera shows, every
goal and the whole map stay finite, and the pose is no worse than odometry alone would have it.
"""

import math

import numpy as np
import pytest

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.control.controller import Controller
from slam.exploration.explorer import FrontierExplorer
from slam.mapping.classical import ClassicalMapper
from slam.planning.planner import Planner
from slam.poses import compose
from tests.slam.rooms import Room

MOTION = np.array([[FORWARD_M, 0, 0], [0, 0, TURN_RAD], [0, 0, -TURN_RAD]])
ROOM = Room()


class Loop:
    """A robot that explores the room."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(0)
        self.mapper, self.explorer = ClassicalMapper(), FrontierExplorer()
        self.planner, self.controller = Planner(), Controller()
        self.pose = np.array([-1.0, -0.5, 0.3])
        self.mapper.reset(self.pose)
        self.estimate = self.mapper.update(ROOM.depth(self.pose, size=48))

    def decide(self, *, see=lambda depth: depth, action: Action | None = None) -> None:
        """One decision; `see` spoils the picture, `action` is forced on the robot."""
        goal = self.explorer.goal(self.estimate)
        goal = np.zeros(2) if goal is None else goal
        assert np.isfinite(goal).all()
        chosen = self.controller.act(self.estimate.pose, self.planner.plan(self.estimate, goal))
        action = chosen if action is None else action
        after = compose(self.pose, MOTION[action])
        if (np.abs(after[:2]) < [2.88, 1.88]).all():
            displacement, self.pose = MOTION[action], after
        else:
            displacement = np.zeros(3)
        odometry = displacement + self.rng.normal(0, [0.004, 0.004, 0.003])
        depth = see(ROOM.depth(self.pose, size=48))
        self.estimate = self.mapper.update(depth, action, odometry)
        assert np.isfinite(self.estimate.pose).all()
        assert np.isfinite(self.estimate.obstacle_probability).all()

    @property
    def off_m(self) -> float:
        return math.hypot(*(self.estimate.pose - self.pose)[:2])


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_darkness_comes_and_goes(value):
    """30 decisions with no depth at all in the middle of exploring: off by at most 0.15 m then, 0.05 m soon after."""
    loop = Loop()
    for _ in range(25):
        loop.decide()
    for _ in range(30):
        loop.decide(see=lambda depth: np.full_like(depth, value))
    assert loop.off_m < 0.15
    for _ in range(15):
        loop.decide()
    assert loop.off_m < 0.05


def test_a_robot_that_spins_keeps_its_pose():
    """144 turns, four times around, whatever the controller commands: off by at most 3 cm and 1 degree."""
    loop = Loop()
    for _ in range(144):
        loop.decide(action=Action.LEFT)
    assert loop.off_m < 0.03
    off = (loop.estimate.pose[2] - loop.pose[2] + math.pi) % (2 * math.pi) - math.pi
    assert abs(off) < math.radians(1)


def test_noise_instead_of_depth_is_survived():
    """20 pictures of nothing but noise between 0 and 10 m: finite throughout, and on the map again soon after."""
    loop = Loop()
    for _ in range(40):
        loop.decide()
    for _ in range(20):
        loop.decide(see=lambda depth: loop.rng.uniform(0, 10, depth.shape).astype(np.float32))
    for _ in range(30):
        loop.decide()
    assert loop.off_m < 0.1
