"""Radio sources as landmarks: their positions are estimated together with the trajectory, and constrain it.

The origin of a path stands still: in line of sight the source itself, else its mirror image in walls. A path belongs to
the landmark whose position explains its direction and strength, whatever its link-state classification; otherwise it
may begin a new landmark. Further paths are identified by their excess length over the first; they are followed as long
as they appear where they are expected, and begin new landmarks after that.

A landmark constrains poses only after directions alone, from several places, give one position for all its sightings,
with a depth at least as certain as that of its strength. An arrival that only looks like line of sight, from the corner
of a wall or an object far down a corridor, gives no such position: its strength implies another depth than its
directions, or these imply none. Earlier sightings then constrain poses too.

Bearings are used again only after the robot has moved: errors from one place are equal. Paths that can hardly be
separated have equal errors for metres, as long as they come from the same direction: they share one error. The error
of the pose since its node of the graph counts as an error of the bearing.
References: Gentner et al., Multipath assisted positioning with simultaneous localization and mapping, IEEE Trans.
Wireless Communications 15 (2016), whose virtual transmitters these are; Stansfield, Statistical theory of D.F. fixing,
Journal of the IEE 94 (1947), on the position from directions.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slam.graph.least_squares import Sighting
from slam.graph.pose_graph import PoseGraph
from slam.poses import compose, wrap
from slam.sensing.bearings import Bearing

#: Bearings are used again after this distance or turn [m, rad].
_APART_M, _APART_RAD = 0.25, math.radians(15.0)
#: Least number of sightings for a position, largest relative uncertainty of its depth, and largest root mean square of
#: the errors of directions in standard deviations.
_ENOUGH, _DEPTH, _OFF = 6, 0.1, 1.5
#: Bearings of a landmark share an error while its direction changes by less than this [rad].
_ALIKE_RAD = math.radians(5.0)
#: Standard deviation of headings between sightings, in addition to that of bearings [rad].
_HEADING_RAD = math.radians(0.2)
#: Most sightings of a landmark without a position.
_MOST_UNPLACED = 60
#: A known landmark may appear this many standard deviations, and this far [rad, m], from its expected place.
_GATE, _JITTER_RAD, _JITTER_M = 4.0, math.radians(1.0), 0.1
#: A landmark is given up when it has not appeared over this distance [m].
_LOST_M = 3.0
#: Tolerance of a distance from the strength in free space (logarithm).
_WEAK = 0.1
#: Least probability of line of sight that counts.
_BELIEVED = 0.5
#: Iterations that estimate a position, and its least distance [m].
_STEPS, _NEAREST_M = 5, 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Transmitter:
    """Estimated position of a source."""

    xy: Float[np.ndarray, "2"]
    """In `map` [m]."""
    covariance: Float[np.ndarray, "2 2"]
    """Covariance of the position [m^2]."""
    sightings: int
    """Number of bearings."""


class _Seen(NamedTuple):
    """A sighting of a landmark."""

    time: int
    distance_m: float
    node: int
    at: Float[np.ndarray, "3"]
    bearing: Bearing
    stretch: int
    """Number of the stretch on which bearings share an error."""
    first: "_Landmark | None"
    """Origin of the first path of the same source; None for that path."""


@dataclass(kw_only=True, eq=False)
class _Landmark:
    """A static origin of paths."""

    place_xy: Float[np.ndarray, "2"] | None = None
    """Position, if known from the outset [m]."""
    seen: list[_Seen] = field(default_factory=list)
    place: int | None = None
    """Its number in the graph, once it constrains poses."""
    stretch: tuple[int, float] | None = None
    """Number of its last stretch of shared error, and the azimuth at its beginning [rad]."""
    in_sight: int = 0
    """Number of sightings classified as line of sight."""


class Landmarks:
    """Landmarks of all sources."""

    def __init__(self) -> None:
        self._sources: dict[str, list[_Landmark]] = defaultdict(list)
        self._images: dict[str, list[_Landmark]] = defaultdict(list)
        self._last: Float[np.ndarray, 3] | None = None
        self._time, self._distance_m, self._stretches = 0, 0.0, 0
        self.taken = 0
        """Number of bearings that constrain poses, or may do so later."""

    def see(
        self,
        graph: PoseGraph,
        here: Float[np.ndarray, "3"],
        spread: Float[np.ndarray, "3 3"],
        bearings: Sequence[Bearing],
    ) -> None:
        """Add the bearings from a pose."""
        pose, node = compose(graph.poses[-1], here), len(graph.poses) - 1
        if self._last is not None:
            gap_m = math.hypot(*(pose - self._last)[:2])
            if gap_m < _APART_M and abs(wrap(float(pose[2] - self._last[2]))) < _APART_RAD:
                return
            self._distance_m += gap_m
        self._last, self._time = pose, self._time + 1
        firsts: dict[str, _Landmark] = {}
        for measured in bearings:
            bearing, first = _from_uncertain(measured, here, spread), firsts.get(measured.source)
            if bearing.beyond_m is None:
                landmark = firsts[measured.source] = self._source(graph, pose, bearing)
                first = None
            elif first is not None:
                landmark = self._image(graph, pose, bearing, first)
            else:
                continue
            azimuth = float(pose[2] + bearing.bearing_rad)
            if landmark.stretch is None or abs(wrap(azimuth - landmark.stretch[1])) > _ALIKE_RAD:
                landmark.stretch = self._stretches, azimuth
                self._stretches += 1
            stretch = landmark.stretch[0]
            seen = _Seen(self._time, self._distance_m, node, here.copy(), bearing, stretch, first)
            self._take(graph, landmark, seen)

    def merge(self, pose: int, other: int, at: Float[np.ndarray, "3"]) -> None:
        """Follow a pose of the graph that was merged with another, in whose frame it lies at `at`."""
        for landmarks in (*self._sources.values(), *self._images.values()):
            for landmark in landmarks:
                landmark.seen = [
                    seen._replace(node=other - (other > pose), at=compose(at, seen.at))
                    if seen.node == pose
                    else seen._replace(node=seen.node - (seen.node > pose))
                    for seen in landmark.seen
                ]

    def transmitters(self, graph: PoseGraph) -> dict[str, Transmitter]:
        """Estimated positions of sources: for each, the landmark that was in line of sight most often."""
        transmitters = {}
        for name, landmarks in self._sources.items():
            best = max(
                landmarks,
                key=lambda landmark: (landmark.place is not None, landmark.in_sight, len(landmark.seen)),
            )
            if best.place is not None:
                transmitters[name] = Transmitter(
                    xy=graph.places[best.place].copy(),
                    covariance=graph.place_covariance(best.place),
                    sightings=len(best.seen),
                )
        return transmitters

    def _take(self, graph: PoseGraph, landmark: _Landmark, seen: _Seen) -> None:
        """Add a sighting; a landmark constrains poses once its position is known."""
        believed = seen.bearing.direct >= _BELIEVED
        landmark.seen.append(seen)
        landmark.in_sight += believed
        self.taken += believed or landmark.place is not None
        if landmark.place is not None:
            _hold(graph, landmark, seen)
            return
        del landmark.seen[:-_MOST_UNPLACED]
        known = landmark.place_xy
        xy = _one_place(graph, landmark.seen) if known is None else known
        if xy is not None:
            landmark.place = graph.add_place(xy, known=known is not None)
            for each in landmark.seen:
                _hold(graph, landmark, each)

    def _source(self, graph: PoseGraph, pose: Float[np.ndarray, "3"], bearing: Bearing) -> _Landmark:
        """Landmark of a first path."""
        landmarks = self._sources[bearing.source]
        if bearing.place_xy is not None and bearing.direct >= _BELIEVED:
            known = [landmark for landmark in landmarks if landmark.place_xy is not None]
            if not known:
                landmarks.append(_Landmark(place_xy=bearing.place_xy))
            return (known or landmarks)[-1]
        rated = [(_unlike_place(graph, landmark, pose, bearing), k) for k, landmark in enumerate(landmarks)]
        unlike, best = min(rated, default=(math.inf, 0))
        if unlike < 1.0:
            return landmarks[best]
        landmarks[:] = [
            landmark
            for landmark in landmarks
            if landmark.place is not None or landmark.in_sight or self._lately(landmark)
        ]
        landmarks.append(_Landmark())
        return landmarks[-1]

    def _image(
        self, graph: PoseGraph, pose: Float[np.ndarray, "3"], bearing: Bearing, first: _Landmark
    ) -> _Landmark:
        """Mirror image of a further path."""
        landmarks = self._images[bearing.source]
        landmarks[:] = [landmark for landmark in landmarks if self._lately(landmark)]
        # Another path of this measurement may already belong to it.
        free = [
            landmark
            for landmark in landmarks
            if landmark.seen[-1].time < self._time and landmark.seen[-1].first is first
        ]
        rated = [(_unlike_image(graph, landmark, pose, bearing), k) for k, landmark in enumerate(free)]
        unlike, best = min(rated, default=(math.inf, 0))
        if unlike < 1.0:
            return free[best]
        landmarks.append(_Landmark())
        return landmarks[-1]

    def _lately(self, landmark: _Landmark) -> bool:
        """Whether a landmark has appeared over the last metres."""
        return self._distance_m - landmark.seen[-1].distance_m < _LOST_M


def _from_uncertain(
    bearing: Bearing, here: Float[np.ndarray, "3"], spread: Float[np.ndarray, "3 3"]
) -> Bearing:
    """Add the uncertainty of the pose to that of a bearing."""
    azimuth = here[2] + bearing.bearing_rad
    turn = np.array([math.sin(azimuth) / bearing.range_m, -math.cos(azimuth) / bearing.range_m, -1.0])
    sigma_rad = math.sqrt(bearing.sigma_rad**2 + float(turn @ spread @ turn))
    return replace(bearing, sigma_rad=min(sigma_rad, math.pi))


def _one_place(graph: PoseGraph, seen: Sequence[_Seen]) -> Float[np.ndarray, "2"] | None:
    """The position from directions alone [m]; None if they do not determine one."""
    # Least squares of the distances of a point from lines of sight, each over the distance along it (Stansfield).
    if len(seen) < _ENOUGH:
        return None
    seen_from = np.array([compose(graph.poses[sighting.node], sighting.at) for sighting in seen])
    azimuth = seen_from[:, 2] + [sighting.bearing.bearing_rad for sighting in seen]
    sigma = np.hypot([sighting.bearing.sigma_rad for sighting in seen], _HEADING_RAD)
    across = np.column_stack([-np.sin(azimuth), np.cos(azimuth)])
    across_m = (across * seen_from[:, :2]).sum(axis=1)
    range_m = np.array([sighting.bearing.range_m for sighting in seen])
    away_m = range_m
    for _ in range(_STEPS):
        weighted = across / (sigma * away_m)[:, None]
        information = weighted.T @ weighted
        least, largest = np.linalg.eigvalsh(information)
        if least < 1e-9 * largest:
            return None
        place = np.linalg.solve(information, weighted.T @ (across_m / (sigma * away_m)))
        away = place - seen_from[:, :2]
        away_m = np.maximum(np.hypot(*away.T), _NEAREST_M)
    off = wrap(np.arctan2(away[:, 1], away[:, 0]) - azimuth) / sigma
    depth = 1 / math.sqrt(least) / float(away_m.mean())
    if depth > _DEPTH or _rms(off) > _OFF:
        return None
    if seen[-1].first is None and _rms(np.log(away_m / range_m)) > _WEAK + 2 * depth:
        return None
    return np.asarray(place)


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _unlike_place(
    graph: PoseGraph, landmark: _Landmark, pose: Float[np.ndarray, "3"], bearing: Bearing
) -> float:
    """Deviation of a first path from a landmark's position, relative to the tolerance; 1 is too far."""
    # A landmark without a position is placed by the direction and strength of its last sighting.
    if landmark.place is None:
        last = landmark.seen[-1]
        there, open_m = _appears(graph, last), _WEAK * last.bearing.range_m
    else:
        there, open_m = graph.places[landmark.place], 0.0
    away = there - pose[:2]
    away_m = max(math.hypot(*away), _NEAREST_M)
    turn = abs(wrap(float(pose[2] + bearing.bearing_rad) - math.atan2(away[1], away[0])))
    noise = _GATE * bearing.sigma_rad + _JITTER_RAD + math.atan2(open_m, away_m)
    weak = abs(math.log(bearing.range_m / away_m))
    return max(turn / noise, weak / (_WEAK + open_m / away_m))


