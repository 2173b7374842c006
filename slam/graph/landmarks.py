"""Sources of a radio as landmarks: where they stand comes out with the trajectory, and holds it.

What appears in line of sight is the source itself, and the same whenever it is seen again. So is, whatever its link
state is taken for, what appears where the source stands and as strong as from there; and what on some metres of way
keeps to one place, by its directions and by what free space makes of its strength. Beside a source, other paths come
from mirror images, which stand still too: they are followed as long as they appear where they are expected, and are
other landmarks after that. What was seen too seldom, or does not keep to a place, holds nothing.

Bearings are taken again only once the robot has moved: from one place, they err alike.
Reference: Gentner et al., Multipath assisted positioning with simultaneous localization and mapping, IEEE Trans.
Wireless Communications 15 (2016), whose virtual transmitters these are.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slam.graph.pose_graph import PoseGraph, Sighting
from slam.poses import compose, wrap
from slam.sensing.bearings import Bearing

#: Bearings are taken again after a way, or a turn, of this [m, rad].
_APART_M, _APART_RAD = 0.25, math.radians(15.0)
#: Sightings after which a landmark holds the poses.
_ENOUGH = 5
#: What is followed may appear so many standard deviations, and so far [rad, m], from where it is expected.
_GATE, _JITTER_RAD, _JITTER_M = 4.0, math.radians(1.0), 0.1
#: It is given up when it has not appeared on so much way [m].
_GONE_M = 3.0
#: A path is as strong as in line of sight if free space would do with a distance within so much of it (logarithm).
_WEAK = 0.1
#: What keeps to a place does so on so many sightings and so much way [m], with root mean squares of so much at most
#: (logarithm, rad).
_KEPT, _KEPT_M, _KEPT_LOG, _KEPT_RAD = 8, 2.0, 0.05, math.radians(0.5)
#: Line of sight is believed from this probability on.
_BELIEVED = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Transmitter:
    """Where a source is taken to stand."""

    xy: Float[np.ndarray, "2"]
    """In `map` [m]."""
    covariance: Float[np.ndarray, "2 2"]
    """Of that [m^2]."""
    sightings: int
    """Bearings in line of sight that it comes from."""


class _Seen(NamedTuple):
    """Where a landmark appeared once, and from where."""

    time: int
    way_m: float
    node: int
    at: Float[np.ndarray, "3"]
    bearing: Bearing
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


class Landmarks:
    """All that has been seen of sources."""

    def __init__(self) -> None:
        self._direct: dict[str, _Landmark] = {}
        self._followed: dict[str, list[_Landmark]] = defaultdict(list)
        self._unsure: dict[str, list[_Seen]] = defaultdict(list)
        self._last: Float[np.ndarray, 3] | None = None
        self._time, self._way_m = 0, 0.0

    def see(self, graph: PoseGraph, here: Float[np.ndarray, "3"], bearings: Sequence[Bearing]) -> None:
        """Take in what appears from a pose.

        Args:
            graph: Whose last pose `here` is told in.
            here: Where the robot is: x [m], y [m], yaw [rad].
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
        for bearing in bearings:
            name, first = bearing.source, bearing.beyond_m is None
            if not first and name not in firsts:
                continue
            seen = _Seen(self._time, self._way_m, node, here.copy(), bearing, None if first else firsts[name])
            landmark = self._source(graph, pose, seen) if first else self._image(graph, pose, bearing)
            if landmark is None:
                continue
            if first:
                firsts[name] = landmark
            landmark.seen.append(seen)
            if landmark.place is not None:
                _hold(graph, landmark, seen)
            elif landmark.place_xy is not None or len(landmark.seen) >= _ENOUGH:
                known = landmark.place_xy
                xy = _appears(graph, seen) if known is None else known
                landmark.place = graph.add_place(xy, known=known is not None)
                for each in landmark.seen:
                    _hold(graph, landmark, each)

    def transmitters(self, graph: PoseGraph) -> dict[str, Transmitter]:
        """Where sources stand that were seen in line of sight."""
        return {
            name: Transmitter(
                xy=graph.places[landmark.place].copy(),
                covariance=graph.place_covariance(landmark.place),
                sightings=len(landmark.seen),
            )
            for name, landmark in self._direct.items()
            if landmark.place is not None
        }

    def _source(self, graph: PoseGraph, pose: Float[np.ndarray, "3"], seen: _Seen) -> _Landmark | None:
        """The source that a first path comes from; None if nobody knows that it comes from there."""
        bearing = seen.bearing
        source = self._direct.get(bearing.source)
        if bearing.direct >= _BELIEVED:
            return source or self._direct.setdefault(bearing.source, _Landmark(place_xy=bearing.place_xy))
        if source is not None:
            return source if _is_there(graph, source, pose, bearing) else None
        unsure = self._unsure[bearing.source]
        unsure.append(seen)
        if not _keeps_to_a_place(graph, unsure):
            del unsure[: -2 * _KEPT]
            return None
        source = self._direct[bearing.source] = _Landmark(place_xy=bearing.place_xy)
        source.seen.extend(self._unsure.pop(bearing.source)[:-1])
        return source

    def _image(self, graph: PoseGraph, pose: Float[np.ndarray, "3"], bearing: Bearing) -> _Landmark:
        """The mirror image that a further path comes from."""
        followed = self._followed[bearing.source]
        followed[:] = [one for one in followed if self._way_m - one.seen[-1].way_m < _GONE_M]
        # Another path of this measurement may be from there already.
        free = [one for one in followed if one.seen[-1].time < self._time]
        rated = [(_unlike(graph, one, pose, bearing), k) for k, one in enumerate(free)]
        unlike, best = min(rated, default=(math.inf, 0))
        if unlike < 1.0:
            return free[best]
        followed.append(_Landmark())
        return followed[-1]


