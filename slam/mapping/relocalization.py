"""Relocalization: detects that the estimated pose is wrong, and finds the robot again on its own map.

Contradictions distinguish a lost robot from one that sees something new: surfaces in the middle of cells that are
certainly free on the map, far from any obstacle, or surfaces seen through a wall that is taller than the camera. The
true pose makes hardly any; a pose half a metre off makes many, as soon as anything but one bare wall is in view. A
new room makes none, because unknown cells contradict nothing.

A lost robot is searched for by correlative scan matching, coarse to fine: poses on a lattice around the one believed
are scored by how near to obstacles of the map the scan comes, a few of the best are refined by `match_scan`, and the
one that contradicts the map least is taken, if it does so clearly less. A longer search takes in all headings.

A wrong jump costs more than a late one. So the search begins only after several consecutive scans contradict the map,
unless odometry itself is uncertain, and a new pose is accepted only when a second scan, from the next place, confirms
it.
Left out: rooms that look alike within the search; the whole building as search space.
Reference: Olson, Real-time correlative scan matching, ICRA 2009.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from jaxtyping import Float, Float32

from robosim.support.checks import Range, checked
from slam.grid import GridFrame
from slam.mapping.occupancy import OccupancyGrid
from slam.matching.scan_matching import Match, MatchConfig, ScanPoints, match_scan
from slam.matching.surfaces import SurfaceGrid
from slam.poses import Pose, compose, to_map, wrap


@dataclass(frozen=True, kw_only=True)
@checked
class RelocalizationConfig:
    """When a robot counts as lost, and how it is searched for."""

    contradiction: Annotated[float, Range(0, 1)] = 0.2
    """Share of a scan in firmly free space above which the pose is doubted."""
    settled: Annotated[float, Range(1e-6, 1)] = 0.08
    """Share below which a new pose is accepted."""
    near_m: Annotated[float, Range(0, 10, "m")] = 0.12
    """A point this near to an obstacle of the map does not contradict it [m]."""
    min_points: Annotated[int, Range(1, 1_000_000, "points")] = 20
    """Scans with fewer points are ignored."""
    search_m: Annotated[float, Range(0.01, 100, "m")] = 0.8
    """Half side of the square that is searched [m]."""
    search_rad: Annotated[float, Range(1e-3, math.pi, "rad")] = math.radians(30.0)
    """Headings to both sides that are searched first [rad]; all of them after `narrow_tries`."""
    patience: Annotated[int, Range(0, 1_000_000, "frames")] = 2
    """Doubted frames in a row before the search begins, if odometry is certain of the pose."""
    sure_m: Annotated[float, Range(0, 100, "m")] = 0.1
    """Odometry is certain if its standard deviation is below this [m]."""
    same_m: Annotated[float, Range(0, 100, "m")] = 0.15
    """Places found from two frames agree if they are this near to each other [m]."""
    same_rad: Annotated[float, Range(0, math.pi, "rad")] = math.radians(5.0)
    """The same for their headings [rad]."""
    narrow_tries: Annotated[int, Range(0, 1_000_000, "frames")] = 6
    """Frames searched for small turns only."""
    tries: Annotated[int, Range(1, 1_000_000, "frames")] = 20
    """Frames after which the map counts as wrong rather than the pose: scans are entered again."""

    def __post_init__(self) -> None:
        if not self.settled < self.contradiction:
            raise ValueError(
                f"settled is {self.settled} and contradiction {self.contradiction}, expected the first below the other."
            )


#: Steps of the lattice of poses [m, rad], points of the scan used, and poses refined.
STEP_M, STEP_RAD, POINTS, REFINED = 0.1, math.radians(4.0), 48, 12
#: Decrease of the score of a pose per metre, or radian, from the estimated one.
FAR_PRICE = 0.2
#: The same for poses on the lattice: small, so that the nearest of equal places comes first.
LATTICE_PRICE = 0.05
#: Distance from an obstacle at which a point scores exp(-1/2) [m].
_BLUR_M = 0.1
#: Probability below which a cell is firmly free, and above which it is firmly solid.
_FIRMLY_FREE, _FIRMLY_SOLID = 0.25, 0.85


class Surroundings:
    """Distances to obstacles, and certainly free cells, in a window of the map."""

    def __init__(
        self,
        occupancy: OccupancyGrid,
        low_xy: Float[np.ndarray, "2"],
        high_xy: Float[np.ndarray, "2"],
        eye_m: float,
    ) -> None:
        low, high = (float(low_xy[0]), float(low_xy[1])), (float(high_xy[0]), float(high_xy[1]))
        rows, columns, self.frame = occupancy.frame.window(low, high)
        probability = occupancy.probability[rows, columns]
        free = (probability <= 0.5).astype(np.uint8)
        self._firm = probability < _FIRMLY_FREE
        self._opaque = (probability > _FIRMLY_SOLID) & (occupancy.top_m[rows, columns] > eye_m + 0.05)
        cell = self.frame.resolution_m
        # Without any obstacle OpenCV's distances are huge, as they should be.
        self.gap_m: Float32[np.ndarray, "ny nx"] = cell * cv2.distanceTransform(
            free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE
        )

    def contradiction(self, pose: Pose, points: Float[np.ndarray, "n 2"], near_m: float) -> float:
        """Share of surface points, seen from a pose, that contradict this map."""
        world = to_map(pose, points)
        iy, ix, inside = _cells(self.frame, world)
        misplaced = inside & self._firm[iy, ix] & (self.gap_m[iy, ix] > near_m)
        range_m = np.hypot(*points.T)
        along = np.arange(0.3, max(float(range_m.max()), 0.4), 2 * self.frame.resolution_m)
        rays = pose[:2] + (world - pose[:2])[:, None] * (along / range_m[:, None])[..., None]
        iy, ix, inside = _cells(self.frame, rays)
        before = along < range_m[:, None] - 1.5 * near_m
        through = (inside & before & self._opaque[iy, ix]).any(axis=1)
        return float((misplaced | through).mean())


def _cells(
    frame: GridFrame, points: Float[np.ndarray, "*batch 2"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, column, and whether a point lies on the grid; 0, 0 outside."""
    iy, ix = frame.index(points)
    inside = np.asarray(frame.inside(iy, ix))
    return np.where(inside, iy, 0), np.where(inside, ix, 0), inside


