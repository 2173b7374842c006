"""Odometry of scans of few beams: displacements that put the ends of beams of many scans on common lines.

Scan by scan: odometry predicts the pose, the scan is fitted to the lines of recent ones, from several headings, and all
recent poses are adjusted (`slam.matching.lines`). A scan is fitted again some scans later, when lines on both sides
of it are known. Systematic errors of odometry, a scale and a turn for each metre, are estimated too; a second
pass begins with those of the first.
Reference: Zhou et al., Efficient 2D graph SLAM for sparse sensing, IROS 2022; Censi et al., Simultaneous calibration of
odometry and sensor parameters for mobile robots, T-RO 2013.
"""

import math
from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from slam.matching.lines import WILD, Ends, OnLines, Track, adjust_poses, find_lines
from slam.poses import Pose, between, compose, wrap

#: Recent scans that are adjusted together hold so many ends, and are so many at least and at most.
_ENDS, _FEWEST, _MOST = 220, 5, 60
#: Distance from a line at which an end lies on it, and at which it counts half [m].
_ON_M, _WILD_M = 0.12, 0.06
#: Tolerances for all scans at the end, and the share of the recent scans by which groups follow each other.
_ON_AT_END_M, _WILD_AT_END_M, _OVERLAP = 0.1, 0.05, 3
#: A new scan's ends are paired with lines no farther away than this [m], beyond their ends by no more than this [m].
_GATE_M, _BEYOND_M, _SIGMA_M = 0.3, 0.5, 0.03
#: Other headings that a scan is fitted from: so far apart [rad], up to so many standard deviations of odometry; other
#: places [m]; and by how much they must be better (log-likelihood).
_HEADING_RAD, _DEVIATIONS, _ASIDE_M, _BETTER = 0.04, 2.5, 0.06, 4.0
#: Scans after which a scan is fitted again.
_AGAIN = (6, 1)
#: Deviations of systematic errors before they are known: scale, turn per metre [rad/m] and per radian; and those of
#: single displacements they are estimated from [m, rad].
_SCALE, _TURN_PER_M, _TURN_PER_RAD, _STEP_M, _STEP_RAD = 0.05, 0.03, 0.05, 0.04, 0.035
#: Distances from lines [m], as above, in turn, when all poses are refined; how often, since scans that were decimetres
#: off reach their lines late; and the squares in which lines are found.
_REFINED_M = ((0.2, 0.1), (0.2, 0.1), (0.15, 0.08), (0.12, 0.06), (0.1, 0.05), (0.1, 0.05))
_REFINEMENTS = 2
_SQUARE_M, _STEP_OF_SQUARES_M = 4.0, 2.5
#: A second pass trusts the errors of the first as much as so many times the prior.
_KNOWN = 30.0
#: Turns of odometry may deviate by so many times what is given.
_MOST_NOISE = 4.0


class Calibration:
    """Systematic errors of odometry: scale of distances, turn for each metre [rad/m], and scale of turns."""

    def __init__(self, values: Pose | None = None) -> None:
        """Begin without any, or with those of an earlier pass."""
        self.values = np.zeros(3) if values is None else values
        self._information = np.diag(np.array([_SCALE, _TURN_PER_M, _TURN_PER_RAD]) ** -2.0)
        if values is not None:
            self._information *= _KNOWN
        self._sum = self._information @ self.values

    def corrected(self, measured: Pose) -> Pose:
        """A displacement of odometry without them."""
        scale, per_m, per_rad = self.values
        distance_m = np.hypot(measured[0], measured[1])
        turn = (1 + per_rad) * measured[2] + per_m * distance_m
        return np.array([(1 + scale) * measured[0], (1 + scale) * measured[1], turn])

    def add(self, measured: Pose, estimated: Pose) -> None:
        """Learn from a displacement that is known better; outliers count little."""
        slopes = np.array([[measured[0], 0.0, 0.0], [0.0, np.hypot(measured[0], measured[1]), measured[2]]])
        error = (estimated - measured)[[0, 2]]
        deviation = np.array([_STEP_M, _STEP_RAD])
        trust = 1 / (deviation**2 + (error - slopes @ self.values) ** 2 / 4)
        self._information += slopes.T @ (trust[:, None] * slopes)
        self._sum += slopes.T @ (trust * error)
        self.values = np.linalg.solve(self._information, self._sum)