def _is_there(graph: PoseGraph, source: _Landmark, pose: Float[np.ndarray, "3"], bearing: Bearing) -> bool:
    """Whether a first path comes from where a source stands, and is as strong as from there."""
    if source.place is None:
        return False
    away_m = math.hypot(*(graph.places[source.place] - pose[:2]))
    weak = abs(math.log(bearing.range_m / max(away_m, 1e-3)))
    return weak < _WEAK and _unlike(graph, source, pose, bearing) < 1.0


def _keeps_to_a_place(graph: PoseGraph, unsure: Sequence[_Seen]) -> bool:
    """Whether directions and distances of the last paths are of one place, seen from different ones."""
    last = unsure[-_KEPT:]
    if len(last) < _KEPT or last[-1].way_m - last[0].way_m < _KEPT_M:
        return False
    seen_from = np.array([compose(graph.poses[seen.node], seen.at) for seen in last])
    away = np.mean([_appears(graph, seen) for seen in last], axis=0) - seen_from[:, :2]
    azimuth = seen_from[:, 2] + [seen.bearing.bearing_rad for seen in last]
    turn = wrap(np.arctan2(away[:, 1], away[:, 0]) - azimuth)
    far = np.log(np.hypot(*away.T) / [seen.bearing.range_m for seen in last])
    return bool(np.sqrt(np.mean(turn**2)) < _KEPT_RAD and np.sqrt(np.mean(far**2)) < _KEPT_LOG)


def _unlike(graph: PoseGraph, landmark: _Landmark, pose: Float[np.ndarray, "3"], bearing: Bearing) -> float:
    """How far a path is from where a landmark is expected, as a part of what is allowed; 1 is too far."""
    _, _, node, at, before, _ = landmark.seen[-1]
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
    if bearing.beyond_m is None or before.beyond_m is None:
        return unlike if bearing.beyond_m is before.beyond_m else math.inf
    slack_m = _GATE * math.hypot(bearing.sigma_m, before.sigma_m) + _JITTER_M + 2 * moved_m
    return max(unlike, abs(bearing.beyond_m - before.beyond_m) / slack_m)


def _appears(graph: PoseGraph, seen: _Seen) -> Float[np.ndarray, "2"]:
    """The place that one sighting tells."""
    pose = compose(graph.poses[seen.node], seen.at)
    azimuth = pose[2] + seen.bearing.bearing_rad
    return np.asarray(pose[:2] + seen.bearing.range_m * np.array([math.cos(azimuth), math.sin(azimuth)]))


def _hold(graph: PoseGraph, landmark: _Landmark, seen: _Seen) -> None:
    """Let what was seen hold the graph."""
    _, _, node, at, bearing, first = seen
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
        )
    )
