"""Errors of a trajectory against a reference, and agreement of the scans along it.

Absolute trajectory error: root mean square of the distances after the best rigid alignment (Sturm et al. 2012).
Relative pose error: of the displacement between two poses, for all pairs whose places lie 1 m to 5 m apart in the
reference, whenever they were visited (relations, after Kümmerle et al. 2009), and for pairs so far apart along the
trajectory.

A reference that comes from another mapping run has errors too. The number of cells of 5 cm that all scans fill needs
none: walls that are thick, or appear twice, fill more.
"""

import math

import numpy as np
from jaxtyping import Float, Int

from robosim.logs.robot_log import RobotLog
from slam.poses import Poses, between, compose, to_map, wrap

#: Distances between the two poses of a relation [m].
NEAR_M, FAR_M = 1.0, 5.0
#: Side of the cells counted [m], and how far scans are counted.
CELL_M, _RANGE_M = 0.05, 10.0


def compare_trajectories(poses: Poses, reference: Poses) -> dict[str, float]:
    """Errors of a trajectory against a reference, `_m` [m] and of turns `_deg` [deg].

    `ate` is the absolute trajectory error, root mean square; `rpe` the mean relative pose error between places 1 to 5 m
    apart, and `path_rpe` that over 1 to 5 m of trajectory.
    """
    off_m, off_rad = _relative(poses, reference, _near_in_place(reference))
    along_m, along_rad = _relative(poses, reference, _near_along(reference))
    away = (align_trajectory(poses, reference) - reference)[:, :2]
    return {
        "ate_m": math.sqrt(float((away**2).sum(axis=1).mean())),
        "rpe_m": _mean(off_m),
        "rpe_deg": math.degrees(_mean(off_rad)),
        "path_rpe_m": _mean(along_m),
        "path_rpe_deg": math.degrees(_mean(along_rad)),
    }


def align_trajectory(poses: Poses, reference: Poses) -> Poses:
    """The poses after the rigid motion that brings their places nearest to those of the reference."""
    middle, target = poses[:, :2].mean(axis=0), reference[:, :2].mean(axis=0)
    a, b = poses[:, :2] - middle, reference[:, :2] - target
    turn = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    placed = to_map(np.array([*target, turn]), a)
    return np.column_stack([placed, poses[:, 2] + turn])


def alignment(poses: Poses, reference: Poses) -> Float[np.ndarray, "3"]:
    """The same motion, as the pose of the frame of `poses` in that of the reference."""
    return compose(align_trajectory(poses, reference)[0], between(poses[0], np.zeros(3)))


def count_filled_cells(log: RobotLog, poses: Poses) -> int:
    """Number of cells that the ends of all beams fill."""
    cells = np.floor(ends_of_beams(log, poses) / CELL_M).astype(np.int64)
    return len(np.unique(cells, axis=0))


def ends_of_beams(log: RobotLog, poses: Poses, range_m: float = _RANGE_M) -> Float[np.ndarray, "m 2"]:
    """Ends of beams (x, y) [m] in `map`."""
    return np.concatenate(
        [
            to_map(
                pose,
                (ranges[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)]))[ranges < range_m],
            )
            for pose, bearing, ranges in zip(
                log.laser_poses(poses),
                log.beams(),
                np.where(np.isfinite(log.range_m), log.range_m, 1e9),
                strict=True,
            )
        ]
    )


def _near_in_place(reference: Poses) -> Int[np.ndarray, "m 2"]:
    """Pairs of poses whose places lie 1 m to 5 m apart."""
    x, y = reference[:, 0], reference[:, 1]
    pairs = []
    for k in range(len(reference)):
        apart = np.hypot(x[k + 1 :] - x[k], y[k + 1 :] - y[k])
        later = k + 1 + np.flatnonzero((apart >= NEAR_M) & (apart <= FAR_M))
        pairs.append(np.column_stack([np.full(len(later), k), later]))
    return np.concatenate(pairs)


def _near_along(reference: Poses) -> Int[np.ndarray, "m 2"]:
    """Pairs of poses 1 m to 5 m apart along the trajectory."""
    length_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(reference[:, :2], axis=0).T))])
    pairs = []
    for k in range(len(length_m)):
        later = np.arange(*np.searchsorted(length_m, length_m[k] + np.array([NEAR_M, FAR_M])), dtype=np.int64)
        pairs.append(np.column_stack([np.full(len(later), k), later]))
    return np.concatenate(pairs)


def _relative(
    poses: Poses, reference: Poses, pairs: Int[np.ndarray, "m 2"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Errors of displacements [m] and turns [rad] between pairs of poses."""
    mine, theirs = (_displacements(track, *pairs.T) for track in (poses, reference))
    # The error in the frame of the reference's end; its length is the same in any frame.
    return np.hypot(*(mine - theirs)[:, :2].T), np.abs(wrap(mine[:, 2] - theirs[:, 2]))


def _displacements(
    track: Poses, first: Int[np.ndarray, " m"], second: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "m 3"]:
    yaw = track[first, 2]
    dx, dy = (track[second, :2] - track[first, :2]).T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([c * dx + s * dy, c * dy - s * dx, track[second, 2] - yaw])


def _mean(values: Float[np.ndarray, " m"]) -> float:
    return float(values.mean()) if len(values) else math.nan
