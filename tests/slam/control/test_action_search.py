"""Sequences of actions for polygons: clear by exact intersection, through doors that a turn and a run do not pass."""

import math

import numpy as np
import pytest
import shapely
from jaxtyping import Float

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.control.action_search import LEAST_M, find_actions, is_clear
from slam.control.controller import Controller
from slam.grid import MapEstimate
from slam.planning.clearance import Clearance
from slam.planning.planner import Planner
from slam.poses import compose, to_map
from slam.robot import Robot
from tests.slam.floors import at_pose, divided, floor

#: Twice as long as wide; obstacles are the centres of cells, so a door of n cells is n + 1 cells wide.
ROBOT = Robot(outline_m=((-0.35, -0.18), (0.35, -0.18), (0.35, 0.18), (-0.35, 0.18)))
HULL = ROBOT.hull
MOTION = np.array([[FORWARD_M, 0, 0], [0, 0, TURN_RAD], [0, 0, -TURN_RAD], [-FORWARD_M, 0, 0]])
GOAL = np.array([1.5, 0.6])


def _planner() -> Planner:
    return Planner(ROBOT)


def _smallest_space(estimate: MapEstimate, poses: Float[np.ndarray, "n 3"]) -> float:
    """Least distance of the polygon, less the error of maps, from a centre of an obstacle; 0 if one is inside [m]."""
    points = shapely.multipoints(estimate.frame.centres(estimate.obstacle_probability > 0.5))
    return float(
        min(
            shapely.distance(shapely.Polygon(to_map(pose, HULL.corners)).buffer(LEAST_M), points)
            for pose in poses
        )
    )


@pytest.mark.parametrize("start", [(-1.5, -0.4, 0.0), (-1.4, 0.9, 2.0), (-0.8, -1.0, -1.5)])
def test_a_rectangle_drives_through_a_door_4_cm_wider(start: tuple[float, float, float]) -> None:
    """The door is 0.4 m wide, 7 cells and their rim. Every pose of the drive is clear but for 5 mm."""
    estimate = divided(7, start)
    planner, controller = _planner(), Controller(ROBOT)
    pose, poses = estimate.pose, [estimate.pose]
    for _ in range(80):
        plan = planner.plan(at_pose(estimate, pose), GOAL)
        if plan.length_m < 0.2:
            break
        motion = MOTION[controller.act(pose, plan)]
        poses += [compose(pose, part * motion) for part in (0.25, 0.5, 0.75, 1.0)]
        pose = poses[-1]
    assert math.dist(pose[:2], GOAL) < 0.3
    assert _smallest_space(estimate, np.array(poses)) > 0


def test_it_stops_before_a_door_that_is_too_narrow() -> None:
    """A door of 0.35 m is narrower than the hull: no sequence leads into it."""
    estimate = divided(6, (-0.8, 0.15, 0.0))
    plan = _planner().plan(estimate, GOAL)
    clearance = Clearance.around(estimate, 3.0)
    actions = find_actions(estimate.pose, MOTION, HULL, clearance, plan.field, forward_m=FORWARD_M)
    pose = estimate.pose
    for action in actions:
        pose = compose(pose, MOTION[action])
    assert pose[0] < 0.0 and is_clear(estimate.pose, actions, MOTION, HULL, clearance)


def test_actions_that_meet_something_are_not_clear() -> None:
    clearance = Clearance.around(floor(walls=[(0.7, -1.0, 0.9, 1.0)]), 3.0)
    ahead = [Action.FORWARD]
    assert is_clear(np.zeros(3), ahead, MOTION, HULL, clearance)
    assert not is_clear(np.zeros(3), ahead * 2, MOTION, HULL, clearance)
    # A hull that is in an obstacle may move out of it, but not further in.
    inside = np.array([0.5, 0.0, 0.0])
    assert is_clear(inside, [Action.BACKWARD], MOTION, HULL, clearance)
    assert not is_clear(inside, ahead, MOTION, HULL, clearance)
