"""Straight lines through the ends of beams of several scans, and the poses at which these ends lie on them.

A scan of few beams says little alone: its ends lie metres apart. Ends of several scans lie on the same walls. Lines
are found greedily: of all pairs of ends, the line that most others lie on, minus the beams that cross it. Then the
poses of all scans and all lines are estimated together, by Gauss-Newton on

    sum_i w_i (n_l . (R_k q_i + t_k - c_l) - d_l)^2 / sigma_i^2  +  sum_k |between(x_k-1, x_k) - u_k|^2 / s_k^2

with ends q_i of scan k on line l, displacements u_k of odometry, and Cauchy weights for both. Along directions that no
line constrains, odometry alone decides.
Left out: curved walls, but for their pieces; marginalization of older scans.
Reference: Zhou et al., Efficient 2D graph SLAM for sparse sensing, IROS 2022 (lines of several scans).
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse
from jaxtyping import Bool, Float, Int
from scipy.sparse.linalg import splu

from robosim.support.compiled import compiled
from slam.poses import wrap

#: Poses of scans, displacements between them or their standard deviations: x, y [m], yaw [rad].
Track = Float[np.ndarray, "k 3"]


#: Ends of beams on a line, at least; the length of a line, and the largest gap between neighbours on it [m].
_LEAST, _SHORT_M, _LONG_M, _GAP_M = 4, 0.3, 4.0, 1.0
#: Smallest cosine of the angle between a beam and the normal of the line it ends at.
_FACING = 0.2
#: Pairs of ends that are tried as lines, at most.
_PAIRS = 40_000
#: Standard deviation of an end from its line: constant [m], and per metre of range.
_SIGMA_M, _SIGMA_PER_M = 0.03, 0.004
#: Odometry counts half at so many standard deviations.
WILD = 2.5
#: Most Gauss-Newton steps, and the largest that ends them [m, rad].
_STEPS, _SMALL = 4, 1e-3


class Ends(NamedTuple):
    """Ends of beams of several scans, in the robot's frames."""

    scan: Int[np.ndarray, " n"]
    """Number of the scan of each, rising."""
    point: Float[np.ndarray, "n 2"]
    """x forward, y left [m]."""

    @classmethod
    def of(
        cls, bearing_rad: Float[np.ndarray, "*k w"], range_m: Float[np.ndarray, "n w"], max_range_m: float
    ) -> "Ends":
        """Return the ends of beams at a surface no farther away than this [m]."""
        scan, beam = np.nonzero(range_m <= max_range_m)
        length, bearing = range_m[scan, beam], np.broadcast_to(bearing_rad, range_m.shape)[scan, beam]
        return cls(scan, length[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)]))

    def between(self, first: int, last: int) -> "Ends":
        """Return the ends of scans from `first` to before `last`, counted from 0."""
        window = slice(*np.searchsorted(self.scan, [first, last]))
        return Ends(self.scan[window] - first, self.point[window])

    def at(self, poses: Track) -> Float[np.ndarray, "n 6"]:
        """In `map`, of scans at poses: end (x, y) [m], unit vector back to the robot, and place of the robot."""
        pose = poses[self.scan]
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        arm = np.column_stack(
            [c * self.point[:, 0] - s * self.point[:, 1], s * self.point[:, 0] + c * self.point[:, 1]]
        )
        back = -arm / np.maximum(np.hypot(*arm.T), 1e-9)[:, None]
        return np.column_stack([pose[:, :2] + arm, back, pose[:, :2]])


class OnLines(NamedTuple):
    """Which ends lie on which lines."""

    end: Int[np.ndarray, " m"]
    """Numbers of ends; an end may lie on lines of several groups."""
    line: Int[np.ndarray, " m"]
    """Number of the line of each, from 0."""

    def without(self, left_out: Bool[np.ndarray, " m"]) -> "OnLines":
        """Without some ends, and without lines of fewer than three of the others."""
        line = self.line[~left_out]
        enough = np.bincount(line)[line] > 2
        return OnLines(self.end[~left_out][enough], np.unique(line[enough], return_inverse=True)[1])

    def lines(self, placed: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "l 6"]:
        """Lines of best fit: centre (x, y), unit normal to the robot's side, and ends along (-ny, nx) [m]."""
        ends, n = placed[self.end], int(self.line.max(initial=-1)) + 1
        if n == 0:
            return np.zeros((0, 6))
        count = np.bincount(self.line, minlength=n)
        centre = np.column_stack([np.bincount(self.line, ends[:, k], n) / count for k in (0, 1)])
        x, y = (ends[:, :2] - centre[self.line]).T
        xx, xy, yy = (np.bincount(self.line, product, n) for product in (x * x, x * y, y * y))
        angle = 0.5 * np.arctan2(2 * xy, xx - yy) + np.pi / 2
        normal = np.column_stack([np.cos(angle), np.sin(angle)])
        side = np.bincount(self.line, (ends[:, 2:4] * normal[self.line]).sum(axis=1), n)
        normal = np.where(side[:, None] < 0, -normal, normal)
        along = normal[self.line, 0] * y - normal[self.line, 1] * x
        low, high = np.full(n, np.inf), np.full(n, -np.inf)
        np.minimum.at(low, self.line, along)
        np.maximum.at(high, self.line, along)
        return np.column_stack([centre, normal, low, high])


