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
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from robosim_support.checks import Range, checked
from slam.graph.alongside import mirror_image_angle_rad
from slam.graph.judging import Judge
from slam.graph.landmarks import Landmarks, Transmitter
from slam.graph.least_squares import Constraint
from slam.graph.pose_graph import PoseGraph, chained
from slam.graph.submaps import (
    OF_SCAN,
    Fit,
    Submap,
    View,
    Views,
    covariance_of,
    fit,
    least_covariance,
    looked_through,
    seen_by,
)
from slam.matching.levels import SurfaceLevels, difference, matches
from slam.matching.scan_matching import Match, MatchConfig, ScanPoints
from slam.matching.thin_scans import RecentPoints
from slam.poses import between, compose, rotation, to_map, wrap
from slam.sensing.bearings import Bearing


@dataclass(frozen=True, kw_only=True)
@checked
class TrackerConfig:
    """Settings of the tracker."""

    cell_m: Annotated[float, Range(0.005, 0.5, "m")] = 0.05
    """Side of the cells of surfaces [m]."""
    submap_m: Annotated[float, Range(0.1, 1000, "m")] = 4.0
    """Distance after which a submap is closed [m]."""
    submap_scans: Annotated[int, Range(1, 100_000, "scans")] = 60
    """Scans after which it is closed, at the latest."""
    loops: bool = True
    """Whether loops are closed; without, poses do not change later."""
    radio: bool = True
    """Whether sources of a radio are landmarks."""
    match: MatchConfig = field(default_factory=MatchConfig)
    """Settings of scan matching."""
    together_m: Annotated[float, Range(0.001, 10, "m")] = 0.05
    """Submaps are matched if their position relative to the current one is known to this [m]."""
    together_rad: Annotated[float, Range(1e-4, math.pi, "rad")] = math.radians(1.0)
    """The same for their yaw [rad]."""
    drift_m: Annotated[float, Range(0, 10, "m")] = 0.01
    """Drift of matched poses, beyond the covariance of matches, per square root of a metre driven [m]."""
    drift_rad: Annotated[float, Range(0, math.pi, "rad")] = math.radians(0.03)
    """The same for their yaw [rad]."""
    drift_turn_rad: Annotated[float, Range(0, math.pi, "rad")] = math.radians(0.12)
    """Drift of their yaw per square root of a radian turned [rad]."""
    overlap: Annotated[int, Range(1, 1_000_000, "surfaces")] = 40
    """Surfaces that two submaps must both have seen to be fitted."""
    agreement: Annotated[float, Range(0, 1)] = 0.8
    """Part of the surfaces seen by both that must not contradict, where odometry is precise."""
    searched_agreement: Annotated[float, Range(0, 1)] = 0.9
    """The same if it had to be searched for."""


class _Pending(NamedTuple):
    """A fit that waits for confirmation."""

    here: int
    there: int
    fit: Fit
    is_likely: bool
    """Whether odometry makes it likely; if not, it can only contradict others."""


#: A fit needs no confirmation if odometry is uncertain by no more than this [m, rad].
_SURE_M, _SURE_RAD = 0.25, math.radians(3.0)
#: Squared difference, in variances, up to which two fits agree.
_SAME = 16.27
#: Largest difference between numbers of submaps whose fits may confirm each other.
_NEAR = 6
#: Most fits per submap with neighbours that are not known to fit, and with those that are.
_TRIES, _TRIES_OF_FITTING = 6, 3
#: Loops after which a submap needs no more with what is known to fit.
_ENOUGH = 6
#: A submap is merged with another if at least so many fit it, and of its surfaces this part is seen by so many.
_HELD, _COVERED, _SHOWN = 3, 0.9, 5
#: Most fits that are remembered for confirmation.
_REMEMBERED = 100
#: A fit that is compared to no better than this neither confirms nor contradicts another [m].
_OPEN_M = 1.0
#: Most waiting fits.
_WAITING = 24
#: Scans and distance [m] after which a submap is closed if one within this distance [m] is not known to fit.
_SOON, _SOON_M, _NEIGHBOUR_M = 12, 1.0, 8.0
#: Submaps are closed early if sources are received and the heading is more uncertain than this [rad].
_VAGUE_RAD = math.radians(0.1)
#: Most passes over all submaps at the end.
_ROUNDS = 3
#: The graph is solved once closed loops deviate from its poses by more in all, and by more when none wait [m].
_UNSOLVED_M, _CONFIRMED_M = 0.02, 0.005
#: The same at the end of a log, when poses are known well [m].
_UNSOLVED_AT_END_M = 0.2
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


