"""Scan matching: the pose at which a scan fits the surfaces of the map.

Each scan point is paired with the nearest map surface of the same orientation, and the pose is changed until the points
lie on their surfaces (distance along the normal only, so points may slide along a wall).
Gauss-Newton minimises

    sum_i w_i (n_i . (R p_i + t - m_i))^2 / sigma^2  +  d^T Lambda d,

where d is the deviation from the pose that odometry predicts and Lambda the inverse of its covariance. Where the scan
gives no information, as along a bare corridor, the prior alone decides and the pose does not slide. Outliers get small
weights (Cauchy).
Left out: matching without overlap, which returns the prediction; the graph (`slam.graph`) closes loops.
Reference: Censi, An ICP variant using a point-to-line metric, ICRA 2008; Kohlbrecher et al., SSRR 2011.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float

from robosim.support.checks import Range, checked
from robosim.support.compiled import compiled
from slam.matching.surfaces import SurfaceGrid, nearest_plane
from slam.poses import Covariance, Pose, to_map
from slam.sensing.projection import Scan

#: Neighbouring points farther apart than this are of two surfaces [m], unless their beams spread as far on one that is
#: slanted by no more than this (secant) and a third point lies in line with them within this [m].
_JUMP_M, _SLANT, _STRAIGHT_M = 0.3, 2.0, 0.06

#: Largest angle between normals of a point and of its surface, and of ones that only point to the robot (cosine).
_ALIKE, _ALIKE_THIN = 0.7, 0.2

#: Fewest paired points of a scan of few beams.
_PAIRS_THIN = 4

#: A pair counts half at no less than so many standard deviations of its point.
_WILD = 2.0

#: Error of the direction of beams [rad]: it shifts far points on grazed surfaces.
_AIM_RAD = 0.0017


@dataclass(frozen=True, kw_only=True)
@checked
class MatchConfig:
    """Settings of scan matching."""

    sigma_m: Annotated[float, Range(1e-6, 10, "m")] = 0.01
    """Standard deviation of one point from its surface [m], of a laser or a submap; errors of neighbouring points are
    correlated, so it is larger than the sensor's own."""
    depth_sigma_m: Annotated[float, Range(1e-6, 10, "m")] = 0.001
    """Standard deviation of a column of a depth camera's image, right before it [m]."""
    depth_sigma_per_m3: Annotated[float, Range(0, 10, "m/m3")] = 6e-5
    """Its growth with the cube of the range [m/m^3]: errors of triangulation grow with the square, and a wall that is
    farther away covers fewer of the column's rows."""
    outlier_m: Annotated[float, Range(1e-6, 10, "m")] = 0.03
    """Residual at which a pair counts half, or two standard deviations of its point: outliers lie beyond [m]."""
    iterations: Annotated[int, Range(1, 1000, "steps")] = 6
    """Most Gauss-Newton steps."""
    max_range_m: Annotated[float, Range(0.01, 1000, "m")] = 8.0
    """Farther points are left out [m]; in a hall only far points determine the heading."""
    min_pairs: Annotated[int, Range(1, 1_000_000, "points")] = 8
    """With fewer paired points the prediction is returned."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanPoints:
    """Points of a scan on surfaces, in the robot's frame."""

    points: Float[np.ndarray, "n 2"]
    """x forward, y left [m]."""
    normals: Float[np.ndarray, "n 2"]
    """Unit normals that point towards the robot."""
    weights: Float[np.ndarray, " n"]
    """Share of a cell that the point stands for, at most 1: many near points crowd into one cell."""
    sigma_m: Float[np.ndarray, " n"] | None = None
    """Standard deviation of each from its surface [m]; None for `MatchConfig.sigma_m`."""
    loose: Float[np.ndarray, "m 2"] | None = None
    """Points without a normal, as of edges, posts and grazed surfaces; used for search, not for fits."""
    thin: bool = False
    """Whether the beams are so few that normals just point to the robot (`slam.matching.thin_scans`)."""

    def at(self, pose: Pose) -> "ScanPoints":
        """Return the points in `map`, seen from a pose: x [m], y [m], yaw [rad]."""
        heading = np.array([0.0, 0.0, pose[2]])
        loose = None if self.loose is None else to_map(pose, self.loose)
        placed, turned = to_map(pose, self.points), to_map(heading, self.normals)
        return replace(self, points=placed, normals=turned, loose=loose)

    def within(self, range_m: float) -> "ScanPoints":
        """Return the points of a scan in the robot's frame that lie within a range [m]."""
        far_m = np.hypot(*self.every().T)
        if (far_m <= range_m).all():
            return self  # stored for long: no second copy
        near, loose_near = np.split(far_m <= range_m, [len(self.points)])
        return ScanPoints(
            points=self.points[near],
            normals=self.normals[near],
            weights=self.weights[near],
            sigma_m=None if self.sigma_m is None else self.sigma_m[near],
            loose=None if self.loose is None else self.loose[loose_near],
        )

    def every(self) -> Float[np.ndarray, "k 2"]:
        """Points with a normal and without."""
        return self.points if self.loose is None else np.concatenate([self.points, self.loose])

    def with_more(self, *others: "ScanPoints") -> "ScanPoints":
        """Return these points and those of other scans, all of known deviations."""
        every = (self, *others)
        loose = [each.loose for each in every if each.loose is not None]
        return ScanPoints(
            points=np.concatenate([each.points for each in every]),
            normals=np.concatenate([each.normals for each in every]),
            weights=np.concatenate([each.weights for each in every]),
            sigma_m=np.concatenate([each.sigma_m for each in every if each.sigma_m is not None]),
            loose=np.concatenate(loose) if loose else None,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Match:
    """Outcome of fitting one scan."""

    pose: Float[np.ndarray, "3"]
    """Pose found: x [m], y [m], yaw [rad]."""
    information: Float[np.ndarray, "3 3"]
    """Information of the scan alone: inverse covariance [1/m^2, 1/(m rad), 1/rad^2], axes of `map`."""
    paired: Bool[np.ndarray, " n"]
    """Which scan points lie on a surface of the map."""


def points_of_scan(scan: Scan, config: MatchConfig, cell_m: float) -> ScanPoints:
    """Points and normals of a depth camera's scan: of what is nearest, and of what stands behind.

    A camera that triangulates sees a near wall ten times as exactly as a far one; a robot that turns before a wall has
    nothing else to hold its heading.
    Reference: Nguyen, Izadi and Lovell, 3DIMPVT 2012, eq. (3), for how the error grows.

    Returns:
        The points that have a normal.
    """
    slant = np.hypot(1.0, scan.left)
    bearing = np.arctan(scan.left)
    near, far = (
        points_of_beams(bearing, z * slant, config.max_range_m, cell_m, config.depth_sigma_m)
        for z in (scan.depth_m, scan.far_m)
    )
    both = near.with_more(far)
    growth_m = config.depth_sigma_per_m3 * np.hypot(*both.points.T) ** 3
    return replace(both, sigma_m=np.hypot(config.depth_sigma_m, growth_m))


def points_of_beams(
    bearing_rad: Float[np.ndarray, " w"],
    range_m: Float[np.ndarray, " w"],
    max_range_m: float,
    cell_m: float,
    sigma_m: float,
) -> ScanPoints:
    """Points and normals of a fan of beams.

    Normals come from neighbours some 0.08 m away on the same surface, so that the steps of a rough wall average
    out. Points without two such neighbours are dropped: edges and posts.

    Args:
        bearing_rad: Directions in the robot's frame [rad], in order.
        range_m: How far away each beam ends at a surface [m]; inf where it meets none.
        max_range_m: Farther points are dropped [m].
        cell_m: Side of a map cell [m].
        sigma_m: Standard deviation of a point from its surface [m].

    Returns:
        The points that have a normal.
    """
    columns = np.flatnonzero(range_m <= max_range_m)
    n = len(columns)
    if n < 3:
        nothing = np.empty((0, 2))
        return ScanPoints(points=nothing, normals=nothing, weights=np.empty(0), sigma_m=np.empty(0))
    bearing, reached = bearing_rad[columns].astype(float), range_m[columns].astype(float)
    points = np.column_stack([reached * np.cos(bearing), reached * np.sin(bearing)])
    i = np.arange(n)
    step = np.hypot(*(points[1:] - points[:-1]).T)
    spacing = np.minimum(np.append(step, step[-1]), np.insert(step, 0, step[0]))
    reach = np.clip(np.rint(0.08 / np.maximum(spacing, 1e-3)), 1, 6).astype(int)
    before, after = np.maximum(i - reach, 0), np.minimum(i + reach, n - 1)
    chord = points[before] - points[after]
    # A jump between the two neighbours, or a lost column, means that they are not one surface. Far away beams lie
    # farther apart than the steps of a surface: there it takes three points in a line.
    widest = np.maximum(_JUMP_M, _SLANT * np.minimum(reached[1:], reached[:-1]) * np.diff(bearing))
    torn = np.append(0, np.cumsum((step > widest) | (np.diff(columns) > 1)))
    length = np.hypot(*chord.T)
    normals = np.column_stack([chord[:, 1], -chord[:, 0]]) / np.maximum(length, 1e-9)[:, None]
    inward = -(normals * points).sum(axis=1) / np.maximum(reached, 1e-9)
    normals = np.where(inward[:, None] < 0, -normals, normals)
    wide = step > _JUMP_M
    wide = np.append(wide, False) | np.insert(wide, 0, False)
    aside = np.abs((normals * (points - points[before])).sum(axis=1))
    straight = ~wide | ((aside < _STRAIGHT_M) & (before < i) & (i < after))
    good = straight & (torn[before] == torn[after]) & (length > 1e-6) & (np.abs(inward) > 0.12)
    weights = np.minimum(spacing[good] / cell_m, 1.0)
    return ScanPoints(
        points=points[good],
        normals=normals[good],
        weights=weights,
        sigma_m=np.hypot(sigma_m, (_AIM_RAD * reached * np.sqrt(np.maximum(1 - inward**2, 0.0)))[good]),
        loose=points[~good],
    )


def match_scan(
    surfaces: SurfaceGrid,
    scan: ScanPoints,
    predicted: Pose,
    covariance: Covariance,
    config: MatchConfig = MatchConfig(),
) -> Match:
    """Pose at which a scan fits the map best, given what odometry predicts.

    Args:
        surfaces: Surfaces on the map.
        scan: Points and normals in the robot's frame.
        predicted: Pose from odometry: x [m], y [m], yaw [rad].
        covariance: Covariance of the prediction, axes of `map` [m^2, m rad, rad^2].
        config: How far scans are trusted.

    Returns:
        The pose, which is the prediction itself if the scan finds no surfaces. Where points lie farther from their
        surfaces than they should, the information is less by as much: steps, corners and furniture fit badly.
    """
    return match_from(surfaces, scan, predicted, covariance, config, predicted[None])[0]


def match_from(
    surfaces: SurfaceGrid,
    scan: ScanPoints,
    predicted: Pose,
    covariance: Covariance,
    config: MatchConfig,
    starts: Float[np.ndarray, "k 3"],
) -> list[Match]:
    """Match a scan from each of several poses: x [m], y [m], yaw [rad]."""
    sigma_m = np.full(len(scan.points), config.sigma_m) if scan.sigma_m is None else scan.sigma_m
    min_pairs, alike = (_PAIRS_THIN, _ALIKE_THIN) if scan.thin else (config.min_pairs, _ALIKE)
    poses = np.array(starts, float)
    information = np.zeros((len(poses), 3, 3))
    paired = np.zeros((len(poses), len(scan.points)), bool)
    _match(
        (scan.points, scan.normals, scan.weights, sigma_m),
        surfaces.arrays(),
        predicted.astype(float),
        np.linalg.inv(covariance),
        (config.iterations, min_pairs, config.outlier_m, alike),
        poses,
        information,
        paired,
    )
    return [
        Match(pose=p, information=i, paired=on) for p, i, on in zip(poses, information, paired, strict=True)
    ]


@compiled
def _match(
    scan: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    surfaces: tuple[tuple[float, float, float], np.ndarray, np.ndarray],
    predicted: np.ndarray,
    prior: np.ndarray,
    settings: tuple[int, int, float, float],
    poses: np.ndarray,
    information: np.ndarray,
    paired: np.ndarray,
) -> None:
    """Gauss-Newton steps from each of the poses, which become those found."""
    points, normals, weights, sigma_m = scan
    planes = surfaces[2]
    iterations, min_pairs, least_outlier_m, alike = settings
    n = len(points)
    mean, unit, is_matched = np.empty((n, 2)), np.empty((n, 2)), np.empty(n, np.bool_)
    residual, trust, slope = np.zeros(n), np.zeros(n), np.empty(3)
    for start in range(len(poses)):
        pose, hessian = poses[start], information[start]
        moved_m, count = np.inf, 0
        for iteration in range(iterations):
            c, s = np.cos(pose[2]), np.sin(pose[2])
            if iteration == 0 or moved_m > 2e-3:
                count = 0
                for k in range(n):
                    x = pose[0] + c * points[k, 0] - s * points[k, 1]
                    y = pose[1] + s * points[k, 0] + c * points[k, 1]
                    facing = c * normals[k, 0] - s * normals[k, 1], s * normals[k, 0] + c * normals[k, 1]
                    row, dx, dy = nearest_plane(x, y, facing, surfaces, alike)
                    is_matched[k] = row >= 0
                    if row >= 0:
                        mean[k, 0], mean[k, 1] = x + dx, y + dy
                        unit[k, 0], unit[k, 1] = planes[row, 2], planes[row, 3]
                        count += 1
                if count < min_pairs:
                    break
            departure = pose - predicted
            departure[2] = (departure[2] + np.pi) % (2 * np.pi) - np.pi
            hessian[:] = 0.0
            pull = np.zeros(3)
            for k in range(n):
                if not is_matched[k]:
                    continue
                arm_x, arm_y = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
                residual[k] = unit[k, 0] * (arm_x + pose[0] - mean[k, 0]) + unit[k, 1] * (
                    arm_y + pose[1] - mean[k, 1]
                )
                wild = residual[k] / max(least_outlier_m, _WILD * sigma_m[k])
                trust[k] = weights[k] / (1 + wild * wild) / (sigma_m[k] * sigma_m[k])
                slope[0], slope[1] = unit[k, 0], unit[k, 1]
                slope[2] = unit[k, 1] * arm_x - unit[k, 0] * arm_y
                for i in range(3):
                    pull[i] += trust[k] * slope[i] * residual[k]
                    for j in range(3):
                        hessian[i, j] += trust[k] * slope[i] * slope[j]
            for i in range(3):
                for j in range(3):
                    pull[i] += prior[i, j] * departure[j]
            step = _solved(hessian + prior, pull)
            pose -= step
            # A turn moves points a metre or two away by as many metres per radian.
            moved_m = np.hypot(step[0], step[1]) + 2 * abs(step[2])
            if moved_m < 2e-4:
                break
        if count < min_pairs:
            pose[:], hessian[:] = predicted, 0.0
            continue
        pose[2] = (pose[2] + np.pi) % (2 * np.pi) - np.pi
        # The variance factor of least squares: squared residuals over what was expected.
        squares, expected = 0.0, 0.0
        for k in range(n):
            if is_matched[k]:
                squares += trust[k] * residual[k] * residual[k]
                expected += trust[k] * sigma_m[k] * sigma_m[k]
                paired[start, k] = abs(residual[k]) < 2 * max(least_outlier_m, _WILD * sigma_m[k])
        hessian /= max(1.0, squares / expected)


@compiled
def _solved(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Solution of three equations with a positive definite matrix, which changes."""
    for i in range(3):
        for j in range(i):
            factor = matrix[i, j] / matrix[j, j]
            values[i] -= factor * values[j]
            for k in range(3):
                matrix[i, k] -= factor * matrix[j, k]
    for i in range(2, -1, -1):
        for j in range(i + 1, 3):
            values[i] -= matrix[i, j] * values[j]
        values[i] /= matrix[i, i]
    return values
