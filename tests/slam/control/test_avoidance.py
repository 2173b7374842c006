"""Steps among people: closed cases, and that a robot which waits or leaves is never held."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from slam.actions import FORWARD_M, Action, Velocity
from slam.control.avoidance import Avoidance, AvoidanceConfig
from slam.grid import GridFrame, MapEstimate, MovingThing
from slam.odometry import ActionError, OdometryConfig
from slam.robot import Robot

CONFIG = AvoidanceConfig()
LEAST_M = Robot().hull.radius_m + CONFIG.body_m + CONFIG.distance_m


def estimate(
    *things: tuple[float, float, float, float], yaw: float = 0.0, velocity_std_mps: float = 0.3
) -> MapEstimate:
    shape = (80, 80)
    return MapEstimate(
        frame=GridFrame(origin_xy=(-2.0, -2.0), resolution_m=0.05, shape=shape),
        obstacle_probability=np.full(shape, 0.1, np.float32),
        explored=np.ones(shape, bool),
        blocked=np.zeros(shape, bool),
        pose=np.array([0.0, 0.0, yaw]),
        moving=tuple(
            MovingThing(
                xy=np.array([x, y]),
                velocity=np.array([vx, vy]),
                covariance=np.diag([0.01, 0.01, velocity_std_mps**2, velocity_std_mps**2]),
                stood_s=10.0 if vx == vy == 0 else 0.0,
                unseen_s=0.0,
                number=k,
            )
            for k, (x, y, vx, vy) in enumerate(things)
        ),
    )


def test_a_step_towards_a_person_is_a_wait_from_the_distance_on():
    for gap_m, expected in ((0.01, Action.FORWARD), (-0.01, Action.WAIT)):
        ahead = estimate((LEAST_M + FORWARD_M + gap_m, 0.0, 0.0, 0.0))
        assert Avoidance().checked(ahead, Action.FORWARD) is expected


def test_a_velocity_is_a_step_of_a_second():
    """0.25 m/s ahead is a step forward; turning on the spot and standing are never stopped."""
    for gap_m, waits in ((0.01, False), (-0.01, True)):
        ahead = estimate((LEAST_M + FORWARD_M + gap_m, 0.0, 0.0, 0.0))
        for w in (0.0, 1.0):
            turned = replace(ahead, pose=np.array([0.0, 0.0, -w / 2]))
            command = Velocity(0.25, w, 0.5)
            assert Avoidance().checked(turned, command) == (Action.WAIT if waits else command)
        assert Avoidance().checked(ahead, Velocity(0.0, 1.0, 0.5)) == Velocity(0.0, 1.0, 0.5)


def test_a_person_who_crosses_is_waited_for_and_one_who_passes_behind_is_not():
    crossing, behind = estimate((0.6, 0.9, 0.0, -1.0)), estimate((-0.6, 0.9, 0.0, -1.0))
    assert Avoidance().checked(crossing, Action.FORWARD) is Action.WAIT
    assert Avoidance().checked(behind, Action.FORWARD) is Action.FORWARD
    assert Avoidance().checked(behind, Action.BACKWARD) is Action.WAIT


def test_somebody_who_has_just_come_into_view_may_approach():
    """By half a standard deviation of the velocity, 0.7 m/s, in the second that a step takes."""
    for gap_m, expected in ((0.36, Action.FORWARD), (0.34, Action.WAIT)):
        ahead = estimate((LEAST_M + FORWARD_M + gap_m, 0.0, 0.0, 0.0), velocity_std_mps=0.7)
        assert Avoidance().checked(ahead, Action.FORWARD) is expected


def test_turns_are_free():
    near = estimate((0.4, 0.0, 0.0, 0.0))
    for action in (Action.LEFT, Action.RIGHT, Action.WAIT):
        assert Avoidance().checked(near, action) is action


def test_a_turn_that_would_swing_the_hull_into_another_robot_is_made_to_the_other_side():
    """A turn to the left moves the base by 2 cm to its left, and one to the right as far to its right."""
    left, right = (ActionError(motion=(0.0, side * 0.02, side * 0.17)) for side in (1, -1))
    avoidance = Avoidance(Robot(odometry=OdometryConfig(left=left, right=right)))

    def robots(*ys: float) -> MapEstimate:
        near = estimate(*((0.0, y, 0.0, 0.0) for y in ys))
        return replace(near, moving=tuple(replace(thing, radius_m=0.1) for thing in near.moving))

    assert avoidance.checked(robots(0.22), Action.LEFT) is Action.RIGHT
    assert avoidance.checked(robots(0.22), Action.RIGHT) is Action.RIGHT
    assert avoidance.checked(robots(-0.22), Action.RIGHT) is Action.LEFT
    assert avoidance.checked(robots(0.22, -0.22), Action.LEFT) is Action.WAIT
    assert avoidance.checked(robots(0.30), Action.LEFT) is Action.LEFT
    assert avoidance.checked(estimate((0.0, 0.22, 0.0, 0.0)), Action.LEFT) is Action.LEFT


@given(st.floats(-math.pi, math.pi), st.floats(0.05, 2.0), st.floats(-math.pi, math.pi))
def test_a_step_away_from_somebody_who_stands_is_always_allowed(bearing, distance_m, yaw):
    """A robot that a person has come near to can leave."""
    place = distance_m * np.array([math.cos(bearing), math.sin(bearing)])
    away = abs((bearing - yaw + math.pi) % (2 * math.pi) - math.pi) > math.radians(91)
    chosen = Avoidance().checked(estimate((*place, 0.0, 0.0), yaw=yaw), Action.FORWARD)
    if away:
        assert chosen is Action.FORWARD


def test_a_robot_that_has_waited_passes_with_less_distance():
    """Four waits before a person 8 cm off its path, then it goes."""
    aside = estimate((0.25, Robot().hull.radius_m + CONFIG.body_m + 0.08, 0.0, 0.0))
    avoidance = Avoidance(config=AvoidanceConfig(distance_m=0.2, waits=4))
    chosen = [avoidance.checked(aside, Action.FORWARD) for _ in range(6)]
    assert chosen.index(Action.FORWARD) == 4 and chosen[0] is Action.WAIT


def test_standing_things_are_obstacles_and_walking_ones_are_not():
    before = estimate((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 1.0, 0.0))
    after = Avoidance().around(before)
    centres = before.frame.centres(after.obstacle_probability > 0.5)
    assert np.hypot(*(centres - (1.0, 0.0)).T).max() < CONFIG.body_m
    assert len(centres) * 0.05**2 > 0.8 * math.pi * CONFIG.body_m**2
    assert (before.obstacle_probability < 0.5).all()


def test_without_people_map_and_actions_are_the_same_objects():
    empty = estimate()
    assert Avoidance().around(empty) is empty
    assert all(Avoidance().checked(empty, action) is action for action in Action)


def robot_at(x: float, y: float, walls_m: float = 9.0) -> MapEstimate:
    """Another robot of 0.1 m that has stood for long, between two walls at +-walls_m from the line ahead."""
    alone = estimate((x, y, 0.0, 0.0))
    probability = alone.obstacle_probability.copy()
    ys = alone.frame.centres(np.ones(alone.frame.shape, bool))[:, 1].reshape(alone.frame.shape)
    probability[np.abs(ys) > walls_m] = 0.9
    thing = replace(alone.moving[0], radius_m=0.1)
    return replace(alone, obstacle_probability=probability, moving=(thing,))


def test_a_robot_that_stands_is_no_obstacle_where_there_is_no_room_to_pass():
    """Between walls 1 m apart there is room next to it; where they are 0.6 m apart, it has to make room itself."""
    for walls_m, is_obstacle in ((0.5, True), (0.3, False)):
        before = robot_at(1.0, 0.0, walls_m)
        assert (
            Avoidance().around(before).obstacle_probability != before.obstacle_probability
        ).any() == is_obstacle


def test_robots_side_by_side_pass_each_other():
    """The step leads past the other robot and comes nearer by 2 cm; a step towards it comes nearer by more."""
    near_by = robot_at(0.1, 0.26)
    assert Avoidance().checked(near_by, Action.FORWARD) is Action.FORWARD
    towards = replace(near_by, pose=np.array([0.0, 0.0, 0.6]))
    assert Avoidance().checked(towards, Action.FORWARD) is Action.WAIT
    person = replace(near_by, moving=(replace(near_by.moving[0], radius_m=None),))
    assert Avoidance().checked(person, Action.FORWARD) is Action.WAIT
