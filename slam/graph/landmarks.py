"""Sources of a radio as landmarks: where they stand comes out with the trajectory, and holds it.

What a path comes from stands still: in line of sight the source itself, else a mirror image of it in walls. A path
belongs to the landmark from whose place it comes and as strong as from there, whatever its link state is taken for;
else it may be the first of a new one. Further paths are told by how much longer they are than the first; they are
followed as long as they appear where they are expected, and are other landmarks after that.

No landmark holds a pose before directions alone, taken along a way, have told one place for all that was seen of it,
with a depth that is no more open than its strength. An arrival that only looks like line of sight, off the corner of a
wall or off something far down a corridor, tells no such place: its strength says another depth than its directions,
or they say none. All that was seen before holds then as well.

Bearings are taken again only once the robot has moved: from one place, they err alike. Paths that can hardly be told
apart err alike for metres, as long as they come from the same direction: that error is one for all of them. What the
pose has gathered in error since its node of the graph counts as an error of the bearing.
References: Gentner et al., Multipath assisted positioning with simultaneous localization and mapping, IEEE Trans.
Wireless Communications 15 (2016), whose virtual transmitters these are; Stansfield, Statistical theory of D.F. fixing,
Journal of the IEE 94 (1947), on the place that directions tell.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slam.graph.pose_graph import PoseGraph, Sighting
from slam.poses import compose, wrap
from slam.sensing.bearings import Bearing

#: Bearings are taken again after a way, or a turn, of this [m, rad].
_APART_M, _APART_RAD = 0.25, math.radians(15.0)
#: A place is told by so many sightings, if its depth is open by so much of it, and if the root mean square of what
#: directions are off is so many standard deviations, at most.
_ENOUGH, _DEPTH, _OFF = 6, 0.1, 1.5
#: Bearings of a landmark err alike until it appears in a direction that is off by more [rad].
_ALIKE_RAD = math.radians(5.0)
#: How far headings along such a way may be off, beside bearings [rad].
_HEADING_RAD = math.radians(0.2)
#: Sightings that are kept of what tells no place yet.
_KEPT = 60
#: What is known may appear so many standard deviations, and so far [rad, m], from where it is expected.
_GATE, _JITTER_RAD, _JITTER_M = 4.0, math.radians(1.0), 0.1
#: It is given up when it has not appeared on so much way [m].
_GONE_M = 3.0
#: A path is as strong as in line of sight if free space would do with a distance within so much of it (logarithm).
_WEAK = 0.1
#: Line of sight is believed from this probability on.
_BELIEVED = 0.5
#: Steps in which a place is told, and the least distance of one [m].
_STEPS, _NEAREST_M = 5, 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Transmitter:
    """Where a source is taken to stand."""

    xy: Float[np.ndarray, "2"]
    """In `map` [m]."""
    covariance: Float[np.ndarray, "2 2"]
    """Of that [m^2]."""
    sightings: int
    """Bearings that it comes from."""


class _Seen(NamedTuple):
    """Where a landmark appeared once, and from where."""

    time: int
    way_m: float
    node: int
    at: Float[np.ndarray, "3"]
    bearing: Bearing
    stretch: int
    """Number of the stretch on which bearings err alike."""
    first: "_Landmark | None"
    """What the first path of the same source came from; None for that path."""


@dataclass(kw_only=True, eq=False)
class _Landmark:
    """Something that stands still."""

    place_xy: Float[np.ndarray, "2"] | None = None
    """Where, if that is known from the outset."""
    seen: list[_Seen] = field(default_factory=list)
    place: int | None = None
    """Its number in the graph, once it holds poses."""
    stretch: tuple[int, float] | None = None
    """Number of the last stretch on which its bearings err alike, and the azimuth that it began with [rad]."""
    in_sight: int = 0
    """How often it was taken to be in line of sight."""


class Landmarks:
    """All that has been seen of sources."""

    def __init__(self) -> None:
        self._sources: dict[str, list[_Landmark]] = defaultdict(list)
        self._images: dict[str, list[_Landmark]] = defaultdict(list)
        self._last: Float[np.ndarray, 3] | None = None
        self._time, self._way_m, self._stretches = 0, 0.0, 0
        self.taken = 0
        """Bearings that hold poses, or may do so later on."""

    def see(
        self,
        graph: PoseGraph,
        here: Float[np.ndarray, "3"],
        spread: Float[np.ndarray, "3 3"],
        bearings: Sequence[Bearing],
    ) -> None:
        """Take in what appears from a pose.

        Args:
            graph: Whose last pose `here` is told in.
            here: Where the robot is: x [m], y [m], yaw [rad].
            spread: Covariance of that [m^2, m rad, rad^2].
            bearings: Of each source the first path, and then others.
        """
        pose, node = compose(graph.poses[-1], here), len(graph.poses) - 1
        if self._last is not None:
            gap_m = math.hypot(*(pose - self._last)[:2])
            if gap_m < _APART_M and abs(wrap(float(pose[2] - self._last[2]))) < _APART_RAD:
                return
            self._way_m += gap_m
        self._last, self._time = pose, self._time + 1
        firsts: dict[str, _Landmark] = {}
        for one in bearings:
            bearing, first = _from_uncertain(one, here, spread), firsts.get(one.source)
            if bearing.beyond_m is None:
                landmark = firsts[one.source] = self._source(graph, pose, bearing)
                first = None
            elif first is not None:
                landmark = self._image(graph, pose, bearing, first)
            else:
                continue
            azimuth = float(pose[2] + bearing.bearing_rad)
            stretch = self._stretch(landmark, azimuth)
            seen = _Seen(self._time, self._way_m, node, here.copy(), bearing, stretch, first)
            self._take(graph, landmark, seen)

    def transmitters(self, graph: PoseGraph) -> dict[str, Transmitter]:
        """Where sources stand: of the places of each, that which was in line of sight most often."""
        found = {}
        for name, landmarks in self._sources.items():
            best = max(landmarks, key=lambda one: (one.place is not None, one.in_sight, len(one.seen)))
            if best.place is not None:
                found[name] = Transmitter(
                    xy=graph.places[best.place].copy(),
                    covariance=graph.place_covariance(best.place),
                    sightings=len(best.seen),
                )
        return found

    def _take(self, graph: PoseGraph, landmark: _Landmark, seen: _Seen) -> None:
        """Let a landmark hold poses by what was seen of it, once its place is told."""
        believed = seen.bearing.direct >= _BELIEVED
        landmark.seen.append(seen)
        landmark.in_sight += believed
        self.taken += believed or landmark.place is not None
        if landmark.place is not None:
            _hold(graph, landmark, seen)
            return
        del landmark.seen[:-_KEPT]
        known = landmark.place_xy
        xy = _one_place(graph, landmark.seen) if known is None else known
        if xy is not None:
            landmark.place = graph.add_place(xy, known=known is not None)
            for each in landmark.seen:
                _hold(graph, landmark, each)

    def _source(self, graph: PoseGraph, pose: Float[np.ndarray, "3"], bearing: Bearing) -> _Landmark:
        """What a first path comes from."""
        landmarks = self._sources[bearing.source]
        if bearing.place_xy is not None and bearing.direct >= _BELIEVED:
            known = [one for one in landmarks if one.place_xy is not None]
            if not known:
                landmarks.append(_Landmark(place_xy=bearing.place_xy))
            return (known or landmarks)[-1]
        rated = [(_elsewhere(graph, one, pose, bearing), k) for k, one in enumerate(landmarks)]
        unlike, best = min(rated, default=(math.inf, 0))
        if unlike < 1.0:
            return landmarks[best]
        landmarks[:] = [
            one for one in landmarks if one.place is not None or one.in_sight or self._lately(one)
        ]
        landmarks.append(_Landmark())
        return landmarks[-1]

    def _image(
        self, graph: PoseGraph, pose: Float[np.ndarray, "3"], bearing: Bearing, first: _Landmark
    ) -> _Landmark:
        """The mirror image that a further path comes from."""
        landmarks = self._images[bearing.source]
        landmarks[:] = [one for one in landmarks if self._lately(one)]
        # Another path of this measurement may be from there already.
        free = [one for one in landmarks if one.seen[-1].time < self._time and one.seen[-1].first is first]
        rated = [(_unlike(graph, one, pose, bearing), k) for k, one in enumerate(free)]
        unlike, best = min(rated, default=(math.inf, 0))
        if unlike < 1.0:
            return free[best]
        landmarks.append(_Landmark())
        return landmarks[-1]

    def _stretch(self, landmark: _Landmark, azimuth: float) -> int:
        """Number of the stretch that a bearing of a landmark belongs to."""
        if landmark.stretch is None or abs(wrap(azimuth - landmark.stretch[1])) > _ALIKE_RAD:
            landmark.stretch = self._stretches, azimuth
            self._stretches += 1
        return landmark.stretch[0]

    def _lately(self, landmark: _Landmark) -> bool:
        """Whether a landmark has appeared on the last metres of way."""
        return self._way_m - landmark.seen[-1].way_m < _GONE_M


def _from_uncertain(
    bearing: Bearing, here: Float[np.ndarray, "3"], spread: Float[np.ndarray, "3 3"]
) -> Bearing:
    """A bearing that is as uncertain as the pose that it was taken from makes it."""
    azimuth = here[2] + bearing.bearing_rad
    turn = np.array([math.sin(azimuth) / bearing.range_m, -math.cos(azimuth) / bearing.range_m, -1.0])
    sigma_rad = math.sqrt(bearing.sigma_rad**2 + float(turn @ spread @ turn))
    return replace(bearing, sigma_rad=min(sigma_rad, math.pi))


def _one_place(graph: PoseGraph, seen: Sequence[_Seen]) -> Float[np.ndarray, "2"] | None:
    """The place that all was seen at, told by directions alone [m]; None if they do not tell one.

    Least squares of the distances of a point from lines of sight, each over the distance along it (Stansfield).
    """
    if len(seen) < _ENOUGH:
        return None
    seen_from = np.array([compose(graph.poses[one.node], one.at) for one in seen])
    azimuth = seen_from[:, 2] + [one.bearing.bearing_rad for one in seen]
    sigma = np.hypot([one.bearing.sigma_rad for one in seen], _HEADING_RAD)
    across = np.column_stack([-np.sin(azimuth), np.cos(azimuth)])
    beside = (across * seen_from[:, :2]).sum(axis=1)
    range_m = np.array([one.bearing.range_m for one in seen])
    away_m = range_m
    for _ in range(_STEPS):
        weighted = across / (sigma * away_m)[:, None]
        information = weighted.T @ weighted
        least, most = np.linalg.eigvalsh(information)
        if least < 1e-9 * most:
            return None
        place = np.linalg.solve(information, weighted.T @ (beside / (sigma * away_m)))
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


def _elsewhere(
    graph: PoseGraph, landmark: _Landmark, pose: Float[np.ndarray, "3"], bearing: Bearing
) -> float:
    """How far a first path comes from elsewhere than a landmark's place, as a part of what is allowed; 1 is too far.

    A landmark without a place is taken to stand where its last sighting, by its strength, says.
    """
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


def _unlike(graph: PoseGraph, landmark: _Landmark, pose: Float[np.ndarray, "3"], bearing: Bearing) -> float:
    """How far a further path is from where an image is expected, as a part of what is allowed; 1 is too far."""
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
    """The place that one sighting tells."""
    pose = compose(graph.poses[seen.node], seen.at)
    azimuth = pose[2] + seen.bearing.bearing_rad
    return np.asarray(pose[:2] + seen.bearing.range_m * np.array([math.cos(azimuth), math.sin(azimuth)]))


def _hold(graph: PoseGraph, landmark: _Landmark, seen: _Seen) -> None:
    """Let what was seen hold the graph."""
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