def find_lines(ends: Ends, poses: Track, groups: list[Int[np.ndarray, "..."]], tolerance_m: float) -> OnLines:
    """Lines through ends of the same group, each of several scans.

    Args:
        ends: Ends of beams.
        poses: Of their scans: x [m], y [m], yaw [rad].
        groups: Numbers of ends, those near each other in space or time.
        tolerance_m: Distance from a line at which an end lies on it [m].
    """
    placed, members, line, count = ends.at(poses), [np.zeros(0, int)], [np.zeros(0, int)], 0
    for group in groups:
        label, more = _labelled(placed[group], ends.scan[group], tolerance_m)
        members.append(group[label >= 0])
        line.append(label[label >= 0] + count)
        count += more
    return OnLines(np.concatenate(members), np.concatenate(line))


def _labelled(
    placed: Float[np.ndarray, "n 6"], scan: Int[np.ndarray, " n"], tolerance_m: float
) -> tuple[Int[np.ndarray, " n"], int]:
    """Number of the line of each end, -1 for none, and the number of lines."""
    first, second = np.triu_indices(len(placed), 1)
    length = np.hypot(*(placed[first, :2] - placed[second, :2]).T)
    pairs = np.flatnonzero((length > _SHORT_M) & (length < _LONG_M))
    pairs = pairs[:: len(pairs) // _PAIRS + 1]
    pair = np.column_stack([first[pairs], second[pairs]])
    score = np.zeros(len(pair))
    _score(placed, pair, tolerance_m, score)
    best = np.argsort(-score, kind="stable")[: int((score > _LEAST - 1.5).sum())]
    label = np.full(len(placed), -1)
    return label, _claim(placed, scan, pair[best], tolerance_m, label)


@compiled
def _score(placed: np.ndarray, pairs: np.ndarray, tolerance_m: float, score: np.ndarray) -> None:
    """How well other ends support the line through each of some pairs: those on it, minus beams across it."""
    for number in range(len(pairs)):
        i, j = pairs[number]
        x0, y0 = placed[i, 0], placed[i, 1]
        length = np.hypot(placed[j, 0] - x0, placed[j, 1] - y0)
        tx, ty = (placed[j, 0] - x0) / length, (placed[j, 1] - y0) / length
        facing_i = placed[i, 3] * tx - placed[i, 2] * ty
        facing_j = placed[j, 3] * tx - placed[j, 2] * ty
        if min(abs(facing_i), abs(facing_j)) < _FACING or facing_i * facing_j < 0:
            continue
        nx, ny = (-ty, tx) if facing_i > 0 else (ty, -tx)
        for k in range(len(placed)):
            dx, dy = placed[k, 0] - x0, placed[k, 1] - y0
            along, off = dx * tx + dy * ty, dx * nx + dy * ny
            if abs(off) < tolerance_m:
                near = -_GAP_M < along < length + _GAP_M
                if near and placed[k, 2] * nx + placed[k, 3] * ny > _FACING:
                    score[number] += 1 - (off / tolerance_m) ** 2
            elif off < -2 * tolerance_m:
                dx, dy = placed[k, 4] - x0, placed[k, 5] - y0
                before = dx * nx + dy * ny
                if before > 2 * tolerance_m:
                    start = dx * tx + dy * ty
                    crossing = start + (along - start) * before / (before - off)
                    if 0.1 < crossing < length - 0.1:
                        score[number] -= 1


@compiled
def _claim(
    placed: np.ndarray, scan: np.ndarray, pairs: np.ndarray, tolerance_m: float, label: np.ndarray
) -> int:
    """Label the ends on the line of each pair, the best pair first; the number of lines."""
    count = 0
    on, place = np.empty(len(placed), np.int64), np.empty(len(placed))
    for number in range(len(pairs)):
        i, j = pairs[number]
        if label[i] >= 0 or label[j] >= 0:
            continue
        x0, y0 = placed[i, 0], placed[i, 1]
        length = np.hypot(placed[j, 0] - x0, placed[j, 1] - y0)
        tx, ty = (placed[j, 0] - x0) / length, (placed[j, 1] - y0) / length
        nx, ny = (-ty, tx) if placed[i, 3] * tx - placed[i, 2] * ty > 0 else (ty, -tx)
        n = 0
        for k in range(len(placed)):
            dx, dy = placed[k, 0] - x0, placed[k, 1] - y0
            along = dx * tx + dy * ty
            if (
                label[k] < 0
                and abs(dx * nx + dy * ny) < tolerance_m
                and placed[k, 2] * nx + placed[k, 3] * ny > _FACING
                and -3 * _GAP_M < along < length + 3 * _GAP_M
            ):
                on[n], place[n] = k, along
                n += 1
        # The connected part around the first of the pair.
        order = np.argsort(place[:n])
        low = high = np.searchsorted(place[:n][order], 0.0, side="right") - 1
        while low > 0 and place[order[low]] - place[order[low - 1]] < _GAP_M:
            low -= 1
        while high < n - 1 and place[order[high + 1]] - place[order[high]] < _GAP_M:
            high += 1
        component = on[order[low : high + 1]]
        several = (scan[component] != scan[component[0]]).any()
        if len(component) >= _LEAST and place[order[high]] - place[order[low]] > _SHORT_M and several:
            label[component] = count
            count += 1
    return count


def adjust_poses(poses: Track, ends: Ends, on: OnLines, motion: tuple[Track, Track], wild_m: float) -> Track:
    """Poses at which ends lie on lines and displacements are as measured; the first pose stays.

    Args:
        poses: Estimates: x [m], y [m], yaw [rad].
        ends: Ends of beams of scans there.
        on: Lines they lie on.
        motion: Displacement since the scan before, and its standard deviations [m, m, rad]; the values of the first
            scan are not used.
        wild_m: Distance from its line at which an end counts half [m].
    """
    lines = on.lines(ends.at(poses))
    angle, offset = np.arctan2(lines[:, 3], lines[:, 2]), np.zeros(len(lines))
    n, unknown = len(poses), 3 * len(poses) + 2 * len(lines)
    share = 1 / np.bincount(on.end)[on.end]
    weight = share / (_SIGMA_M**2 + (_SIGMA_PER_M * np.hypot(*ends.point[on.end].T)) ** 2)
    scan = ends.scan[on.end]
    columns = np.column_stack([3 * scan[:, None] + [0, 1, 2], 3 * n + 2 * on.line[:, None] + [0, 1]])
    prior = np.zeros(unknown)
    prior[:3], prior[3 * n :] = 1e10, 0.1
    poses = poses.copy()
    for _ in range(_STEPS):
        point = ends.at(poses)[on.end, :2]
        nx, ny = np.cos(angle[on.line]), np.sin(angle[on.line])
        (x, y), (arm_x, arm_y) = (point - lines[on.line, :2]).T, (point - poses[scan, :2]).T
        off = nx * x + ny * y - offset[on.line]
        slope = np.column_stack([nx, ny, ny * arm_x - nx * arm_y, nx * y - ny * x, -np.ones(len(off))])
        of_ends = _sparse(slope, columns, unknown)
        of_motion, error, trust = _motion_terms(poses, motion, unknown)
        trusts = scipy.sparse.diags(weight / (1 + (off / wild_m) ** 2)), scipy.sparse.diags(trust)
        weighted = of_ends.T @ trusts[0], of_motion.T @ trusts[1]
        matrix = weighted[0] @ of_ends + weighted[1] @ of_motion + scipy.sparse.diags(prior)
        step = splu(matrix.tocsc()).solve(weighted[0] @ off + weighted[1] @ error)
        poses -= step[: 3 * n].reshape(-1, 3)
        angle, offset = angle - step[3 * n :: 2], offset - step[3 * n + 1 :: 2]
        if np.abs(step[: 3 * n]).max() < _SMALL:
            break
    return poses


def _motion_terms(
    poses: Track, motion: tuple[Track, Track], unknown: int
) -> tuple[scipy.sparse.csr_matrix, Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Derivatives, errors and weights of the displacements between poses."""
    measured, deviation = motion[0][1:], motion[1][1:]
    before, away = poses[:-1], np.diff(poses, axis=0)
    c, s = np.cos(before[:, 2]), np.sin(before[:, 2])
    x, y = c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]
    error = np.column_stack([x, y, away[:, 2]]) - measured
    error[:, 2] = wrap(error[:, 2])
    zero, unit = np.zeros(len(c)), np.ones(len(c))
    slope = np.stack(
        [
            np.column_stack([-c, -s, y, c, s, zero]),
            np.column_stack([s, -c, -x, -s, c, zero]),
            np.column_stack([zero, zero, -unit, zero, zero, unit]),
        ],
        axis=1,
    )
    columns = np.repeat(3 * np.arange(len(c))[:, None] + np.arange(6), 3, axis=0)
    trust = 1 / (deviation**2 + (error / WILD) ** 2)
    return _sparse(slope.reshape(-1, 6), columns, unknown), error.ravel(), trust.ravel()


def _sparse(
    values: Float[np.ndarray, "r v"], columns: Int[np.ndarray, "r v"], n_columns: int
) -> scipy.sparse.csr_matrix:
    """A matrix with as many values in each row."""
    rows, width = values.shape
    starts = np.arange(0, values.size + 1, width)
    return scipy.sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(rows, n_columns))
