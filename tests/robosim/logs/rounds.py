"""A round of a robot through a made hall as messages: scans, and odometry by topics or transforms."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from robosim.logs.robot_log import RobotLog
from slam.poses import between, compose
from tests.robosim.logs.made_bags import MOUNT, MOUNT_Z, laser_scan, odometry, placed, transform, write_bag

TIMES = 100 + 0.5 * np.arange(40)
BEARING = np.radians(np.arange(-180, 180, 1.0))


def base_poses() -> np.ndarray:
    """A round through a hall of 6 m x 4 m, in its frame."""
    turn = 2 * np.pi * (TIMES - TIMES[0]) / 20
    return np.column_stack([3 + 1.5 * np.cos(turn), 2 + 1.2 * np.sin(turn), turn + np.pi / 2])


def hall_ranges(pose: np.ndarray, bearing: np.ndarray) -> np.ndarray:
    """Distances to the walls and to a pillar."""
    x, y, yaw = pose
    dx, dy = np.cos(yaw + bearing), np.sin(yaw + bearing)
    with np.errstate(divide="ignore"):
        far = np.minimum(
            np.where(dx > 0, (6 - x) / dx, -x / dx), np.where(dy > 0, (4 - y) / dy, y / np.abs(dy))
        )
    along, aside = (3 - x) * dx + (2 - y) * dy, np.abs((3 - x) * dy - (2 - y) * dx)
    near = along - np.sqrt(np.maximum(0.3**2 - aside**2, 0))
    return np.where((aside < 0.3) & (along > 0), near, far)


POSES = base_poses()
LASER = np.array([compose(pose, MOUNT) for pose in POSES])
RANGES = np.array([hall_ranges(pose, BEARING) for pose in LASER])
STEPS = np.array([np.zeros(3), *(between(a, b) for a, b in pairwise(POSES))])


def recording(is_ros1: bool = False, *, scans: bool = True, has_odometry: bool = True) -> list:
    """Topics, times of arrival and messages: fixed transform, odometry and scans."""
    mount = transform(0.0, "base_link", "laser", placed(MOUNT, MOUNT_Z, is_ros1=is_ros1), is_ros1)
    rows = [("/tf_static", TIMES[0], mount)]
    for k, time_s in enumerate(TIMES):
        if has_odometry:
            rows.append(("/odom", time_s, odometry(time_s, POSES[k], is_ros1=is_ros1)))
        if scans:
            rows.append(("/scan", time_s + 0.01, laser_scan(time_s, BEARING, RANGES[k], is_ros1=is_ros1)))
    return rows


def moving(parent: str, child: str, poses: np.ndarray, times: np.ndarray = TIMES, *, is_ros1: bool = False):
    """Rows of a transform that changes."""
    return [
        ("/tf", t, transform(t, parent, child, placed(pose, is_ros1=is_ros1), is_ros1))
        for t, pose in zip(times, poses, strict=True)
    ]


def write_round(path: Path, rows: list, kind: str = "mcap", **options) -> Path:
    """Write a bag in order of arrival."""
    return write_bag(path, kind, sorted(rows, key=lambda row: row[1]), **options)


def assert_poses(poses: np.ndarray, expected: list, atol: float = 1e-5) -> None:
    """Poses are as expected; their yaw may be half a turn to either side."""
    off = [between(a, b) for a, b in zip(expected, poses, strict=True)]
    assert np.allclose(off, 0, atol=atol)


def assert_hall(log: RobotLog, atol: float = 1e-5) -> None:
    """Scans and odometry are those of the round."""
    assert np.allclose(log.times, TIMES, atol=1e-6)
    assert np.allclose(log.range_m, RANGES, atol=atol)
    assert np.allclose(log.displacement, STEPS, atol=atol)
    assert log.known.all()