def line_odometry(
    ends: Ends, displacement: Track, deviation: Track, watched: Callable[[range], Iterable[int]] = iter
) -> tuple[Track, tuple[Track, Track]]:
    """Poses of scans by odometry and common lines.

    Args:
        ends: Ends of the beams of the scans.
        displacement: Since the scan before, by odometry: x, y [m], yaw [rad]; that of the first is not used.
        deviation: Its standard deviations, without systematic errors.
        watched: Wraps the range of scans, in each of two passes, to report progress.

    Returns:
        Poses from (0, 0, 0), yaw unwrapped; and displacements of odometry without systematic errors, with their
        standard deviations: the deviations of turns follow from how much they deviate from the poses.
    """
    window = int(np.clip(_ENDS * len(displacement) / max(len(ends.scan), 1), _FEWEST, _MOST))
    nominal, calibration = deviation, Calibration()
    for values in (None, 0):
        calibration = Calibration(None if values is None else calibration.values)
        poses = np.zeros((len(displacement), 3))
        for k in watched(range(1, len(poses))):
            _take_in(k, poses, ends, (displacement, deviation), calibration, window)
        corrected = np.array([calibration.corrected(step) for step in displacement])
        deviation = nominal * [1.0, 1.0, _turn_noise(poses, corrected, nominal)]
    step = max(window // _OVERLAP, 1)
    for _ in range(3):
        firsts = range(0, max(len(poses) - window, 0) + step, step)
        groups = [np.arange(*np.searchsorted(ends.scan, [first, first + window])) for first in firsts]
        on = find_lines(ends, poses, groups, _ON_AT_END_M)
        poses = adjust_poses(poses, ends, on, (corrected, deviation), _WILD_AT_END_M)
    return poses, (corrected, deviation)


def _turn_noise(poses: Track, corrected: Track, deviation: Track) -> float:
    """How much larger turns of odometry deviate from those of the poses than is given."""
    error = wrap(np.diff(poses[:, 2]) - corrected[1:, 2]) / deviation[1:, 2]
    # The mean magnitude: less sensitive to outliers than the mean square, and normal errors have 0.8 of it.
    noise = math.sqrt(math.pi / 2) * float(np.abs(error).mean()) if len(error) else 1.0
    return float(np.clip(noise, 1.0, _MOST_NOISE))


def _take_in(
    k: int, poses: Track, ends: Ends, odometry: tuple[Track, Track], calibration: Calibration, window: int
) -> None:
    """Estimate the pose of a scan, adjust those of recent ones, and learn from the one that leaves them."""
    displacement, deviation = odometry
    first = max(0, k - window + 1)
    recent = ends.between(first, k + 1)
    motion = np.array([calibration.corrected(step) for step in displacement[first : k + 1]])
    corrected = (motion, deviation[first : k + 1])
    poses[k] = compose(poses[k - 1], motion[-1])
    poses[k, 2] = poses[k - 1, 2] + motion[-1, 2]
    track = poses[first : k + 1].copy()
    before = np.arange(int(np.searchsorted(recent.scan, k - first)))
    _fit(track, recent, find_lines(recent, track, [before], _ON_M), corrected, k - first)
    on = find_lines(recent, track, [np.arange(len(recent.scan))], _ON_M)
    track = adjust_poses(track, recent, on, corrected, _WILD_M)
    for again in (k - first - back for back in _AGAIN):
        if again > 2:
            _fit(track, recent, on, corrected, again)
    poses[first : k + 1] = track
    if first:
        calibration.add(displacement[first], between(poses[first - 1], poses[first]))


def _fit(track: Track, ends: Ends, on: OnLines, motion: tuple[Track, Track], k: int) -> None:
    """Fit one scan to the lines of the others, near what odometry predicts from its neighbours; its pose changes."""
    lines = on.without(ends.scan[on.end] == k).lines(ends.at(track))
    predicted, deviation = [compose(track[k - 1], motion[0][k])], [motion[1][k]]
    if k + 1 < len(track):
        predicted.append(compose(track[k + 1], between(motion[0][k + 1], np.zeros(3))))
        deviation.append(motion[1][k + 1])
    widest = int(_DEVIATIONS * deviation[0][2] / _HEADING_RAD)
    turns = [[0.0, 0.0, k * _HEADING_RAD] for k in range(-widest, widest + 1) if k]
    shifts = [[x * _ASIDE_M, y * _ASIDE_M, 0.0] for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    starts = track[k] + np.array([[0.0, 0.0, 0.0], *turns, *shifts])
    points = ends.point[ends.scan == k]
    if len(points) > 2 and len(lines):
        track[k] = _best(points, lines, np.array(predicted), np.array(deviation), starts)


@compiled
def _best(
    points: np.ndarray, lines: np.ndarray, predicted: np.ndarray, deviation: np.ndarray, starts: np.ndarray
) -> np.ndarray:
    """The most likely pose by Gauss-Newton steps from some; the first of them is preferred."""
    best, least = starts[0].copy(), np.inf
    for number in range(len(starts)):
        pose = starts[number].copy()
        for _ in range(6):
            matrix, pull = np.zeros((3, 3)), np.zeros(3)
            cost = _BETTER if number else 0.0
            for k in range(len(predicted)):
                for i in range(3):
                    error = pose[i] - predicted[k, i]
                    if i == 2:
                        error = (error + np.pi) % (2 * np.pi) - np.pi
                    wild = (error / deviation[k, i] / WILD) ** 2
                    cost += 0.5 * WILD**2 * np.log1p(wild)
                    trust = 1 / (1 + wild) / deviation[k, i] ** 2
                    matrix[i, i] += trust
                    pull[i] += trust * error
            c, s = np.cos(pose[2]), np.sin(pose[2])
            for k in range(len(points)):
                x, y = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
                line, off = _nearest(x, y, pose, lines)
                wild = (off / _WILD_M) ** 2
                cost += 0.5 * (_WILD_M / _SIGMA_M) ** 2 * np.log1p(wild)
                if line >= 0:
                    nx, ny = lines[line, 2], lines[line, 3]
                    slope = np.array([nx, ny, ny * x - nx * y])
                    trust = 1 / (1 + wild) / _SIGMA_M**2
                    matrix += trust * np.outer(slope, slope)
                    pull += trust * off * slope
            if cost < least:
                best, least = pose.copy(), cost
            pose = pose - np.linalg.solve(matrix, pull)
    return best


@compiled
def _nearest(x: float, y: float, pose: np.ndarray, lines: np.ndarray) -> tuple[int, float]:
    """The line nearest to the end of a beam, given from the robot, and its distance [m]; -1 and the gate if none."""
    nearest, least = -1, _GATE_M
    for k in range(len(lines)):
        dx, dy, nx, ny = x + pose[0] - lines[k, 0], y + pose[1] - lines[k, 1], lines[k, 2], lines[k, 3]
        along = nx * dy - ny * dx
        off = nx * dx + ny * dy
        if (
            abs(off) < abs(least)
            and lines[k, 4] - _BEYOND_M < along < lines[k, 5] + _BEYOND_M
            and -(nx * x + ny * y) > 0.2 * np.hypot(x, y)
        ):
            nearest, least = k, off
    return nearest, least


def refine_poses(poses: Track, ends: Ends, motion: tuple[Track, Track]) -> Track:
    """Poses adjusted to lines of all scans that saw the same place; the first stays.

    Args:
        poses: Estimates, right to some decimetres: x [m], y [m], yaw [rad].
        ends: Ends of the beams of the scans.
        motion: Displacement since the scan before, and its standard deviations [m, m, rad].
    """
    poses = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    for on_m, wild_m in _REFINED_M * _REFINEMENTS:
        groups = _squares(ends.at(poses)[:, :2])
        poses = adjust_poses(poses, ends, find_lines(ends, poses, groups, on_m), motion, wild_m)
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def points_of_walls(poses: Track, ends: Ends, step_m: float) -> Float[np.ndarray, "n 2"]:
    """Points (x, y) [m] of `map`, at most so far apart [m], on the lines through ends of beams of scans at poses."""
    placed = ends.at(poses)
    points = [np.zeros((0, 2))]
    for line in find_lines(ends, poses, _squares(placed[:, :2]), _ON_AT_END_M).lines(placed):
        place = np.arange(line[4], line[5], step_m)[:, None]
        points.append(line[:2] + place * [-line[3], line[2]])
    return np.concatenate(points)


def _squares(points: Float[np.ndarray, "n 2"]) -> list[Int[np.ndarray, "..."]]:
    """Numbers of the points (x, y) [m] in overlapping squares."""
    if not len(points):
        return []
    corner = points.min(axis=0)
    cells = np.unique(np.floor((points - corner) / _STEP_OF_SQUARES_M).astype(int), axis=0)
    centres = corner + (cells + 0.5) * _STEP_OF_SQUARES_M
    return [np.flatnonzero((np.abs(points - centre) < _SQUARE_M / 2).all(axis=1)) for centre in centres]
