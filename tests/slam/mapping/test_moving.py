"""Tracks of moving things on made maps, and what is left out of scans."""

import numpy as np
import pytest

from slam.grid import GridFrame
from slam.mapping.moving import MovingConfig, MovingThings
from slam.sensing.projection import Scan

CONFIG = MovingConfig(tracks=True)
#: A floor of 10 m by 6 m that is known to be free up to x = 8 m.
FRAME = GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.05, shape=(120, 200))
POSE = np.array([1.0, 3.0, 0.0])
BEARING = np.radians(np.linspace(45, -45, 128))


def free_floor(known_m: float = 8.0) -> np.ndarray:
    probability = np.full(FRAME.shape, 0.5, np.float32)
    probability[:, : round(known_m / 0.05)] = 0.1
    probability[:2], probability[-2:] = 0.9, 0.9
    return probability


def view(*bodies: tuple[float, float], radius_m: float = 0.15, far_m: float = 9.0) -> np.ndarray:
    """Points of a camera at POSE of upright cylinders, before a wall across at x = far_m."""
    range_m = (far_m - POSE[0]) / np.cos(BEARING)
    for x, y in bodies:
        rx, ry = x - POSE[0], y - POSE[1]
        along = rx * np.cos(BEARING) + ry * np.sin(BEARING)
        square = radius_m**2 - (rx * np.sin(BEARING) - ry * np.cos(BEARING)) ** 2
        hit = (square > 0) & (along > 0)
        range_m = np.where(hit, np.minimum(range_m, along - np.sqrt(np.maximum(square, 0))), range_m)
    return range_m[:, None] * np.column_stack([np.cos(BEARING), np.sin(BEARING)])


def test_a_walker_is_tracked_with_position_and_velocity():
    """Across the view at 1.2 m/s: position within 6 cm, velocity within 0.15 m/s, errors within three deviations."""
    things = MovingThings(CONFIG)
    for k in range(12):
        at = np.array([4.0 + 0.1 * k, 1.5 + 0.24 * k])
        (mask,) = things.update([view(tuple(at))], POSE, free_floor(), FRAME, 0.2)
    (thing,) = things.things()
    np.testing.assert_allclose(thing.xy, at, atol=0.06)
    np.testing.assert_allclose(thing.velocity, [0.5, 1.2], atol=0.15)
    error = np.concatenate([thing.xy - at, thing.velocity - [0.5, 1.2]])
    assert error @ np.linalg.solve(thing.covariance, error) < 9
    inside = np.hypot(*(view(tuple(at)) + POSE[:2] - at).T) < 0.2
    np.testing.assert_array_equal(mask, inside)


def test_what_the_map_explains_is_no_moving_thing():
    """A pillar that is on the map, and the wall."""
    probability = free_floor()
    rows, columns, frame = FRAME.window((3.75, 2.75), (4.25, 3.25))
    near = np.hypot(*(frame.centres(np.ones(frame.shape, bool)) - (4.0, 3.0)).T).reshape(frame.shape) < 0.18
    probability[rows, columns][near] = 0.9
    things = MovingThings(CONFIG)
    for _ in range(5):
        (mask,) = things.update([view((4.0, 3.0))], POSE, probability, FRAME, 0.5)
        assert not mask.any() and not things.things()


def test_a_post_beyond_the_known_floor_becomes_part_of_the_building():
    """It is left out for some sightings, then never again."""
    things, masked = MovingThings(CONFIG), []
    for _ in range(12):
        (mask,) = things.update([view((4.0, 3.0))], POSE, free_floor(2.0), FRAME, 0.5)
        masked.append(bool(mask.any()))
    assert masked == [True] * CONFIG.still + [False] * (12 - CONFIG.still)
    assert not things.things()


def test_a_walker_beyond_the_known_floor_stays_out_of_the_map():
    things = MovingThings(CONFIG)
    for k in range(10):
        (mask,) = things.update([view((4.0, 1.5 + 0.25 * k))], POSE, free_floor(2.0), FRAME, 0.25)
        assert mask.any()
    (thing,) = things.things()
    assert thing.velocity[1] == pytest.approx(1.0, abs=0.15)