class Tracker:
    """Tracks a robot, and corrects its trajectory when loops close."""

    def __init__(self, config: TrackerConfig = TrackerConfig()) -> None:
        self.config = config
        self._least_m = OF_SCAN * config.match.sigma_m
        self.reset(np.zeros(3))

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """Forget everything and begin at a pose: x [m], y [m], yaw [rad] in `map`."""
        self.pose = np.asarray(pose, float).copy()
        self.graph = PoseGraph(self.pose)
        self.submaps = [Submap(self.config.cell_m)]
        self.landmarks = Landmarks()
        self._n_bearings = 0
        self._here = np.zeros(3)
        self._spread = self._blind = np.zeros((3, 3))
        self._distance_m = self._turned_rad = 0.0
        self._queue: list[tuple[int, int]] = []
        self._pending: list[_Pending] = []
        self._around = SurfaceLevels(self.config.cell_m)
        self._apart = False
        self._unsolved_m = 0.0
        self._recent = RecentPoints(self.config.cell_m)
        self._fitted = self.submaps[0]
        self._n_scans, self._n_judged = 0, 1

    def predict(
        self, displacement: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "3 3"]
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Move by the displacement of odometry.

        Returns:
            The pose, and its covariance relative to recent surfaces, axes of `map`.
        """
        self._spread = chained(self._here, self._spread, displacement, covariance)
        self._blind = chained(self._here, self._blind, displacement, covariance)
        self._place(compose(self.pose, displacement))
        return self.pose, self.covariance

    @property
    def covariance(self) -> Float[np.ndarray, "3 3"]:
        """Of the pose relative to recent surfaces, axes of `map` [m^2, m rad, rad^2]."""
        return self._in_map(self._spread)

    def match(self, scan: ScanPoints, view: View) -> Match:
        """Fit a scan, taken at the predicted pose, to the surfaces around."""
        prior = self._in_map(self._spread + 4 * least_covariance(self._least_m))
        # Wide enough for the scan: `accept` weighs it against the prediction.
        judge = self._judge(view, prior)
        found = matches(self._around, scan, self.pose, prior, self.config.match, judge, _LOOSENED)
        return found[0] if len(found) == 1 else max(found, key=judge)

    def accept(self, match: Match, scan: ScanPoints, view: View) -> bool:
        """Take in a scan where it was matched.

        Returns:
            Whether past poses changed.
        """
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
        has_changed = False
        if self._queue:
            self._try()
            # Fits that confirm the poses wait for each other.
            has_changed = self._settle(_UNSOLVED_M if self._queue else _CONFIRMED_M)
        # Submaps around that are not known to fit are tried soon.
        most = self.config.submap_scans
        if self._apart and self._distance_m > _SOON_M:
            most = min(_SOON, most)
        if self._distance_m >= self.config.submap_m or len(self.submaps[-1].poses) >= most or self._vague():
            has_changed |= self._begin()
        return has_changed

    def _lines(self, scan: ScanPoints, view: View) -> ScanPoints:
        """Surfaces that a thin scan adds, together with recent ones, in the robot's frame."""
        self._recent.add(self._here, scan)
        views = Views.of([*self.submaps[-1].views, (self._here, view)])
        found = self._recent.new_surfaces(partial(looked_through, views))
        return found.at(between(self._here, np.zeros(3)))

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
        found = []
        for one in bearings:
            pulled_rad = (
                _PULLED * mirror_image_angle_rad(one, self.pose, points, normals) if one.apart_rad else 0.0
            )
            found.append(replace(one, sigma_rad=min(math.hypot(one.sigma_rad, pulled_rad), math.pi)))
        return found

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
        found = covariance_of(turn.T @ match.information @ turn, scan, self._least_m)
        self._blind = self._blind + off
        self._spread = np.linalg.inv(np.linalg.inv(found) + np.linalg.inv(self._spread + off))
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
        return sum(constraint.loop for constraint in self.graph.constraints)

    def finish(self, watched: Callable[[range], Iterable[int]] = iter) -> None:
        """Fit the rest of the queue, and submaps that are near by the improved poses.

        Args:
            watched: Wraps the range of submaps to report progress.
        """
        if len(self.submaps[-1].poses) > 1:
            self._begin()
        while self._queue:
            self._try()
            self._settle(_UNSOLVED_M)
        for _ in range(_ROUNDS if self.config.loops else 0):
            closed = self.closed
            for here in watched(range(2, len(self.submaps))):
                believed = [
                    {c.first, c.second}
                    for c in self.graph.believed()
                    if c.loop and here in (c.first, c.second)
                ]
                self._queue = [pair for pair in self._candidates(here) if set(pair) not in believed]
                while self._queue:
                    self._try()
                self._settle(_UNSOLVED_AT_END_M)
            self._settle(0.0)
            if self.closed == closed:
                break

    def poses(self) -> Float[np.ndarray, "n 3"]:
        """Poses of all scans: x [m], y [m], yaw [rad] in `map`."""
        found = np.zeros((self._n_scans, 3))
        for anchor, submap in zip(self.graph.poses, self.submaps, strict=True):
            if submap.poses:
                own = np.array(submap.poses)
                yaw = wrap(anchor[2] + own[:, 2])
                found[submap.numbers] = np.column_stack([to_map(anchor, own[:, :2]), yaw])
        return found

    def _judge(self, view: View, prior: Float[np.ndarray, "3 3"]) -> Judge:
        """The judge of poses by the last scans."""
        recent = [
            (compose(anchor, pose), before)
            for anchor, submap in zip(self.graph.poses[-2:], self.submaps[-2:], strict=True)
            for pose, before in submap.views
        ][-_RECENT:]
        return Judge(view=view, recent=recent, predicted=self.pose, covariance=prior)

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
            self._pack(self.submaps[last - 1])
        self._recent.move(between(self._here, np.zeros(3)))
        self._here, self._distance_m, self._turned_rad = np.zeros(3), 0.0, 0.0
        self._spread = self._blind = np.zeros((3, 3))
        if self.config.loops:
            self._merge_covered()
            last = len(self.submaps) - 2
            self._queue = [*self._candidates(last), *self._queue][:_WAITING]
        before, self._n_bearings = self._n_bearings, self.landmarks.taken
        has_changed = self._n_bearings > before and self._solve()
        if not has_changed:
            self._look_around()
        return has_changed

    def _pack(self, submap: Submap) -> None:
        """Free memory of a submap whose scans do not judge new ones."""
        if submap not in self.submaps[-2:]:
            submap.pack()

    def _merge_covered(self) -> None:
        """Merge submaps that show nothing new with those that show the same, so that the graph grows with the area."""
        waiting = {number for pair in self._queue for number in pair}
        while self._n_judged < len(self.submaps) - 2 and self._n_judged not in waiting:
            other = self._covering(self._n_judged)
            if other is None:
                self._n_judged += 1
            else:
                self._merge(self._n_judged, other)
                waiting = {number - (number > self._n_judged) for number in waiting}

    def _covering(self, number: int) -> int | None:
        """Of the submaps that fit one, that which shows most of it, if several others around show nearly all."""
        points = self.submaps[number].outline().points
        loops = [c for c in self.graph.believed() if c.loop and number in (c.first, c.second)]
        fitting = {c.first + c.second - number for c in loops}
        if len(fitting) < _HELD or not len(points):
            return None
        fits = self._together(self.graph.uncertainty(number))
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
        self._queue = [
            (here - (here > number), there - (there > number))
            for here, there in self._queue
            if number not in (here, there)
        ]
        self._pending = [
            one._replace(here=one.here - (one.here > number), there=one.there - (one.there > number))
            for one in self._pending
            if number not in (one.here, one.there)
        ]

    def _candidates(self, here: int) -> list[tuple[int, int]]:
        """Submaps that may overlap with a closed one, the most likely first."""
        uncertain = self.graph.uncertainty(here)[: max(here - 1, 0)]
        poses = np.array(self.graph.poses[: here + 1])
        circles = np.array([submap.circle() for submap in self.submaps[: here + 1]])
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y, radius_m = circles.T
        middle = poses[:, :2] + np.column_stack([c * x - s * y, s * x + c * y])
        gap_m = np.hypot(*(middle[: len(uncertain)] - middle[here]).T)
        open_m = 3 * np.sqrt(uncertain[:, 0, 0] + uncertain[:, 1, 1])
        is_near = gap_m - open_m < 0.7 * (radius_m[: len(uncertain)] + radius_m[here])
        fits = self._together(uncertain)
        found = []
        for some, tries in ((~fits, _TRIES), (fits, _TRIES_OF_FITTING)):
            near = np.flatnonzero(is_near & some)
            found += [(here, int(there)) for there in near[np.argsort(gap_m[near], kind="stable")[:tries]]]
        return found

    def _together(self, spread: Float[np.ndarray, "n 3 3"]) -> Bool[np.ndarray, " n"]:
        """Which submaps are known to fit another, by the covariance between them."""
        wide = np.hypot(spread[:, 0, 0], spread[:, 1, 1]) > self.config.together_m**2
        return ~wide & (spread[:, 2, 2] < self.config.together_rad**2)

    def _try(self) -> None:
        """Fit one pair of submaps."""
        here, there = self._queue.pop(0)
        if self.submaps[here].poses and self.submaps[there].poses:
            self._unsolved_m += self._fit(here, there)

    def _settle(self, deviation_m: float) -> bool:
        """Optimise the graph if closed loops deviate by more in all [m]; whether poses changed."""
        return self._unsolved_m > deviation_m and self._solve()

    def _fit(self, here: int, there: int) -> float:
        """Fit two submaps; by how much a loop that is closed deviates from the poses [m], a radian as a metre.

        One that had to be searched for deviates by any amount.
        """
        covariance = self.graph.uncertainty(here)[there]
        if self.submaps[here].loops >= _ENOUGH and self._together(covariance[None])[0]:
            return 0.0
        predicted = between(self.graph.poses[here], self.graph.poses[there])
        found = fit(self.submaps[there], self.submaps[here], predicted, covariance, self.config.match)
        if self.submaps[here] is not self._fitted:
            self._pack(self._fitted)
            self._fitted = self.submaps[here]
        deviation = np.sqrt(np.diag(covariance))
        sure = math.hypot(deviation[0], deviation[1]) < _SURE_M and deviation[2] < _SURE_RAD
        least = self.config.agreement if sure else self.config.searched_agreement
        if found is None or found.overlap < self.config.overlap or found.agreement < least:
            return 0.0
        away = difference(found.pose, predicted, 1.0)
        is_likely = bool(away @ np.linalg.solve(covariance + found.covariance, away) < _SAME)
        if sure and not is_likely:
            return 0.0
        new = _Pending(here, there, found, is_likely)
        closed = [new] if sure else self._confirmed(new)
        for one in closed:
            self._close(one.here, one.there, one.fit)
        if not closed:
            return 0.0
        return float(np.linalg.norm(away)) if sure else math.inf

    def _solve(self) -> bool:
        """Optimise the graph; whether any pose changed."""
        moved_m, self._unsolved_m = self.graph.solve(), 0.0
        self.pose = compose(self.graph.poses[-1], self._here)
        if moved_m > _MOVED_M:
            self._look_around()
        return moved_m > _MOVED_M

    def _close(self, here: int, there: int, found: Fit) -> None:
        self.submaps[here].loops += 1
        self.graph.forget_loop(here, there)
        self.graph.hold(
            Constraint(first=here, second=there, pose=found.pose, covariance=found.covariance, loop=True)
        )

    def _confirmed(self, new: _Pending) -> list[_Pending]:
        """A fit that had to be searched for and those that confirm it; none if others contradict it, which then wait.

        Along a corridor with equal doors all neighbours fit, at places that contradict each other.
        """
        others = [old for old in self._pending if (old.here, old.there) != (new.here, new.there)]
        agreeing, n_against = [], 0
        for old in others:
            if self._is_near(old, new):
                away, spread = self._compared(old, new)
                # Fits that leave the place open, as along a corridor, agree with any by chance.
                if np.trace(spread[:2, :2]) < _OPEN_M**2:
                    is_same = away @ np.linalg.solve(spread, away) < _SAME
                    n_against += not is_same
                    agreeing += [old] if is_same and old.is_likely else []
        if new.is_likely and len(agreeing) > n_against:
            self._pending = [old for old in others if old not in agreeing]
            return [new, *agreeing]
        self._pending = [*others, new][-_REMEMBERED:]
        return []

    @staticmethod
    def _is_near(old: _Pending, new: _Pending) -> bool:
        """Whether two fits are of neighbours, so that one is evidence for or against the other."""
        is_same = (old.here, old.there) == (new.here, new.there)
        return not is_same and max(abs(old.here - new.here), abs(old.there - new.there)) <= _NEAR

    def _compared(
        self, old: _Pending, new: _Pending
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Difference between two fits, and its covariance."""
        poses = self.graph.poses
        to_old, from_old = (
            between(poses[new.here], poses[old.here]),
            between(poses[old.there], poses[new.there]),
        )
        spread = self.graph.uncertainty(new.here)[old.here]
        spread = chained(to_old, spread, old.fit.pose, old.fit.covariance)
        chain = compose(to_old, old.fit.pose)
        spread = chained(chain, spread, from_old, self.graph.uncertainty(old.there)[new.there])
        chain = compose(chain, from_old)
        return difference(chain, new.fit.pose, 1.0), spread + new.fit.covariance

    def _look_around(self) -> None:
        """Merge the consistent surfaces around."""
        config, last = self.config, len(self.submaps) - 1
        poses = np.array(self.graph.poses)
        away_m = np.hypot(*(poses - poses[last])[:, :2].T)
        fits = self._together(self.graph.uncertainty(last))
        fits[max(last - 1, 0) :] = True
        self._apart = config.loops and bool((~fits & (away_m < _NEIGHBOUR_M)).any())
        around = np.flatnonzero(fits & (away_m < _AROUND_M))
        nearest = around[np.argsort(away_m[around], kind="stable")[:_MOST_AROUND]]
        self._around = SurfaceLevels(config.cell_m)
        for k in np.sort(nearest):
            self._around.take(self.submaps[k].surfaces, poses[k])
