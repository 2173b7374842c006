"""What a perfect 2D laser sees among straight walls, in closed form."""

import math
from itertools import pairwise

import numpy as np

from slam.graph.submaps import View
from slam.matching.scan_matching import ScanPoints, points_of_beams

#: Directions of the beams [rad].
BEARING = np.radians(np.arange(-135, 135.1, 1.0))
RANGE_M = 12.0
#: Assumed deviation of a point without added noise [m].
SIGMA_M = 0.02


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    """Its four sides as segments (x, y, x, y) [m]."""
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


def ranges(walls, pose, rng=None, sigma_m: float = 0.01, bearing=BEARING) -> np.ndarray:
    """How far each beam goes [m]; inf where it meets no wall within range."""
    segments = np.array(walls, float)
    a, b = segments[:, :2] - pose[:2], segments[:, 2:] - pose[:2]
    along = b - a
    angle = pose[2] + bearing
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = ray[:, None, 0] * along[:, 1] - ray[:, None, 1] * along[:, 0]
        far = (a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]) / cross
        share = (a[:, 0] * ray[:, None, 1] - a[:, 1] * ray[:, None, 0]) / cross
    hit = (far > 0) & (share >= 0) & (share <= 1)
    reach = np.where(hit, far, np.inf).min(axis=1)
    if rng is not None:
        reach = reach + rng.normal(0, sigma_m, len(reach))
    return np.where(reach <= RANGE_M, reach, np.inf)


def seen(reach: np.ndarray) -> tuple[ScanPoints, View]:
    """A scan's points, and how far it saw."""
    scan = points_of_beams(BEARING, reach, RANGE_M, 0.05, SIGMA_M)
    return scan, View(bearing_rad=BEARING, range_m=np.where(np.isfinite(reach), reach, -RANGE_M))


def along(corners, step_m: float = 0.5, turn_rad: float = math.radians(20)) -> list[np.ndarray]:
    """Poses on a route through corners, turning on the spot at each."""
    poses = []
    for (x0, y0), (x1, y1) in pairwise(corners):
        yaw = math.atan2(y1 - y0, x1 - x0)
        if poses:
            turn = (yaw - poses[-1][2] + math.pi) % (2 * math.pi) - math.pi
            before, count = poses[-1][2], max(1, math.ceil(abs(turn) / turn_rad))
            poses += [np.array([x0, y0, before + turn * k / count]) for k in range(1, count)]
        length = math.hypot(x1 - x0, y1 - y0)
        for k in range(math.ceil(length / step_m) + 1):
            part = min(k * step_m / length, 1.0)
            poses.append(np.array([x0 + part * (x1 - x0), y0 + part * (y1 - y0), yaw]))
    return poses