def test_tracks_end_where_a_sensor_sees_farther_and_after_a_while():
    things = MovingThings(CONFIG)
    things.update([view((4.0, 3.0))], POSE, free_floor(), FRAME, 0.2)
    things.update([view()], POSE, free_floor(), FRAME, 0.2)
    assert not things.things()
    # Behind the robot nothing is seen: it is remembered for some seconds.
    things.update([view((4.0, 3.0))], POSE, free_floor(), FRAME, 0.2)
    behind = np.array([5.0, 3.0, 0.0])
    for k in range(10):
        things.update([view(far_m=4.0)], behind, free_floor(), FRAME, 1.0)
        assert bool(things.things()) == ((k + 1) * 1.0 <= CONFIG.forget_s)


def test_two_people_have_two_tracks_with_numbers_that_stay():
    things = MovingThings(CONFIG)
    for k in range(8):
        things.update([view((4.0, 2.0 + 0.1 * k), (5.0, 4.0 - 0.05 * k))], POSE, free_floor(), FRAME, 0.2)
    assert sorted(thing.number for thing in things.things()) == [1, 2]


def test_somebody_who_comes_to_stand_next_to_another_has_a_track_of_their_own():
    """Half a metre apart, first seen there: two tracks at the two places, and not one between them."""
    things = MovingThings(CONFIG)
    bodies = [(3.0, 3.0), (3.0, 3.5)]
    things.update([view(bodies[0])], POSE, free_floor(), FRAME, 0.5)
    for _ in range(4):
        (mask,) = things.update([view(*bodies)], POSE, free_floor(), FRAME, 0.5)
    found = np.array(sorted(thing.xy.tolist() for thing in things.things()))
    np.testing.assert_allclose(found[np.argsort(found[:, 1])], bodies, atol=0.08)
    assert mask.sum() > 20


def test_all_of_a_body_next_to_a_wall_is_left_out():
    """A walker who comes to stand 5 cm from a cupboard, around which floor does not count as free: no point stays."""
    probability = free_floor()
    probability[40:56, 60:72] = 0.9  # x = 3.0 to 3.6 m, y = 2.0 to 2.8 m
    things = MovingThings(CONFIG)
    for k in range(9):
        at = (3.3, 4.6 - 0.2 * k)
        points = view(at)
        (mask,) = things.update([points], POSE, probability, FRAME, 0.2)
    body = np.hypot(*(points + POSE[:2] - at).T) < 0.16
    assert body.sum() == 10 and mask[body].all()


def test_of_known_robots_alone_is_left_out_of_scans():
    """The corner of a wall 0.35 m from a robot, on floor that counts as free: only a track would take it away."""
    robot, corner = (4.0, 3.0), (4.0, 3.5)
    points = view(robot, corner)
    nothing = np.full(len(BEARING), np.inf, np.float32)
    left, depth_m = (values.astype(np.float32) for values in (np.tan(BEARING), points[:, 0]))
    scan = Scan(left=left, depth_m=depth_m, clear_m=depth_m, top_m=np.ones_like(depth_m), far_m=nothing)
    is_robot, is_corner = (np.hypot(*(points + POSE[:2] - at).T) < 0.2 for at in (robot, corner))
    assert is_robot.sum() > 5 and is_corner.sum() > 5
    things = MovingThings(CONFIG)
    tracked, _ = things.leave_out(scan, None, POSE, free_floor(), FRAME, 0.5)
    np.testing.assert_array_equal(tracked.hit, ~is_robot & ~is_corner)
    # The robot is 7 cm from where it is said to be.
    others = np.array([[4.05, 2.95, 0.15], [8.0, 5.0, 0.15]])
    known, _ = things.leave_out(scan, None, POSE, free_floor(), FRAME, 0.5, others)
    np.testing.assert_array_equal(known.hit, ~is_robot)
    assert not things.things()