def _unlike_image(
    graph: PoseGraph, landmark: _Landmark, pose: Float[np.ndarray, "3"], bearing: Bearing
) -> float:
    """Deviation of a further path from an expected image, relative to the tolerance; 1 is too far."""
    _, _, node, at, before, *_ = landmark.seen[-1]
    seen_from = compose(graph.poses[node], at)
    moved_m = math.hypot(*(pose - seen_from)[:2])
    noise = _GATE * math.hypot(bearing.sigma_rad, before.sigma_rad) + _JITTER_RAD
    if landmark.place is None:
        azimuth = seen_from[2] + before.bearing_rad
        noise += math.atan2(moved_m, 0.5 * before.range_m)
    else:
        away = graph.places[landmark.place] - pose[:2]
        azimuth = math.atan2(away[1], away[0])
    unlike = abs(wrap(float(pose[2] + bearing.bearing_rad - azimuth))) / noise
    assert bearing.beyond_m is not None and before.beyond_m is not None
    slack_m = _GATE * math.hypot(bearing.sigma_m, before.sigma_m) + _JITTER_M + 2 * moved_m
    return max(unlike, abs(bearing.beyond_m - before.beyond_m) / slack_m)


def _appears(graph: PoseGraph, seen: _Seen) -> Float[np.ndarray, "2"]:
    """Position by the direction and strength of one sighting [m]."""
    pose = compose(graph.poses[seen.node], seen.at)
    azimuth = pose[2] + seen.bearing.bearing_rad
    return np.asarray(pose[:2] + seen.bearing.range_m * np.array([math.cos(azimuth), math.sin(azimuth)]))


def _hold(graph: PoseGraph, landmark: _Landmark, seen: _Seen) -> None:
    """Add a sighting to the graph."""
    _, _, node, at, bearing, stretch, first = seen
    assert landmark.place is not None
    compared = None if first is None else first.place
    if compared is None or bearing.beyond_m is None:
        range_m, sigma = bearing.range_m, bearing.sigma_log_range
    else:
        range_m, sigma = bearing.beyond_m, bearing.sigma_m
    graph.see(
        Sighting(
            pose=node,
            at=at,
            place=landmark.place,
            bearing_rad=bearing.bearing_rad,
            sigma_rad=bearing.sigma_rad,
            range_m=range_m,
            sigma_range=sigma,
            beyond=compared,
            stretch=stretch,
            shared_rad=bearing.shared_rad,
            shared_range=0.0 if compared is not None else bearing.shared_log_range,
        )
    )
