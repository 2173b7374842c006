"""Localization on a known map: where the robot is at first, how it moves from there, and whether it was carried off.

At first all free places are tried with all headings (correlative scan matching), and the poses that agree best with
the map are followed side by side, each by odometry and scan matching. Poses that contradict the map are dropped; the
robot is located once one pose explains the scans better than all others. A located robot whose scans keep on
contradicting the map is searched for again on the whole map (kidnapped robot).

Where the map knows nothing the pose follows odometry, and its covariance grows.
Reference: Olson, Real-time correlative scan matching, ICRA 2009; Thrun, Burgard and Fox, Probabilistic Robotics,
chapter 8 (global localization and the kidnapped robot).
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from jaxtyping import Float

from robosim.support.checks import Range, checked
from slam.graph.pose_graph import chained
from slam.graph.submaps import OF_SCAN, covariance_of
from slam.mapping.known_map import KnownMap
from slam.matching.levels import ARM_M, difference, nearest_poses
from slam.matching.scan_matching import MatchConfig, ScanPoints, match_from
from slam.poses import Covariance, Pose, compose, rotation

#: Step of places and headings that are tried, the latter at the end of an arm [m].
_STEP_M = 0.25
#: Poses within this are the same [m], with turns at the end of the arm.
_SAME_M = 0.3
#: Standard deviation of a place from which on it is not known [m].
_VAGUE_M = 0.5
#: Covariance of a pose that was found on the lattice [m^2, rad^2].
_FOUND = np.diag([0.2, 0.2, 0.1]) ** 2


@dataclass(frozen=True, kw_only=True)
@checked
class LocalizationConfig:
    """When a robot counts as located, and as lost."""

    match: MatchConfig = field(
        default_factory=lambda: MatchConfig(sigma_m=0.02, outlier_m=0.06, iterations=12, max_range_m=25.0)
    )
    """Settings of scan matching."""
    candidates: Annotated[int, Range(1, 1000, "poses")] = 40
    """Most poses that are followed side by side."""
    memory: Annotated[float, Range(0, 0.99)] = 0.7
    """Weight of earlier scans in the rating of a pose, for each scan."""
    margin: Annotated[float, Range(0, 1)] = 0.15
    """Lead of the best pose over all others at which the robot is located."""
    scans: Annotated[int, Range(1, 1000, "scans")] = 5
    """Fewest scans that a pose explains before the robot is located."""
    agreement: Annotated[float, Range(0, 1)] = 0.5
    """Least rating of a located pose: share of the scan that agrees with the map less the share that contradicts it."""
    contradiction: Annotated[float, Range(0, 1)] = 0.45
    """Share of the scan that contradicts the map at which a located robot is lost."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Location:
    """Pose of the robot on a known map."""

    pose: Float[np.ndarray, "3"]
    """x [m], y [m], yaw [rad] in `map`."""
    covariance: Float[np.ndarray, "3 3"]
    """Of the pose, axes of `map` [m^2, m rad, rad^2]."""
    is_located: bool
    """Whether no other pose explains the scans as well, with a standard deviation below 0.5 m."""
    was_kidnapped: bool = False
    """Whether the robot is searched for since this scan, because it is not where it was believed."""


@dataclass(kw_only=True, eq=False)
class _Candidate:
    """A pose that may be that of the robot."""

    poses: list[Float[np.ndarray, "3"]]
    """Poses at the scans since it is certain, the last one now."""
    covariances: list[Float[np.ndarray, "3 3"]]
    agreement: float = 1.0
    contradiction: float = 0.0
    """Shares of the last scans, see `KnownMap.agreement`."""

    @property
    def covariance(self) -> Float[np.ndarray, "3 3"]:
        """Covariance of the present pose."""
        return self.covariances[-1]

    @property
    def rating(self) -> float:
        """How well the pose explains the scans."""
        return self.agreement - self.contradiction