def _thinned(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m 2"]:
    """Evenly chosen points of a scan, enough to judge a pose."""
    return points[np.linspace(0, len(points) - 1, min(POINTS, len(points))).astype(int)]


class Relocalizer:
    """Judges every pose of scan matching, and searches for a better one if it contradicts the map."""

    def __init__(self, config: RelocalizationConfig = RelocalizationConfig()) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget all doubts."""
        self._tried = 0
        self._found: Float[np.ndarray, 3] | None = None
        self.lost = False
        """Whether the last pose was doubted and no better one found; its scan must not be entered."""

    def judge(
        self,
        match: Match,
        points: ScanPoints,
        displacement: Pose,
        deviation_m: float,
        occupancy: OccupancyGrid,
        surfaces: SurfaceGrid,
        matching: MatchConfig,
        eye_m: float,
    ) -> tuple[Match, bool]:
        """The match given, or a better one from farther away.

        Args:
            match: What scan matching found near the prediction.
            points: The scan.
            displacement: Displacement since the scan before: x, y [m], yaw [rad] in the robot's frame before it.
            deviation_m: Standard deviation of the place before the match [m].
            occupancy: The map.
            surfaces: Its surfaces.
            matching: How scans are matched.
            eye_m: Height of the camera [m].

        Returns:
            The match to believe, and whether it comes from a search, so that odometry has nothing to learn from it.
        """
        config = self.config
        self.lost = False
        expected = None if self._found is None else compose(self._found, displacement)
        self._found = None
        if len(points.points) < config.min_points:
            return match, False
        sample = _thinned(points.points)
        seen = np.vstack([to_map(match.pose, sample), match.pose[:2]])
        margin_m = 2 * config.near_m
        view = Surroundings(occupancy, seen.min(axis=0) - margin_m, seen.max(axis=0) + margin_m, eye_m)
        doubt = view.contradiction(match.pose, sample, config.near_m)
        if doubt <= config.contradiction:
            self._tried = 0
            return match, False
        self._tried += 1
        if self._tried > config.tries:
            # As many scans are entered now as were not; if doubts remain after that, the search begins again.
            self._tried %= 2 * config.tries
            return match, True
        if self._tried <= config.patience and deviation_m < config.sure_m:
            self.lost = True
            return match, True
        reach = matching.max_range_m + config.search_m
        around = Surroundings(occupancy, match.pose[:2] - reach, match.pose[:2] + reach, eye_m)
        candidate = self._search(match.pose, points, around, surfaces, matching)
        if candidate is None or expected is None or not self._same(candidate.pose, expected):
            self._found = None if candidate is None else candidate.pose
            self.lost = True
            return match, True
        self._tried = 0
        return candidate, True

    def _same(self, pose: Pose, other: Pose) -> bool:
        near = math.hypot(*(pose - other)[:2]) < self.config.same_m
        return bool(near and abs(wrap(pose[2] - other[2])) < self.config.same_rad)

    def _search(
        self,
        pose: Pose,
        points: ScanPoints,
        around: Surroundings,
        surfaces: SurfaceGrid,
        matching: MatchConfig,
    ) -> Match | None:
        """The refined pose with least contradiction; None if that is too much."""
        config = self.config
        narrow = self._tried <= config.narrow_tries
        candidates = _lattice(
            pose, points.points, around, config.search_m, config.search_rad if narrow else math.pi
        )
        covariance = np.diag([STEP_M**2, STEP_M**2, STEP_RAD**2])
        best, best_score = None, -math.inf
        for candidate in candidates:
            match = match_scan(surfaces, points, candidate, covariance, matching)
            doubt = around.contradiction(match.pose, points.points, config.near_m)
            share = float(match.paired.mean())
            # Along a bare wall all places are equally good: choose the nearest.
            far = math.hypot(*(match.pose - pose)[:2]) + abs(wrap(match.pose[2] - pose[2]))
            score = share - doubt - FAR_PRICE * far
            # Far from the map a scan contradicts nothing: it must also lie on surfaces.
            if doubt < config.settled and share > 0.5 and score > best_score:
                best, best_score = match, score
        return best


def _lattice(
    pose: Pose, points: Float[np.ndarray, "n 2"], around: Surroundings, half_m: float, half_rad: float
) -> Float[np.ndarray, "k 3"]:
    """The best poses of a lattice around one, no two of them neighbours."""
    sample = _thinned(points)
    likely = np.exp(-0.5 * (np.minimum(around.gap_m, 9.0) / _BLUR_M) ** 2)
    n = round(half_m / STEP_M)
    shift = np.arange(-n, n + 1) * STEP_M
    dx, dy = (axis.ravel() for axis in np.meshgrid(shift, shift))
    turns = np.arange(-round(half_rad / STEP_RAD), round(half_rad / STEP_RAD) + 1) * STEP_RAD
    scores = np.empty((len(turns), len(dx)))
    for k, turn in enumerate(turns):
        world = to_map(np.array([pose[0], pose[1], pose[2] + turn]), sample)
        iy, ix, inside = _cells(around.frame, world[None] + np.stack([dx, dy], axis=-1)[:, None])
        scores[k] = np.where(inside, likely[iy, ix], 0.0).mean(axis=1)
        scores[k] -= LATTICE_PRICE * (np.hypot(dx, dy) + abs(turn))
    best: list[np.ndarray] = []
    for flat in np.argsort(-scores, axis=None):
        k, j = divmod(int(flat), len(dx))
        candidate = np.array([pose[0] + dx[j], pose[1] + dy[j], wrap(pose[2] + turns[k])])
        apart = [
            math.hypot(*(candidate - b)[:2]) > 1.5 * STEP_M or abs(wrap(candidate[2] - b[2])) > 1.5 * STEP_RAD
            for b in best
        ]
        if all(apart):
            best.append(candidate)
        if len(best) == REFINED:
            break
    return np.array(best)
