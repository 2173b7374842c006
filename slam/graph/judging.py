"""Choice among poses of a scan: it must lie on surfaces and contradict recent scans least.

A surface that one of two scans looked through is a contradiction, whether its normal is known or not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from slam.graph.submaps import View, Views, seen_by
from slam.matching.levels import difference
from slam.matching.scan_matching import Match
from slam.poses import to_map

#: Weight of the contradicting part of a scan, relative to the agreeing part.
_OF_AGAINST = 2.0
#: Weight of the squared deviation from the prediction, in variances.
_OF_PRIOR = 0.03


@dataclass(frozen=True, kw_only=True, eq=False)
class Judge:
    """Rates matches of a scan."""

    view: View
    """Ranges of the scan."""
    recent: Sequence[tuple[Float[np.ndarray, "3"], View]]
    """Poses and ranges of recent scans."""
    predicted: Float[np.ndarray, "3"]
    """Pose of the scan by odometry: x [m], y [m], yaw [rad]."""
    covariance: Float[np.ndarray, "3 3"]
    """Covariance of the pose."""

    def __call__(self, match: Match) -> float:
        """Rating of a match by the scan and recent ones: more is better."""
        if not len(self._ends):
            return 0.0
        confirmed, through = seen_by(self._recent_views, to_map(match.pose, self._ends))
        against = float((through & ~confirmed).mean())
        ends, of_scan = self._recent_ends
        if len(ends):
            same, through = seen_by(Views.of([(match.pose, self.view)]), ends)
            against += float((of_scan * (through & ~same)).sum())
        agrees = float(match.paired.mean()) + float(confirmed.mean())
        away = difference(match.pose, self.predicted, 1.0)
        return (
            agrees - _OF_AGAINST * against - _OF_PRIOR * float(away @ np.linalg.solve(self.covariance, away))
        )

    @cached_property
    def _ends(self) -> Float[np.ndarray, "n 2"]:
        return self.view.ends()

    @cached_property
    def _recent_views(self) -> Views:
        return Views.of(self.recent)

    @cached_property
    def _recent_ends(self) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, " m"]]:
        """Points of recent scans in `map` [m], and weights with which each scan counts the same."""
        ends = [to_map(pose, view.ends()) for pose, view in self.recent]
        ends = [points for points in ends if len(points)] or [np.zeros((0, 2))]
        shares = [np.full(len(points), 1 / max(len(points), 1) / len(ends)) for points in ends]
        return np.concatenate(ends), np.concatenate(shares)