class Localizer:
    """Locates a robot on a known map from scans and odometry."""

    def __init__(self, known: KnownMap, config: LocalizationConfig = LocalizationConfig()) -> None:
        self.known, self.config = known, config
        self.reset()

    def reset(self, pose: Pose | None = None) -> None:
        """Begin at a pose (x [m], y [m], yaw [rad] in `map`), or anywhere."""
        self._is_located, self._candidates = pose is not None, list[_Candidate]()
        if pose is not None:
            self._candidates = [_Candidate(poses=[np.asarray(pose, float)], covariances=[_FOUND])]

    def update(self, scan: ScanPoints, displacement: Pose, covariance: Covariance) -> Location:
        """Add a scan and the displacement since the one before by odometry, in the frame of that, with covariance."""
        for candidate in self._candidates:
            self._follow(candidate, scan, displacement, covariance)
        self._candidates.sort(key=_worst_last)
        was_kidnapped = False
        if not self._candidates or self._candidates[0].contradiction > self.config.contradiction:
            was_kidnapped, self._is_located = self._is_located, False
            # The pose believed may be right after all, where the building has changed or the map ends.
            self._candidates = sorted(self._candidates[:1] + self._search(scan), key=_worst_last)
        self._drop()
        if not self._candidates:  # nothing was seen yet
            middle = np.append(self.known.places(_STEP_M).mean(axis=0), 0.0)
            return Location(pose=middle, covariance=1e6 * np.eye(3), is_located=False)
        best, *others = self._candidates
        self._is_located &= _deviation_m(best.covariance) < _VAGUE_M
        if len(best.poses) >= self.config.scans and best.rating > self.config.agreement:
            self._is_located |= not others or best.rating - others[0].rating > self.config.margin
        if self._is_located:
            self._candidates = [best]
        return Location(
            pose=best.poses[-1],
            covariance=best.covariance,
            is_located=self._is_located,
            was_kidnapped=was_kidnapped,
        )

    def trajectory(self) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
        """Return the poses at the last scans that led to the present one (x [m], y [m], yaw [rad]), and covariances."""
        if not self._candidates:
            return np.zeros((0, 3)), np.zeros((0, 3, 3))
        return np.array(self._candidates[0].poses), np.array(self._candidates[0].covariances)

    def _follow(
        self, candidate: _Candidate, scan: ScanPoints, displacement: Pose, covariance: Covariance
    ) -> None:
        """Move a candidate by odometry, and fit the scan to the map there."""
        turn = rotation(candidate.poses[-1][2])
        pose = compose(candidate.poses[-1], displacement)
        prior = chained(np.zeros(3), candidate.covariance, turn @ displacement, turn @ covariance @ turn.T)
        match, agreement, contradiction = self.known.fit(scan, pose, prior, self.config.match)
        if match.information.any():
            matched = covariance_of(match.information, scan, OF_SCAN * self.config.match.sigma_m)
            gain = np.linalg.solve(prior + matched, prior).T
            pose = pose + gain @ difference(match.pose, pose, 1.0)
            prior = prior - gain @ prior
        if _deviation_m(candidate.covariance) > _VAGUE_M:
            # What was before is not known to belong to the present pose.
            candidate.poses.clear()
            candidate.covariances.clear()
        candidate.poses.append(pose)
        candidate.covariances.append(0.5 * (prior + prior.T))
        memory = self.config.memory
        candidate.agreement = memory * candidate.agreement + (1 - memory) * agreement
        candidate.contradiction = memory * candidate.contradiction + (1 - memory) * contradiction

    def _search(self, scan: ScanPoints) -> list[_Candidate]:
        """Candidates on the whole map."""
        ends, places = scan.every(), self.known.places(_STEP_M)
        if len(ends) < self.config.match.min_pairs:
            return []
        count = math.ceil(2 * math.pi * ARM_M / _STEP_M)
        turns = np.arange(count) * 2 * math.pi / count
        centre = np.append(places[0], 0.0)
        starts = nearest_poses(
            self.known.levels, ends, centre, places - places[0], turns, count=4 * self.config.candidates
        )
        candidates, fraction = [], 1 - self.config.memory
        for start in starts:
            coarse = match_from(
                self.known.levels.coarse, scan, start, _FOUND, self.config.match, start[None]
            )[0]
            match, agreement, contradiction = self.known.fit(scan, coarse.pose, _FOUND, self.config.match)
            # As after earlier scans that say nothing: a pose that was followed for long needs no less to be dropped.
            candidates.append(
                _Candidate(
                    poses=[match.pose],
                    covariances=[_FOUND],
                    agreement=fraction * agreement,
                    contradiction=fraction * contradiction,
                )
            )
        return candidates

    def _drop(self) -> None:
        """Leave out candidates that are near a better one, or explain the scans far worse than the best."""
        distinct: list[_Candidate] = []
        for candidate in self._candidates:
            apart_m = [math.hypot(*difference(candidate.poses[-1], other.poses[-1])) for other in distinct]
            is_good = not distinct or candidate.rating > distinct[0].rating - 2 * self.config.margin
            if is_good and min(apart_m, default=math.inf) > _SAME_M:
                distinct.append(candidate)
        self._candidates = distinct[: self.config.candidates]


def _deviation_m(covariance: Covariance) -> float:
    """Standard deviation of a place [m]."""
    return math.sqrt(covariance[0, 0] + covariance[1, 1])


def _worst_last(candidate: _Candidate) -> float:
    """Key for sorting."""
    return -candidate.rating
