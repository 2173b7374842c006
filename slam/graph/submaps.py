"""Submaps: scans along a few metres of the trajectory, aligned by odometry and matching, and fitted to each other.

Poses within a submap are fixed; the graph moves submaps. To decide whether two submaps show the same place, the
surfaces of one are fitted to those of the other and compared: a surface where the other saw free space is a
contradiction.

The information of a fit is its curvature, minus what the noise of normals alone contributes on a bare wall: a corridor
gives no information along its axis.
References: Hess et al., Real-time loop closure in 2D lidar SLAM, ICRA 2016 (submaps); Olson, Real-time correlative scan
matching, ICRA 2009; Censi, An accurate closed-form estimate of ICP's covariance, ICRA 2007.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from slam.matching.levels import SurfaceLevels, Surfaces, matches, most_paired
from slam.matching.scan_matching import MatchConfig, ScanPoints
from slam.poses import between, compose, moved_ahead, to_map, wrap

#: Part of the strongest curvature of a fit that the noise of normals adds in every direction.
_OF_NORMALS = 0.02
#: Least standard deviation of a fit relative to that of a point, whatever its curvature: errors of points are
#: correlated, and submaps are not quite rigid. That of a turn is a fifth of it in radians.
OF_SCAN, OF_SUBMAP, _TURN = 0.12, 0.3, 0.2
#: Factor on the standard deviation of fits of submaps, by comparison with ground truth (mean squared error of a fit in
#: its own variances 7 to 19 in homes, halls and offices, where 3 is expected; in corridors less than 2).
_OFF = 2.0
#: Standard deviation along directions without information [m].
_WIDEST_M = 10.0
#: Most points of a submap in a fit.
_FITTED = 800
#: Views of a submap by which another's surfaces are judged.
_VIEWS = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """How far one scan saw in each direction."""

    bearing_rad: Float[np.ndarray, " w"]
    """Directions, 0 straight ahead [rad], rising, from -pi or more on; a full turn may end beyond pi."""
    range_m: Float[np.ndarray, " w"]
    """How far away the surface seen is [m]; negative where there is none: nothing up to that range then."""
    ahead_m: float = 0.0
    """How far ahead of the robot's centre it looks from [m]."""

    def ends(self) -> Float[np.ndarray, "n 2"]:
        """Points (x, y) [m] of the robot's frame at which a surface was seen, with a normal or without."""
        seen = np.flatnonzero(self.range_m > 0)
        bearing, reached = self.bearing_rad[seen], self.range_m[seen]
        return np.column_stack([reached * np.cos(bearing) + self.ahead_m, reached * np.sin(bearing)])


class Submap:
    """Scans at poses in the submap's own frame, and their surfaces."""

    def __init__(self, cell_m: float) -> None:
        """Make one without scans, of fine cells of a size."""
        self.poses: list[Float[np.ndarray, 3]] = []
        """Poses of all scans."""
        self.numbers: list[int] = []
        """Numbers of these scans among all scans of the trajectory."""
        self.loops = 0
        """Number of loops closed from it."""
        self.views: list[tuple[Float[np.ndarray, 3], View]] = []
        """Poses and ranges of scans; once it is packed, of some."""
        self._cell_m = cell_m
        self._levels: SurfaceLevels | None = SurfaceLevels(cell_m)
        self._surfaces: Surfaces | None = None
        self._circle: tuple[float, float, float] | None = None

    def add(self, pose: Float[np.ndarray, "3"], scan: ScanPoints, view: View) -> None:
        """Enter a scan at a pose of the submap's frame."""
        self.poses.append(pose)
        self.views.append((pose, view))
        self.levels.enter(pose, scan)
        self._surfaces = self._circle = None

    @property
    def levels(self) -> SurfaceLevels:
        """Its surfaces in cells."""
        if self._levels is None:
            self._levels = SurfaceLevels(self._cell_m)
            self._levels.take(self.surfaces, np.zeros(3))
        return self._levels

    @property
    def surfaces(self) -> Surfaces:
        """Its surfaces without cells."""
        if self._surfaces is None:
            self._surfaces = self.levels.surfaces()
        return self._surfaces

    def pack(self) -> None:
        """Keep only what later fits need: surfaces without cells, and some views."""
        self._surfaces, self._levels = self.surfaces, None
        self.views = _some_views(self.views)

    def merge(self, other: "Submap", at: Float[np.ndarray, "3"]) -> None:
        """Take the scans of another, whose frame lies at a pose, without what they saw."""
        self.poses += [compose(at, pose) for pose in other.poses]
        self.numbers += other.numbers

    def outline(self) -> ScanPoints:
        """Its surfaces as one scan in its own frame."""
        fine = self.surfaces.fine
        sample = np.linspace(0, len(fine.points) - 1, min(_FITTED, len(fine.points))).astype(int)
        few = np.minimum(fine.weights[sample], 1.0)
        return ScanPoints(points=fine.points[sample], normals=fine.normals[sample], weights=few)

    def circle(self) -> tuple[float, float, float]:
        """Around most of its surfaces: centre (x, y) and radius [m]."""
        if self._circle is None:
            points = self.outline().points
            x, y = points.mean(axis=0) if len(points) else np.zeros(2)
            away_m = np.hypot(*(points - [x, y]).T)
            self._circle = x, y, float(np.percentile(away_m, 80)) if len(points) else 0.0
        return self._circle


