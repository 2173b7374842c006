"""Logs of a lidar that turns while the robot drives and turns, with exact poses in closed form."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.support.tum import write_tum
from slam.poses import between, compose
from tests.robot_logs import ROOM

#: Time of a turn of the lidar [s], beams of a turn, and time between readings of odometry [s].
TURN_S, BEAMS, READING_S = 0.1, 360, 0.02
#: Directions of the beams [rad].
BEARING = np.linspace(-math.pi, math.pi, BEAMS, endpoint=False)


def true_poses(times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
    """Round the pillar at 0.4 to 0.7 m/s, looking from side to side at up to 1.6 rad/s."""
    phase = 0.25 * times
    x, y = 4 + 2.6 * np.cos(phase), 3 + 1.9 * np.sin(phase)
    return np.column_stack([x, y, phase + math.pi / 2 + 0.85 * np.sin(1.6 * times)])


def swept_ranges(
    walls: list[tuple[float, float, float, float]],
    poses: Float[np.ndarray, "w 3"],
    bearing: Float[np.ndarray, " w"],
) -> Float[np.ndarray, " w"]:
    """How far beams go [m], each from a pose of its own, until they meet a wall (x, y, x, y) [m]."""
    x0, y0, x1, y1 = np.array(walls, float).T
    c, s = np.cos(poses[:, 2] + bearing)[:, None], np.sin(poses[:, 2] + bearing)[:, None]
    ax, ay = x0 - poses[:, :1], y0 - poses[:, 1:2]
    dx, dy = x1 - x0, y1 - y0
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = c * dy - s * dx
        far, share = (ax * dy - ay * dx) / cross, (ax * s - ay * c) / cross
    hit = (far > 0) & (share >= 0) & (share <= 1)
    return np.asarray(np.where(hit, far, np.inf).min(axis=1))


def write_skewed(folder: Path, scans: int, turn_s: float = TURN_S) -> tuple[Path, Path, np.ndarray]:
    """A TUM file of odometry at 50 Hz with 2 % of error, a table of scans at 10 Hz, and the true poses of the scans.

    Ranges err by 5 mm. A scan's time is that of its first beam.
    """
    own, poses, times, reach = _drive(scans, turn_s)
    odometry, table = folder / "odometry.tum", folder / "scans.txt"
    write_tum(odometry, own, poses)
    ends = np.tile([BEARING[0], BEARING[-1]], (scans, 1))
    np.savetxt(table, np.column_stack([times, ends, reach]), fmt="%.6f")
    return odometry, table, true_poses(times)


def write_skewed_carmen(folder: Path, scans: int, still: bool = False) -> tuple[Path, np.ndarray]:
    """The same as a CARMEN log with half of the beams, ahead, and the true poses; `still` has no odometry.

    The laser sits 0.2 m ahead of the robot's centre, and 0.1 m to the right.
    """
    own, poses, times, reach = _drive(scans, TURN_S)
    offset = np.array([0.2, -0.1, 0.0])
    robot = [compose(pose, between(offset, np.zeros(3))) for pose in poses]
    lines = [(time, "ODOM " + _words(*pose, 0, 0, 0, time)) for time, pose in zip(own, robot, strict=True)]
    at = np.column_stack([np.interp(times, own, np.unwrap(part)) for part in poses.T])
    ahead = slice(BEAMS // 4, 3 * BEAMS // 4)
    head = (
        f"ROBOTLASER1 0 {BEARING[ahead][0]:.9f} 3.14159 {BEARING[1] - BEARING[0]:.9f} 80 0.01 0 {BEAMS // 2} "
    )
    for time, pose, ranges in zip(times, at, reach, strict=True):
        base = compose(pose, between(offset, np.zeros(3)))
        words = _words(*ranges[ahead]) + " 0 " + _words(*pose, *base, 0, 0, 0, 0, 0, time) + f" h {time:.6f}"
        lines.append((time, head + words))
    if still:
        laser = " 0 " + _words(*np.zeros(11))
        lines = [
            (time, line.rpartition(" 0 " + _words(*pose))[0] + laser + f" {time:.6f} h {time:.6f}")
            for (time, line), pose in zip(lines[len(own) :], at, strict=True)
        ]
    path = folder / "skewed.log"
    path.write_text("".join(f"{line} h {time:.6f}\n" for time, line in sorted(lines)))
    return path, true_poses(times)


def _words(*values: float) -> str:
    return " ".join(f"{value:.6f}" for value in values)


def _drive(scans: int, turn_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times and poses of odometry, and times and ranges of scans."""
    rng = np.random.default_rng(1)
    times = 100.013 + 0.1 * np.arange(scans)
    own = np.arange(99.987, times[-1] + 0.3, READING_S)
    poses = [np.zeros(3)]
    for a, b in pairwise(true_poses(own)):
        step = between(a, b)
        poses.append(compose(poses[-1], step * rng.normal([1.01, 1, 1.01], 0.02)))
    late = np.linspace(0, turn_s, BEAMS)
    reach = [swept_ranges(ROOM, true_poses(time + late), BEARING) for time in times]
    return own, np.array(poses), times, np.array(reach) + rng.normal(0, 0.005, (scans, BEAMS))
