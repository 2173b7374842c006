"""Pose tracking from odometry and scans, with scan matching and a pose graph.

Each scan is matched to the consistent surfaces around, and combined with odometry by covariances: where a scan gives no
information, along a corridor, the pose grows uncertain along it. Every few metres a submap is closed and fitted to all
others that may show the same place; a fit becomes a constraint of the graph. If odometry is so uncertain that the other
submap must be searched for, the fit counts only once more fits of neighbours confirm it than contradict it. When the
graph changes, all poses follow. Submaps that show nothing new are merged with others.

One fit is computed with each scan, so the time of an update is bounded; a closed loop takes effect some scans later.
`Tracker.finish` fits all submaps again at the end, when poses are known better.
Reference: Hess et al., Real-time loop closure in 2D lidar SLAM, ICRA 2016; Mangelson et al., Pairwise consistent
measurement set maximization for robust multi-robot map merging, ICRA 2018 (the second fit).
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from slam.graph.alongside import mirror_image_angle_rad
from slam.graph.judging import Judge
from slam.graph.landmarks import Landmarks, Transmitter
from slam.graph.least_squares import Constraint
from slam.graph.loop_closing import LoopCloser
from slam.graph.pose_graph import PoseGraph, chained
from slam.graph.submaps import (
    OF_SCAN,
    Submap,
    View,
    Views,
    covariance_of,
    least_covariance,
    looked_through,
    seen_by,
)
from slam.graph.tracked_map import TrackedMap
from slam.graph.tracker_config import TrackerConfig
from slam.graph.wall_compass import WallCompass
from slam.matching.levels import SurfaceLevels, difference, matches
from slam.matching.scan_matching import Match, ScanPoints
from slam.matching.thin_scans import RecentPoints
from slam.poses import between, compose, rotation, to_map, wrap
from slam.sensing.bearings import Bearing

#: A submap is merged with another if at least so many fit it, and of its surfaces this part is seen by so many.
_HELD, _COVERED, _SHOWN = 3, 0.9, 5
#: Scans and distance [m] after which a submap is closed if one within this distance [m] is not known to fit.
_SOON, _SOON_M, _NEIGHBOUR_M = 12, 1.0, 8.0
#: Submaps are closed early if sources are received and the heading is more uncertain than this [rad].
_VAGUE_RAD = math.radians(0.1)
#: The graph is solved once closed loops and walls deviate from its poses by more in all, and by more when none wait
#: [m, a radian as a metre].
_UNSOLVED_M, _CONFIRMED_M = 0.02, 0.005
#: The surfaces around are merged again when a pose changes by more [m].
_MOVED_M = 0.002
#: Fits may deviate by this many times the covariance of the prediction.
_LOOSENED = 9.0
#: Additional uncertainty of a relocalized robot [m, rad].
_OFF_M, _OFF_RAD = 0.1, math.radians(3.0)
#: Number of recent scans that judge a pose.
_RECENT = 4
#: Standard deviation of a bearing by mirror images next to it, relative to their angle.
_PULLED = 0.5
#: Submaps farther away are not matched to [m].
_AROUND_M = 25.0
#: Most submaps around that a scan is matched to, the nearest: nearer ones have seen the same surfaces.
_MOST_AROUND = 40
_DEFAULTS = TrackerConfig()


class Tracker(TrackedMap):
    """Tracks a robot, and corrects its trajectory when loops close."""

    def __init__(self, config: TrackerConfig = _DEFAULTS) -> None:
        self.config = config
        self._least_m = OF_SCAN * config.match.sigma_m
        self.reset(np.zeros(3))

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """Forget everything and begin at a pose: x [m], y [m], yaw [rad] in `map`."""
        self.pose = np.asarray(pose, float).copy()
        self.graph = PoseGraph(self.pose)
        self.submaps = [Submap(self.config.cell_m)]
        self.landmarks = Landmarks()
        self._compass = WallCompass() if self.config.walls else None
        self._n_bearings = 0
        self._here = np.zeros(3)
        self._spread = self._blind = np.zeros((3, 3))
        self._distance_m = self._turned_rad = 0.0
        self._loops = LoopCloser(self.config, self.graph, self.submaps)
        self._around = SurfaceLevels(self.config.cell_m)
        self._apart = False
        self._unsolved_m = 0.0
        self._recent = RecentPoints(self.config.cell_m)
        self._n_scans, self._n_judged = 0, 1

    def predict(
        self, displacement: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "3 3"]
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Move by odometry; returns the pose, and its covariance relative to recent surfaces, axes of `map`."""
        self._spread = chained(self._here, self._spread, displacement, covariance)
        self._blind = chained(self._here, self._blind, displacement, covariance)
        self._place(compose(self.pose, displacement))
        return self.pose, self.covariance

    @property
    def covariance(self) -> Float[np.ndarray, "3 3"]:
        """Return the covariance of the pose relative to recent surfaces, axes of `map` [m^2, m rad, rad^2]."""
        return self._in_map(self._spread)

    def match(self, scan: ScanPoints, view: View) -> Match:
        """Fit a scan, taken at the predicted pose, to the surfaces around."""
        prior = self._in_map(self._spread + 4 * least_covariance(self._least_m))
        # Wide enough for the scan: `accept` weighs it against the prediction.
        recent = [
            (compose(anchor, pose), before)
            for anchor, submap in zip(self.graph.poses[-2:], self.submaps[-2:], strict=True)
            for pose, before in submap.views
        ][-_RECENT:]
        judge = Judge(view=view, recent=recent, predicted=self.pose, covariance=prior)
        candidates = matches(self._around, scan, self.pose, prior, self.config.match, judge, _LOOSENED)
        return candidates[0] if len(candidates) == 1 else max(candidates, key=judge)

    def accept(self, match: Match, scan: ScanPoints, view: View) -> bool:
        """Take in a scan where it was matched; returns whether past poses changed."""
        if match.information.any():
            turn = rotation(self.graph.poses[-1][2])
            matched = covariance_of(turn.T @ match.information @ turn, scan, self._least_m)
            gain = np.linalg.solve(self._spread + matched, self._spread).T
            away = difference(match.pose, self.pose, 1.0)
            self._spread = self._spread - gain @ self._spread
            self._place(self.pose + turn @ gain @ turn.T @ away)
        if scan.thin:
            scan = self._lines(scan, view)
        self.submaps[-1].add(self._here, scan, view)
        self.submaps[-1].numbers.append(self._n_scans)
        self._n_scans += 1
        self._around.enter(self.pose, scan)
        if self._loops.queue:
            self._unsolved_m += self._loops.try_next()
        # Fits that confirm the poses wait for each other.
        has_changed = self._settle(_UNSOLVED_M if self._loops.queue else _CONFIRMED_M)
        # Submaps around that are not known to fit are tried soon.
        max_scans = self.config.submap_scans
        if self._apart and self._distance_m > _SOON_M:
            max_scans = min(_SOON, max_scans)
        if (
            self._distance_m >= self.config.submap_m
            or len(self.submaps[-1].poses) >= max_scans
            or self._vague()
        ):
            has_changed |= self._begin()
        return has_changed

    def _lines(self, scan: ScanPoints, view: View) -> ScanPoints:
        """Surfaces that a thin scan adds, together with recent ones, in the robot's frame."""
        self._recent.add(self._here, scan)
        views = Views.of([*self.submaps[-1].views, (self._here, view)])
        surfaces = self._recent.new_surfaces(partial(looked_through, views))
        return surfaces.at(between(self._here, np.zeros(3)))

    def _vague(self) -> bool:
        """Whether sources can improve the heading since the submap was begun."""
        return self.landmarks.taken > self._n_bearings and bool(self._spread[2, 2] > _VAGUE_RAD**2)

    def listen(self, bearings: Sequence[Bearing]) -> None:
        """Add bearings of sources from the pose of the last scan; they constrain it once the submap is closed."""
        if self.config.radio:
            widened = self._with_wall_images(bearings)
            self.landmarks.see(self.graph, self._here, self._spread + self._drift(), widened)

    def _with_wall_images(self, bearings: Sequence[Bearing]) -> list[Bearing]:
        """Bearings with the additional uncertainty of walls along them."""
        points, normals, _ = self._around.fine.planes()
        widened = []
        for bearing in bearings:
            pulled_rad = (
                _PULLED * mirror_image_angle_rad(bearing, self.pose, points, normals)
                if bearing.apart_rad
                else 0.0
            )
            widened.append(
                replace(bearing, sigma_rad=min(math.hypot(bearing.sigma_rad, pulled_rad), math.pi))
            )
        return widened

    def _drift(self) -> Float[np.ndarray, "3 3"]:
        """Covariance of the drift since the submap was begun, beyond that of matches."""
        c, distance_m, turned = self.config, max(self._distance_m, 0.5), self._turned_rad
        turn = distance_m * c.drift_rad**2 + turned * c.drift_turn_rad**2
        return np.diag([distance_m * c.drift_m**2, distance_m * c.drift_m**2, turn])

    def transmitters(self) -> dict[str, Transmitter]:
        """Positions of sources that were in line of sight."""
        return self.landmarks.transmitters(self.graph)

    def jump(self, match: Match, scan: ScanPoints) -> None:
        """Continue at a relocalized pose.

        Odometry still counts, with the correction as additional uncertainty; along directions without information from
        the match it counts alone: a jump adds decimetres of uncertainty, not the size of the building.
        """
        turn = rotation(self.graph.poses[-1][2])
        away = difference(match.pose, self.pose, 1.0)
        off_m, off_rad = math.hypot(away[0], away[1]) + _OFF_M, abs(away[2]) + _OFF_RAD
        off = np.diag([off_m, off_m, off_rad]) ** 2
        match_covariance = covariance_of(turn.T @ match.information @ turn, scan, self._least_m)
        self._blind = self._blind + off
        self._spread = np.linalg.inv(np.linalg.inv(match_covariance) + np.linalg.inv(self._spread + off))
        self._place(match.pose)
        self._begin()

    def update(
        self,
        scan: ScanPoints,
        view: View,
        displacement: Float[np.ndarray, "3"],
        covariance: Float[np.ndarray, "3 3"],
    ) -> bool:
        """Predict, match and accept a scan; whether past poses changed."""
        self.predict(displacement, covariance)
        return self.accept(self.match(scan, view), scan, view)

    def _in_map(self, covariance: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        """A covariance of the submap's frame in the axes of `map`."""
        turn = rotation(self.graph.poses[-1][2])
        return np.asarray(turn @ covariance @ turn.T)

    def _place(self, pose: Float[np.ndarray, "3"]) -> None:
        here = between(self.graph.poses[-1], pose)
        self._distance_m += float(math.hypot(*(here - self._here)[:2]))
        self._turned_rad += abs(wrap(float(here[2] - self._here[2])))
        self.pose, self._here = compose(self.graph.poses[-1], here), here

    @property
    def closed(self) -> int:
        """Number of closed loops."""
        return self._loops.closed

    def finish(self, watched: Callable[[range], Iterable[int]] = iter) -> None:
        """Fit the rest of the queue and submaps that are near by the improved poses, `watched` for progress."""
        if len(self.submaps[-1].poses) > 1:
            self._begin()
        while self._loops.queue:
            self._unsolved_m += self._loops.try_next()
            self._settle(_UNSOLVED_M)
        if self.config.loops:
            self._loops.fit_again(self._solve, self._unsolved_m, watched)

    def _begin(self) -> bool:
        """Close the submap, and begin the next at the robot; whether past poses changed."""
        last = len(self.submaps) - 1
        node = self.graph.add(self.pose)
        drift = self._drift()
        # Information of odometry alone; information of matches beyond it drifts.
        least = 1e-12 * np.eye(3)
        blind = np.linalg.inv(self._blind + least)
        values, vectors = np.linalg.eigh(np.linalg.inv(self._spread + least) - blind)
        matched = (vectors * np.maximum(values, 0.0)) @ vectors.T
        matched -= matched @ np.linalg.solve(np.linalg.inv(drift + least) + matched, matched)
        covariance = np.linalg.inv(blind + 0.5 * (matched + matched.T))
        self.graph.hold(Constraint(first=last, second=node, pose=self._here, covariance=covariance))
        self.submaps.append(Submap(self.config.cell_m))
        if last > 0:
            self._loops.pack(self.submaps[last - 1])
        self._recent.move(between(self._here, np.zeros(3)))
        self._here, self._distance_m, self._turned_rad = np.zeros(3), 0.0, 0.0
        self._spread = self._blind = np.zeros((3, 3))
        if self.config.loops:
            self._merge_covered()
            last = len(self.submaps) - 2
            self._loops.add(last)
        before, self._n_bearings = self._n_bearings, self.landmarks.taken
        if self._compass is not None:
            self._unsolved_m += self._compass.see(self.graph, last, self.submaps[last].surfaces.fine)
        has_changed = self._n_bearings > before and self._solve()
        if not has_changed:
            self._look_around()
        return has_changed

    def _merge_covered(self) -> None:
        """Merge submaps that show nothing new with those that show the same, so that the graph grows with the area."""
        waiting = {number for pair in self._loops.queue for number in pair}
        while self._n_judged < len(self.submaps) - 2 and self._n_judged not in waiting:
            other = self._covering(self._n_judged)
            if other is None:
                self._n_judged += 1
            else:
                self._merge(self._n_judged, other)
                waiting = {number - (number > self._n_judged) for number in waiting}

    def _covering(self, number: int) -> int | None:
        """Return the submap that shows most of a submap, if several others around show nearly all."""
        points = self.submaps[number].outline().points
        loops = [c for c in self.graph.believed() if c.loop and number in (c.first, c.second)]
        fitting = {c.first + c.second - number for c in loops}
        if len(fitting) < _HELD or not len(points):
            return None
        fits = self._loops.together(self.graph.uncertainty(number))
        fits[[number, *range(len(fits) - 2, len(fits))]] = False
        away_m = np.hypot(*(np.array(self.graph.poses) - self.graph.poses[number])[:, :2].T)
        around = np.flatnonzero(fits & (away_m < _NEIGHBOUR_M))
        shown = np.zeros((len(self.submaps), len(points)), bool)
        for other in {*fitting, *around.tolist()}:
            place = between(self.graph.poses[other], self.graph.poses[number])
            shown[other] = seen_by(Views.of(self.submaps[other].views), to_map(place, points))[0]
        if float((shown.sum(axis=0) >= _SHOWN).mean()) < _COVERED:
            return None
        return max(sorted(fitting), key=lambda other: int(shown[other].sum()))

    def _merge(self, number: int, other: int) -> None:
        at = self.graph.merge(number, other)
        self.landmarks.merge(number, other, at)
        self.submaps[other].merge(self.submaps.pop(number), at)
        self._loops.remove(number)

    def _settle(self, deviation_m: float) -> bool:
        """Optimise the graph if closed loops deviate by more in all [m]; whether poses changed."""
        return self._unsolved_m > deviation_m and self._solve()

    def _solve(self) -> bool:
        """Optimise the graph; whether any pose changed."""
        moved_m, self._unsolved_m = self.graph.solve(), 0.0
        self.pose = compose(self.graph.poses[-1], self._here)
        if moved_m > _MOVED_M:
            self._look_around()
        return moved_m > _MOVED_M

    def _look_around(self) -> None:
        """Merge the consistent surfaces around."""
        config, last = self.config, len(self.submaps) - 1
        poses = np.array(self.graph.poses)
        away_m = np.hypot(*(poses - poses[last])[:, :2].T)
        fits = self._loops.together(self.graph.uncertainty(last))
        fits[max(last - 1, 0) :] = True
        self._apart = config.loops and bool((~fits & (away_m < _NEIGHBOUR_M)).any())
        around = np.flatnonzero(fits & (away_m < _AROUND_M))
        nearest = around[np.argsort(away_m[around], kind="stable")[:_MOST_AROUND]]
        self._around = SurfaceLevels(config.cell_m)
        for k in np.sort(nearest):
            self._around.take(self.submaps[k].surfaces, poses[k])