def poses_of_scans(
    anchors: Sequence[Float[np.ndarray, "3"]], submaps: Sequence[Submap]
) -> Float[np.ndarray, "n 3"]:
    """Poses of all scans of a trajectory in `map` (x, y [m], yaw [rad]), by the poses of its submaps."""
    poses = np.zeros((sum(len(submap.numbers) for submap in submaps), 3))
    for anchor, submap in zip(anchors, submaps, strict=True):
        if submap.poses:
            local = np.array(submap.poses)
            yaw = wrap(anchor[2] + local[:, 2])
            poses[submap.numbers] = np.column_stack([to_map(anchor, local[:, :2]), yaw])
    return poses


def observed(information: Float[np.ndarray, "3 3"], scan: ScanPoints) -> Float[np.ndarray, "3 3"]:
    """Information of a fit about a pose, without the contribution of the noise of normals on a bare wall."""
    # About the point where shifts and turns are independent: about the robot, with all points to one side, turns and
    # shifts are so similar that a corner would look like a bare wall.
    values, axes = np.linalg.eigh(information[:2, :2])
    noise = _OF_NORMALS * max(values[-1], 0.0)
    values = np.maximum(values - noise, 0.0)
    along = axes.T @ information[:2, 2]
    is_known = values > 0
    lever = np.where(is_known, along / np.where(is_known, values + noise, 1.0), 0.0)
    spread = (
        float(((scan.points - scan.points.mean(axis=0)) ** 2).sum(axis=1).mean()) if len(scan.points) else 1.0
    )
    turn = max(float(information[2, 2] - along @ lever) - 2 * noise * max(spread, 0.01), 0.0)
    shift = np.column_stack([axes.T, lever])
    return np.asarray(shift.T @ (values[:, None] * shift) + np.diag([0.0, 0.0, turn]))


def least_covariance(least_m: float) -> Float[np.ndarray, "3 3"]:
    """Return the covariance of a pose that errs by a distance, and by as much in its turn."""
    return np.diag([least_m, least_m, _TURN * least_m]) ** 2


