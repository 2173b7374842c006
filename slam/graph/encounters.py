"""Relative pose of two robots from encounters: directions of each other at both ends, and the distance.

Each robot knows its pose in a frame of its own only. With X the pose of the second frame in the first, an encounter
measures the directions and the distance between a and X b, where a and b are both poses at that moment. A single
encounter gives X in closed form; over all of them X minimises

    sum_k rho(e_k^2 / sigma_k^2),

with rho the Cauchy loss; encounters that agree with it are then fitted by least squares. Directions off a reflection
are wrong altogether. Therefore X is accepted only if most encounters agree with it, at several places, far more than
with any other X, and if its covariance is small.

Left out: poses at past encounters remain as they were estimated then, also after loops close.
References: Martinelli, Pont, Siegwart, Multi-robot localization using relative observations, ICRA 2005; Zhou,
Roumeliotis, Robot-to-robot relative pose estimation from range measurements, IEEE Transactions on Robotics 24 (2008).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import OptimizeResult, least_squares

from slam.poses import between, compose, rotation, wrap

#: Deviations of poses on both maps, which bend: shift [m] and turn [rad] of each encounter, and of all together.
_POSE_M, _POSE_RAD = 0.02, 0.004
_BENT = np.diag([0.02, 0.02, 0.004]) ** 2
#: Squared error of an encounter, in variances, up to which it agrees (99.9 % of three numbers).
_SAME = 16.27
#: Least encounters that agree, their least part, and how many times more they are than for another relative pose.
_LEAST, _PART, _LEAD = 4, 0.6, 2.0
#: Encounters less apart than this of both robots are one place [m].
APART_M = 0.4
#: Largest standard deviations of an accepted pose [m, rad].
_SURE_M, _SURE_RAD = 0.2, np.radians(1.5)
#: Least information of an accepted pose in any direction [1/m^2, 1/rad^2].
_OPEN = 1.0
#: Encounters from which the search begins, at most.
_TRIED = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Encounter:
    """Two robots that see each other at one moment."""

    first: Float[np.ndarray, "3"]
    """Pose of one robot in its own frame: x [m], y [m], yaw [rad]."""
    second: Float[np.ndarray, "3"]
    """Pose of the other in its own frame."""
    bearing_rad: tuple[float, float]
    """Azimuth of the other robot from the one, and of the one from the other, each in the observer's body frame."""
    sigma_rad: tuple[float, float]
    """Standard deviations of both."""
    range_m: float
    """Distance between them [m]."""
    sigma_m: float
    """Standard deviation of the distance [m]."""

    def relative(self) -> Float[np.ndarray, "3"]:
        """Pose of the second frame in the first, by this encounter alone."""
        here, there = self.bearing_rad
        ahead = np.array([self.range_m * np.cos(here), self.range_m * np.sin(here), here + np.pi - there])
        return compose(compose(self.first, ahead), between(self.second, np.zeros(3)))


class RelativePose(NamedTuple):
    """Pose of a frame in another one."""

    pose: Float[np.ndarray, "3"]
    """x [m], y [m], yaw [rad]."""
    covariance: Float[np.ndarray, "3 3"]
    """Covariance of the pose, in the axes of the frame that it is in [m^2, m rad, rad^2]."""


def relative_pose(encounters: Sequence[Encounter]) -> RelativePose | None:
    """Pose of the second robot's frame in that of the first; None while it does not follow without doubt.

    Encounters should be apart (`APART_M`): the error of two at one place may be the same.
    """
    if len(encounters) < _LEAST:
        return None
    errors = _Errors(encounters)
    sample = np.unique(np.linspace(0, len(encounters) - 1, min(_TRIED, len(encounters))).astype(int))
    poses = [errors.minimised(encounters[k].relative(), loss="cauchy").x for k in sample.tolist()]
    agreeing = [errors.squared(pose) < _SAME for pose in poses]
    best = int(np.argmax([agrees.sum() for agrees in agreeing]))
    count = int(agreeing[best].sum())
    if count < max(_LEAST, _PART * len(encounters)):
        return None
    solution = _Errors([encounters[k] for k in np.flatnonzero(agreeing[best]).tolist()]).minimised(
        poses[best]
    )
    information = solution.jac.T @ solution.jac
    # Poses along one line, or a robot that only turns, leave the pose open.
    if np.linalg.eigvalsh(information)[0] < _OPEN:
        return None
    scale = max(1.0, 2 * solution.cost / (3 * count - 3))
    pose = np.array([*solution.x[:2], wrap(float(solution.x[2]))])
    covariance = scale * np.linalg.inv(information) + rotation(pose[2]) @ _BENT @ rotation(pose[2]).T
    deviation = np.sqrt(np.diag(covariance))
    if np.hypot(*deviation[:2]) > _SURE_M or deviation[2] > _SURE_RAD:
        return None
    for other, agrees in zip(poses, agreeing, strict=True):
        away = np.array([*(other - pose)[:2], wrap(float(other[2] - pose[2]))])
        is_other = away @ np.linalg.solve(covariance, away) > _SAME
        if is_other and _LEAD * agrees.sum() > count:
            return None
    return RelativePose(pose, covariance)


class _Errors:
    """Differences between what encounters measured and what a relative pose predicts, in standard deviations."""

    def __init__(self, encounters: Sequence[Encounter]) -> None:
        self._first, self._second = (
            np.array([getattr(encounter, name) for encounter in encounters]) for name in ("first", "second")
        )
        self._bearing = np.array([encounter.bearing_rad for encounter in encounters])
        self._range = np.array([encounter.range_m for encounter in encounters])
        sigma_rad = np.array([encounter.sigma_rad for encounter in encounters])
        sigma_m = np.array([encounter.sigma_m for encounter in encounters])
        aside = _POSE_M / np.maximum(self._range, 0.1)
        self._sigma_rad = np.sqrt(sigma_rad**2 + _POSE_RAD**2 + aside[:, None] ** 2)
        self._sigma_m = np.hypot(sigma_m, _POSE_M)

    def __call__(self, pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, " m"]:
        """Errors of all encounters: directions of the second robots, those of the first ones, distances."""
        c, s = np.cos(pose[2]), np.sin(pose[2])
        place = self._second[:, :2] @ np.array([[c, s], [-s, c]]) + pose[:2]
        away = place - self._first[:, :2]
        azimuth = np.arctan2(away[:, 1], away[:, 0])
        there = azimuth - self._first[:, 2] - self._bearing[:, 0]
        back = azimuth + np.pi - self._second[:, 2] - pose[2] - self._bearing[:, 1]
        turns = wrap(np.column_stack([there, back])) / self._sigma_rad
        return np.concatenate([turns.T.ravel(), (np.hypot(*away.T) - self._range) / self._sigma_m])

    def squared(self, pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, " n"]:
        """Squared error of each encounter, in variances."""
        return np.asarray((self(pose).reshape(3, -1) ** 2).sum(axis=0))

    def minimised(self, pose: Float[np.ndarray, "3"], loss: str = "linear") -> OptimizeResult:
        """The solution of least squares that is reached from a pose."""
        return least_squares(self, pose, loss=loss, x_scale=(1.0, 1.0, 0.3))
