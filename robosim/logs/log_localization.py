"""Localization of a log on a known map: pose and covariance of each scan."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from robosim.logs.log_mapping import LogConfig, check_reach, scan_points
from robosim.logs.robot_log import RobotLog
from slam.mapping.known_map import KnownMap
from slam.mapping.localization import LocalizationConfig, Localizer
from slam.matching.thin_scans import is_thin
from slam.poses import between, compose, rotation


@dataclass(frozen=True, kw_only=True, eq=False)
class Localized:
    """Poses of a log on a known map."""

    poses: Float[np.ndarray, "n 3"]
    """Pose of the robot at each scan in the map's frame: x [m], y [m], yaw [rad]."""
    covariance: Float[np.ndarray, "n 3 3"]
    """Covariance of each pose when it was estimated, axes of the map [m^2, m rad, rad^2]."""
    is_located: Bool[np.ndarray, " n"]
    """Scans at which no other pose explained the scans as well, or whose pose followed from later ones."""
    kidnapped: tuple[int, ...]
    """Scans at which the robot was not where it was believed."""

    @property
    def deviation_m(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of each place [m]."""
        return np.sqrt(self.covariance[:, 0, 0] + self.covariance[:, 1, 1])


def locate_log(
    log: RobotLog,
    known: KnownMap,
    config: LogConfig = LogConfig(),
    watched: Callable[[range, str], Iterable[int]] = lambda numbers, _: numbers,
) -> Localized:
    """Locate each scan of a log on a known map, from an unknown pose; FileError as of `check_reach`.

    Poses before the robot was located follow from the pose that then explained all scans.

    Args:
        log: Scans and odometry.
        known: The map.
        config: Errors of odometry, and range of scans.
        watched: Progress display: iterates over numbers, given them and their name.
    """
    check_reach(log, config.range_m)
    match = replace(LocalizationConfig().match, max_range_m=config.range_m)
    localizer = Localizer(known, LocalizationConfig(match=match))
    mount = log.mount
    log = log.seen_from(mount).corrected()
    bearings, thin = log.beams(), is_thin(log.beams()[0])
    step_s = np.diff(log.times, prepend=log.times[0])
    n = len(log.times)
    poses, covariance = np.zeros((n, 3)), np.zeros((n, 3, 3))
    is_located, kidnapped = np.zeros(n, bool), list[int]()
    last = np.zeros(3)
    for k in watched(range(n), "localization"):
        displacement, spread = config.odometry.predicted(
            log.displacement[k] if log.known[k] else None, float(step_s[k]), last
        )
        scan, _ = scan_points(bearings[k], log.range_m[k], config, thin)
        location = localizer.update(scan, displacement, spread)
        poses[k], covariance[k], is_located[k] = location.pose, location.covariance, location.is_located
        if location.was_kidnapped:
            kidnapped.append(k)
        if k and is_located[k] and not is_located[k - 1]:
            earlier, spreads = localizer.trajectory()
            first = k + 1 - len(earlier)
            poses[first : k + 1], covariance[first : k + 1], is_located[first:k] = earlier, spreads, True
        last = between(poses[k - 1], poses[k]) if k else last
    if mount.any():
        back = between(mount, np.zeros(3))
        turn = np.array([rotation(yaw) for yaw in poses[:, 2]])
        away = turn @ np.append(back[:2], 0.0)
        lever = np.tile(np.eye(3), (n, 1, 1))
        lever[:, 0, 2], lever[:, 1, 2] = -away[:, 1], away[:, 0]
        poses = np.array([compose(pose, back) for pose in poses])
        covariance = lever @ covariance @ lever.transpose(0, 2, 1)
    return Localized(poses=poses, covariance=covariance, is_located=is_located, kidnapped=tuple(kidnapped))
