"""Lines through ends of few beams, and poses by them, against made rooms whose walls and poses are known."""

import math
from itertools import pairwise

import numpy as np

from slam.matching.line_odometry import Calibration, line_odometry, refine_poses
from slam.matching.lines import Ends, adjust_poses, find_lines
from slam.poses import between, compose
from tests.slam.beams import along, ranges
from tests.slam.matching.test_thin_scans import ROOM, off_walls

BEARING = np.radians(np.arange(-90, 91, 18.0))
RANGE_M = 12.0
ROUTE = along([(1, 1), (5, 1), (5, 5), (1, 5), (1, 1.5)], step_m=0.4)


def seen_from(walls, route) -> Ends:
    """Ends of 11 beams per scan."""
    rng = np.random.default_rng(1)
    return Ends.of(BEARING, np.array([ranges(walls, pose, rng, 0.005, BEARING) for pose in route]), RANGE_M)


def steps_of(route) -> np.ndarray:
    return np.array([np.zeros(3), *(between(a, b) for a, b in pairwise(route))])


def errors(poses, route) -> np.ndarray:
    """Of each pose from its first: x, y [m], yaw [rad]."""
    return np.array(
        [between(between(poses[0], p), between(route[0], r)) for p, r in zip(poses, route, strict=True)]
    )


def test_lines_are_walls():
    """Lines through ends at true poses lie on walls to 2 cm, and face the robot."""
    ends, route = seen_from(ROOM, ROUTE), np.array(ROUTE)
    placed = ends.at(route)
    on = find_lines(ends, route, [np.arange(len(ends.scan))], 0.05)
    lines = on.lines(placed)
    assert len(on.end) > 0.9 * len(ends.scan)
    assert np.percentile(off_walls(lines[:, :2], ROOM), 90) < 0.02
    assert ((lines[on.line, 2:4] * placed[on.end, 2:4]).sum(axis=1) > 0).all()


def test_beams_through_a_gap_leave_no_line_across_it():
    """Two posts in line with a door between: no line reaches over it."""
    walls = [(4, 0, 4, 2.4), (4, 3.4, 4, 6), (9, 0, 9, 6)]
    route = np.array(along([(1, 1), (1, 5)], step_m=0.1))
    ends = seen_from(walls, route)
    on = find_lines(ends, route, [np.arange(len(ends.scan))], 0.05)
    lines = on.lines(ends.at(route))
    near = lines[np.abs(lines[:, 0] - 4) < 0.1]
    assert len(near) >= 2
    assert ((near[:, 1] - 2.9) * (near[:, 1] + near[:, 2] * near[:, 4] - 2.9) > 0).all()


def test_a_corridor_keeps_odometry_along_it():
    """Two parallel walls give the place across and the heading; along them it stays that of odometry."""
    walls = [(-50, -1, 50, -1), (-50, 1, 50, 1)]
    route = np.array([[0.4 * k, 0.0, 0.0] for k in range(12)])
    ends, steps = seen_from(walls, route), steps_of(route)
    off = route + np.array([0.0, 0.02, 0.01]) * np.arange(12)[:, None] / 11
    off[:, 0] *= 1.05
    on = find_lines(ends, off, [np.arange(len(ends.scan))], 0.1)
    deviation = np.tile([0.03, 0.03, 0.03], (12, 1))
    found = adjust_poses(off, ends, on, (1.05 * steps, deviation), 0.05)
    turn = between(found[0], found[-1])
    np.testing.assert_allclose(turn, [1.05 * 4.4, 0.0, 0.0], atol=0.02)


def test_odometry_errors_are_learned():
    """A scale, a turn per metre and one per radian, of exact displacements: to 1 %."""
    rng, calibration, true = np.random.default_rng(2), Calibration(), np.array([0.04, -0.05, 0.03])
    for _ in range(400):
        measured = np.array([rng.uniform(0, 1), 0.0, rng.normal(0, 0.3)])
        turn = (1 + true[2]) * measured[2] + true[1] * measured[0]
        calibration.add(measured, np.array([(1 + true[0]) * measured[0], 0.0, turn]))
    np.testing.assert_allclose(calibration.values, true, atol=1e-3)
    np.testing.assert_allclose(calibration.corrected(np.array([1.0, 0.0, 0.0])), [1.04, 0, -0.05], atol=1e-3)


def test_lines_keep_the_pose_where_odometry_drifts():
    """Round a room by odometry that turns 3 degrees too far each metre: a tenth of its error remains."""
    route = np.array(ROUTE)
    rng, ends, steps = np.random.default_rng(3), seen_from(ROOM, route), steps_of(route)
    measured = steps + rng.normal(0, [0.01, 0.01, 0.01], steps.shape)
    measured[:, 2] -= math.radians(3.0) * np.hypot(steps[:, 0], steps[:, 1])
    blind = [np.zeros(3)]
    for step in measured[1:]:
        blind.append(compose(blind[-1], step))
    deviation = np.tile([0.03, 0.03, 0.03], (len(steps), 1))
    poses, motion = line_odometry(ends, measured, deviation)
    by_lines, by_odometry = (np.abs(errors(found, route)).max(axis=0) for found in (poses, np.array(blind)))
    assert (by_odometry > [0.5, 0.5, math.radians(40)]).all()
    assert (by_lines < 0.1 * by_odometry).all()
    refined = np.abs(errors(refine_poses(poses, ends, motion), route))
    assert np.percentile(refined[:, :2], 90) < 0.05
    assert np.percentile(refined[:, 2], 90) < math.radians(1.0)


def test_noise_of_turns_is_estimated():
    """Turns err by 0.15 rad where 0.05 is given: the deviation is estimated, and poses stay on the lines."""
    route = np.array(ROUTE)
    rng, ends, steps = np.random.default_rng(4), seen_from(ROOM, route), steps_of(route)
    measured = steps + rng.normal(0, [0.01, 0.01, 0.15], steps.shape)
    given = np.tile([0.03, 0.03, 0.05], (len(steps), 1))
    poses, (_, deviation) = line_odometry(ends, measured, given)
    np.testing.assert_allclose(deviation[:, 2], 0.15, rtol=0.3)
    np.testing.assert_allclose(deviation[:, :2], given[:, :2])
    assert np.abs(errors(poses, route)[:, 2]).max() < math.radians(6.0)


def test_scans_that_see_nothing_leave_odometry():
    """No ends at all: poses are those of the displacements."""
    route = np.array(along([(0, 0), (3, 0)], step_m=0.5))
    ends = Ends.of(BEARING, np.full((len(route), len(BEARING)), np.inf), RANGE_M)
    deviation = np.tile([0.03, 0.03, 0.03], (len(route), 1))
    poses, _ = line_odometry(ends, steps_of(route), deviation)
    np.testing.assert_allclose(errors(poses, route), 0, atol=1e-6)
    np.testing.assert_allclose(
        errors(refine_poses(poses, ends, (steps_of(route), deviation)), route), 0, atol=1e-6
    )
