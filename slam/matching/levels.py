"""Surfaces at two levels, fine and coarse cells, and a lattice for search.

A pose known to some centimetres is fitted to the fine cells at once; one known to some decimetres is fitted to the
coarse cells first. Beyond that, poses on a lattice are scored by the distance of the scan to surfaces, and the best few
are fitted (correlative scan matching).
Reference: Olson, Real-time correlative scan matching, ICRA 2009.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from robosim.support.compiled import compiled
from slam.grid import GridFrame
from slam.matching.scan_matching import Match, MatchConfig, ScanPoints, match_from, match_scan
from slam.matching.surfaces import SurfaceGrid
from slam.poses import Covariance, Pose, to_map, wrap

#: Side of the coarse cells, in fine ones.
_COARSER = 4
#: Distance at which a turn moves points as far as a shift does, for comparing both [m].
ARM_M = 3.0
#: Step of the lattice [m], points tried on it, and how many of its poses are refined.
_STEP_M, _TRIED, _REFINED = 0.25, 120, 24
#: Number of refined poses that are fitted to the fine cells.
_FITTED = 5
#: Poses nearer than this are one [m].
_ONE_M = 0.05
#: Standard deviations searched to each side.
_SIGMAS = 3.0
#: Most poses of the lattice, some tenths of a second: where more is uncertain, only the middle of it is searched.
_MOST = 500_000
#: The fine cells find what is off by no more than this in all [m]; the coarse ones find four times as much.
_FINE_M = 0.06


class Surfaces(NamedTuple):
    """Surfaces of both levels, in one frame."""

    fine: ScanPoints
    coarse: ScanPoints
    loose: Float[np.ndarray, "n 2"]
    """Points without a normal [m]."""


class SurfaceLevels:
    """Surfaces in fine and coarse cells, wherever they are."""

    def __init__(self, cell_m: float) -> None:
        self.fine, self.coarse = (_empty(size * cell_m) for size in (1, _COARSER))
        self._loose: list[Float[np.ndarray, "n 2"]] = []
        self._near: tuple[GridFrame, Float[np.ndarray, "ny nx"]] | None = None

    def enter(self, pose: Pose, scan: ScanPoints) -> None:
        """Enter a scan at a pose."""
        for surfaces in (self.fine, self.coarse):
            _enter(surfaces, pose, scan)
        if scan.loose is not None:
            self._loose.append(to_map(pose, scan.loose))
        self._near = None

    def surfaces(self) -> Surfaces:
        """All surfaces, without cells."""
        fine, coarse = (
            ScanPoints(points=points, normals=normals, weights=weights)
            for points, normals, weights in (self.fine.planes(), self.coarse.planes())
        )
        loose = np.concatenate([np.zeros((0, 2)), *self._loose])
        return Surfaces(fine, coarse, loose)

    def take(self, surfaces: Surfaces, pose: Pose) -> None:
        """Enter surfaces of others, whose frame lies at a pose."""
        _enter(self.fine, pose, surfaces.fine)
        _enter(self.coarse, pose, surfaces.coarse)
        self._loose.append(to_map(pose, surfaces.loose))
        self._near = None

    def nearness(self) -> tuple[GridFrame, Float[np.ndarray, "ny nx"]]:
        """How near to a surface each cell is: 1 on it, exp(-1/2) a step of the lattice away."""
        if self._near is None:
            points = np.concatenate([self.fine.planes()[0], *self._loose])
            if not len(points):
                points = np.zeros((1, 2))
            cell = 0.5 * _STEP_M
            low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
            nx, ny = np.ceil((high - low) / cell).astype(int)
            frame = GridFrame(origin_xy=(low[0], low[1]), resolution_m=cell, shape=(int(ny), int(nx)))
            away = np.ones(frame.shape, np.uint8)
            away[frame.index(points)] = 0
            gap_m = cell * cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            self._near = frame, np.exp(-0.5 * (gap_m / _STEP_M) ** 2)
        return self._near


def _empty(cell_m: float) -> SurfaceGrid:
    corner, shape = (-25 * cell_m, -25 * cell_m), (50, 50)
    return SurfaceGrid(GridFrame(origin_xy=corner, resolution_m=cell_m, shape=shape), fronts=False)


def _enter(surfaces: SurfaceGrid, pose: Pose, scan: ScanPoints) -> None:
    placed = scan.at(pose)
    surfaces.make_room(placed.points)
    surfaces.add(placed.points, placed.normals, placed.weights)


def matches(
    levels: SurfaceLevels,
    scan: ScanPoints,
    predicted: Pose,
    covariance: Covariance,
    config: MatchConfig,
    rated: Callable[[Match], float],
    loosened: float = 1.0,
) -> list[Match]:
    """Poses at which a scan lies on surfaces; the uncertainty of the prediction decides on the method.

    Args:
        levels: The surfaces.
        scan: Points and normals in the robot's frame.
        predicted: x [m], y [m], yaw [rad].
        covariance: Of the prediction, axes of `map` [m^2, m rad, rad^2].
        config: Settings of scan matching.
        rated: Rating of matches to the coarse cells; the best are fitted to the fine cells.
        loosened: Factor on the covariance by which a fit may deviate, if the prediction is so certain that it cannot be
            confused with another.

    Returns:
        One, or several where the lattice was searched.
    """
    deviation = np.sqrt(np.diag(covariance))
    arm_m = ARM_M
    if len(scan.points):
        arm_m = max(ARM_M, float(np.median(np.hypot(*(scan.points - scan.points.mean(axis=0)).T))))
    off_m = _SIGMAS * math.hypot(deviation[0], deviation[1], arm_m * deviation[2])
    if off_m < _FINE_M:
        return [match_scan(levels.fine, scan, predicted, loosened * covariance, config)]
    starts = [predicted]
    if off_m > _COARSER * _FINE_M and len(scan.points):
        starts += _lattice(scan.every(), levels, predicted, _SIGMAS * deviation, arm_m)
    near = match_from(levels.coarse, scan, predicted, covariance, config, np.array(starts))
    if len(near) > 1:
        near.sort(key=rated, reverse=True)
    distinct: list[Match] = []
    for match in near:
        if all(math.hypot(*difference(match.pose, other.pose, arm_m)) > _ONE_M for other in distinct):
            distinct.append(match)
        if len(distinct) == _FITTED:
            break
    poses = np.array([match.pose for match in distinct])
    return match_from(levels.fine, scan, predicted, covariance, config, poses)


def most_paired(match: Match) -> float:
    """Rates a match by how many points lie on surfaces."""
    return float(match.paired.sum())


def difference(pose: Pose, other: Pose, arm_m: float = ARM_M) -> Pose:
    """How far apart two poses are: x, y, and the turn at the end of an arm [m]."""
    return np.array([*(pose - other)[:2], arm_m * wrap(pose[2] - other[2])])


def _lattice(
    points: Float[np.ndarray, "n 2"], levels: SurfaceLevels, predicted: Pose, half: Pose, arm_m: float
) -> list[Pose]:
    """The poses of a lattice at which points lie nearest to surfaces, no two of them neighbours."""
    step_rad = _STEP_M / arm_m
    count = min(math.ceil(half[2] / step_rad), math.ceil(math.pi / step_rad))
    turns = np.arange(-count, count + 1) * step_rad
    n_max = int(math.sqrt(_MOST / len(turns))) // 2
    dx, dy = (
        np.arange(-n, n + 1) * _STEP_M for n in np.minimum(np.ceil(half[:2] / _STEP_M), n_max).astype(int)
    )
    shift = np.stack(np.meshgrid(dx, dy), axis=-1).reshape(-1, 2)
    return nearest_poses(levels, points, predicted, shift, turns, arm_m)


def nearest_poses(
    levels: SurfaceLevels,
    points: Float[np.ndarray, "n 2"],
    centre: Pose,
    shift: Float[np.ndarray, "k 2"],
    turns: Float[np.ndarray, " t"],
    arm_m: float = ARM_M,
    count: int = _REFINED,
) -> list[Pose]:
    """Poses at which points of a scan lie nearest to surfaces, the best first and no two of them neighbours.

    Args:
        levels: The surfaces.
        points: Points in the robot's frame [m].
        centre: Pose that shifts and turns count from: x [m], y [m], yaw [rad].
        shift: Shifts that are tried (x, y) [m].
        turns: Turns that are tried with each of them [rad].
        arm_m: Distance at which a turn counts as much as a shift [m].
        count: Most poses returned.
    """
    frame, near = levels.nearness()
    sample = points[np.linspace(0, len(points) - 1, min(_TRIED, len(points))).astype(int)]
    cells = shift / frame.resolution_m
    # The field with a rim of zeros: points outside count nothing.
    field = np.pad(near, 1)
    placed = [to_map(np.array([*centre[:2], centre[2] + turn]), sample) for turn in turns]
    corners = frame.to_cells(np.array(placed)) + 1
    scores = np.zeros((len(turns), len(shift)), np.float32)
    _score(field, corners, cells, scores)
    best: list[np.ndarray] = []
    likely = np.argpartition(-scores, min(50 * count, scores.size - 1), axis=None)[: 50 * count]
    rest = np.column_stack(
        np.unravel_index(likely[np.argsort(-scores.flat[likely], kind="stable")], scores.shape)
    )
    poses = np.column_stack([centre[:2] + shift[rest[:, 1]], wrap(centre[2] + turns[rest[:, 0]])])
    while len(poses) and len(best) < count:
        best.append(poses[0])
        away = poses - poses[0]
        apart = np.hypot(np.hypot(away[:, 0], away[:, 1]), arm_m * wrap(away[:, 2])) > 1.5 * _STEP_M
        poses = poses[apart]
    return best


@compiled
def _score(field: np.ndarray, points: np.ndarray, shifts: np.ndarray, scores: np.ndarray) -> None:
    """Mean of the field at points, of each turn, after each shift; all in cells."""
    ny, nx = field.shape
    for turn in range(len(points)):
        for j in range(len(shifts)):
            total = 0.0
            for k in range(len(points[turn])):
                x, y = points[turn, k, 0] + shifts[j, 0], points[turn, k, 1] + shifts[j, 1]
                if 0 < x < nx and 0 < y < ny:
                    total += field[int(y), int(x)]
            scores[turn, j] = total / len(points[turn])