def covariance_of(
    information: Float[np.ndarray, "3 3"], scan: ScanPoints, least_m: float
) -> Float[np.ndarray, "3 3"]:
    """Covariance of a fit that is off by so much at least, wide where it says nothing."""
    wide = np.diag([_WIDEST_M**-2, _WIDEST_M**-2, 1.0])
    return np.asarray(np.linalg.inv(observed(information, scan) + wide) + least_covariance(least_m))


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Alignment of a submap with another."""

    pose: Float[np.ndarray, "3"]
    """Pose of the submap in the frame of the other."""
    covariance: Float[np.ndarray, "3 3"]
    """Covariance of that pose, in the frame of the other."""
    overlap: int
    """Surfaces of both that the other saw too."""
    agreement: float
    """Part of the surfaces seen by both that do not contradict."""


def fit(
    source: Submap,
    other: Submap,
    predicted: Float[np.ndarray, "3"],
    covariance: Float[np.ndarray, "3 3"],
    matching: MatchConfig,
    error: float = OF_SUBMAP,
) -> Fit | None:
    """Fit one submap to another.

    Args:
        source: The submap that is moved.
        other: The submap in whose frame it is.
        predicted: Pose of the one in the frame of the other: x [m], y [m], yaw [rad].
        covariance: Of that pose.
        matching: Settings of matching.
        error: Least standard deviation of the fit, relative to that of a point.

    Returns:
        The pose that contradicts least; None if nothing is near.
    """
    outline = source.outline()
    if len(outline.points) < matching.min_pairs:
        return None
    best: Fit | None = None
    for match in matches(other.levels, outline, predicted, covariance, matching, most_paired):
        if not match.paired.any():
            continue
        overlap, agreement = judge_fit(source, other, match.pose)
        least_covariance = covariance_of(match.information, outline, error * matching.sigma_m)
        candidate = Fit(
            pose=match.pose,
            covariance=_OFF**2 * least_covariance,
            overlap=overlap,
            agreement=agreement,
        )
        if best is None or candidate.overlap * candidate.agreement**4 > best.overlap * best.agreement**4:
            best = candidate
    return best


def judge_fit(source: Submap, other: Submap, pose: Float[np.ndarray, "3"]) -> tuple[int, float]:
    """Return surfaces of each that the other saw too, and the part of those it saw that it does not contradict."""
    back = between(pose, np.zeros(3))
    seen = contradicted = 0
    for surfaces, viewer, place in ((source, other, pose), (other, source, back)):
        views = Views.of(_some_views(viewer.views))
        same, against = seen_by(views, to_map(place, surfaces.outline().points))
        seen += int(same.sum())
        contradicted += int((against & ~same).sum())
    return seen, seen / max(seen + contradicted, 1)


def _some_views(
    views: list[tuple[Float[np.ndarray, "3"], View]],
) -> list[tuple[Float[np.ndarray, "3"], View]]:
    """Views by which another submap's surfaces are judged."""
    return [views[k] for k in np.unique(np.linspace(0, len(views) - 1, _VIEWS).astype(int))] if views else []


class Views(NamedTuple):
    """Views from some poses, one after another."""

    poses: Float[np.ndarray, "v 3"]
    bounds: Int[np.ndarray, " v+1"]
    """Where the beams of each begin and end."""
    bearing_rad: Float[np.ndarray, " w"]
    range_m: Float[np.ndarray, " w"]

    @classmethod
    def of(cls, views: Sequence[tuple[Float[np.ndarray, "3"], View]]) -> "Views":
        """From poses and what was seen there."""
        return cls(
            np.array([moved_ahead(pose, view.ahead_m) for pose, view in views]).reshape(-1, 3),
            np.cumsum([0, *(len(view.range_m) for _, view in views)]),
            np.concatenate([[], *(view.bearing_rad for _, view in views)]),
            np.concatenate([[], *(view.range_m for _, view in views)]),
        )


def seen_by(
    views: Views, points: Float[np.ndarray, "n 2"]
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Which points (x, y) [m] views saw a surface at, and which they looked through."""
    same, through = np.zeros(len(points), bool), np.zeros(len(points), bool)
    _look(*views, points, same, through)
    return same, through


def looked_through(views: Views, points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Which points (x, y) [m] beams of views went through."""
    return seen_by(views, points)[1]


@compiled
def _look(
    poses: np.ndarray,
    bounds: np.ndarray,
    bearings: np.ndarray,
    ranges: np.ndarray,
    points: np.ndarray,
    same: np.ndarray,
    through: np.ndarray,
) -> None:
    """Mark the points at which beams saw a surface, and those that they went through."""
    for view in range(len(poses)):
        pose = poses[view]
        beams = slice(bounds[view], bounds[view + 1])
        bearing, reached = bearings[beams], ranges[beams]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        for k in range(len(points)):
            dx, dy = points[k, 0] - pose[0], points[k, 1] - pose[1]
            distance_m = np.hypot(dx, dy)
            direction = np.arctan2(c * dy - s * dx, c * dx + s * dy)
            if direction < bearing[0]:
                direction += 2 * np.pi
            beam = np.searchsorted(bearing, direction)
            if beam == 0 or beam == len(bearing):
                continue
            near_m = 0.1 + 0.01 * distance_m
            # Between beams that are far apart nothing is known.
            if distance_m * min(bearing[beam] - direction, direction - bearing[beam - 1]) > near_m:
                continue
            left, right = reached[beam - 1], reached[beam]
            if min(abs(left - distance_m), abs(right - distance_m)) < near_m:
                same[k] = True
            if distance_m < min(abs(left), abs(right)) - 3 * near_m:
                through[k] = True
