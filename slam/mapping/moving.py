"""People and other moving things: found in scans, left out of the map, and tracked.

A thing counts as moving if it stands where the map knows free floor, away from all obstacles, or where a tracked one is
expected. Narrow things in front of the background that come into view beyond the known floor are candidates: they stay
out of the map for some decisions too, until they have moved, or have stood still for long enough to be part of the
building. Each thing has a Kalman filter with constant velocity.

Scans are cut into segments of neighbouring columns (beams) where ranges jump, and where known free floor ends. Centres
of things lie half of a person's depth behind the surface.

Left out: shapes, and people who stand still when they first come into view, who are mapped until they walk away.
References: Y. Bar-Shalom, X. R. Li and T. Kirubarajan, Estimation with applications to tracking and navigation (2001),
section 6.3.2, for the filter; D. Wolf and G. Sukhatme, Mobile robot simultaneous localization and mapping in dynamic
environments, Autonomous Robots 19 (2005), for maps of free space that reveal what moves.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from robosim.support.checks import Range, checked
from robosim.support.compiled import compiled
from slam.grid import Grid, GridFrame, MovingThing
from slam.poses import Pose, between, to_map, wrap
from slam.sensing.laser import LaserScan
from slam.sensing.projection import Scan

#: Neighbouring ranges that differ by less are of one segment [m].
_JUMP_M = 0.25
#: Centres of segments of one thing lie within this distance [m].
_SAME_M = 0.35
#: Points within this distance of the centre of a thing are left out [m].
_BODY_M = 0.27
#: Distance from the surface of a thing to its centre [m].
_DEPTH_M = 0.12
#: Points outside of a disk whose place is known, by less than this, are of it: places err [m].
_AROUND_M = 0.12
#: A thing is not where it is expected if a sensor sees farther than there by this [m].
_BEYOND_M = 0.5
#: Time in which velocities of things out of sight decay by e [s].
_STOPS_S = 1.0
#: A thing stands as long as it stays within this distance of a place [m].
_STANDING_M = 0.25
#: Standard deviations of a measured centre [m], and of accelerations [m/s2]; speed of a new thing [m/s].
_CENTRE_M, _ACCEL, _SPEED_MPS = 0.08, 1.0, 0.7


@dataclass(frozen=True, kw_only=True)
@checked
class MovingConfig:
    """When something in a scan counts as moving."""

    tracks: bool = False
    """Whether moving things are looked for; without, all that is seen is part of the building."""
    margin_m: Annotated[float, Range(0, 1, "m")] = 0.1
    """Distance from obstacles and unknown cells of the map at which floor counts as known to be free [m]."""
    width_m: Annotated[float, Range(0.1, 20, "m")] = 0.9
    """Largest width of a thing [m]."""
    range_m: Annotated[float, Range(0.5, 100, "m")] = 5.0
    """Farther things are not looked for [m]."""
    gate_m: Annotated[float, Range(0.1, 5, "m")] = 0.6
    """Distance within which a segment is a tracked thing [m]."""
    still: Annotated[int, Range(1, 1000, "sightings")] = 6
    """Sightings within `still_m` after which a candidate is part of the building."""
    still_m: Annotated[float, Range(0.01, 1, "m")] = 0.15
    """See `still` [m]."""
    forget_s: Annotated[float, Range(0.1, 60, "s")] = 5.0
    """Time out of sight after which a thing is forgotten [s]."""
    update_s: Annotated[float, Range(0.01, 60, "s")] = 0.6
    """Time between updates where none is given [s]."""


@dataclass(eq=False)
class _Track:
    state: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "4 4"]
    number: int
    first: Float[np.ndarray, "2"]
    """Where it was first seen."""
    is_confirmed: bool
    sightings: int = 1
    unseen_s: float = 0.0
    stood_s: float = 0.0
    stands_at: Float[np.ndarray, "2"] = field(default_factory=lambda: np.full(2, np.inf))

    def predict(self, time_s: float) -> None:
        """Let time pass."""
        F = np.eye(4)
        F[0, 2] = F[1, 3] = time_s
        if self.unseen_s > 0:
            F[2, 2] = F[3, 3] = math.exp(-time_s / _STOPS_S)  # it may have stopped
        self.state = F @ self.state
        a, b, c = time_s**4 / 4, time_s**3 / 2, time_s**2
        Q = _ACCEL**2 * np.array([[a, 0, b, 0], [0, a, 0, b], [b, 0, c, 0], [0, b, 0, c]])
        self.covariance = F @ self.covariance @ F.T + Q
        self.unseen_s += time_s
        self.stood_s += time_s

    def correct(self, xy: Float[np.ndarray, "2"]) -> None:
        """Add a measured position."""
        S = self.covariance[:2, :2] + _CENTRE_M**2 * np.eye(2)
        gain = np.linalg.solve(S, self.covariance[:2]).T
        self.state = self.state + gain @ (xy - self.state[:2])
        self.covariance = self.covariance - gain @ self.covariance[:2]
        self.unseen_s, self.sightings = 0.0, self.sightings + 1
        if math.hypot(*(self.state[:2] - self.stands_at)) > _STANDING_M:
            self.stood_s, self.stands_at = 0.0, self.state[:2].copy()


class _Segment(NamedTuple):
    """Neighbouring points of one sensor that may be a thing."""

    xy: Float[np.ndarray, "2"]
    """Its centre in `map` [m]."""
    sensor: int
    points: slice
    free: float
    """Share of points on floor that is known to be free."""
    unknown: float
    """Share of points on unknown floor, or next to it."""
    is_front: bool
    """Whether what is seen on both sides of it lies farther off."""


class MovingThings:
    """Tracks of all moving things."""

    def __init__(self, config: MovingConfig) -> None:
        self.config = config
        self._tracks: list[_Track] = []
        self._static: list[np.ndarray] = []
        self._count = 0

    def things(self) -> tuple[MovingThing, ...]:
        """Estimates of the tracked things."""
        return tuple(
            MovingThing(
                xy=track.state[:2].copy(),
                velocity=track.state[2:].copy(),
                covariance=track.covariance.copy(),
                stood_s=track.stood_s,
                unseen_s=track.unseen_s,
                number=track.number,
            )
            for track in self._tracks
        )

    def has_near(self, xy: Float[np.ndarray, "2"], distance_m: float) -> bool:
        """Whether a tracked thing is nearer to a point than a distance [m]."""
        return any(math.hypot(*(track.state[:2] - xy)) < distance_m for track in self._tracks)

    def leave_out(
        self,
        scan: Scan,
        laser: LaserScan | None,
        pose: Pose,
        probability: Float32[Grid, "ny nx"],
        frame: GridFrame,
        time_s: float | None = None,
        others: Float[np.ndarray, "k 3"] | None = None,
    ) -> tuple[Scan, LaserScan | None]:
        """Track what moves in the scans of a camera and a laser; returns them without it. See `update`.

        If nothing moves but `others`, disks whose centres and radii (x, y, radius) [m] are known, nothing is tracked.
        """
        with np.errstate(invalid="ignore"):  # where nothing was hit
            points = np.column_stack([scan.depth_m + scan.ahead_m, scan.depth_m * scan.left])
        views = [np.where(scan.hit[:, None], points, np.nan).astype(float)]
        if laser is not None:
            angle = laser.bearing_rad
            reach_m = np.where(laser.hit, laser.range_m, np.nan)
            points = reach_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
            points += [laser.ahead_m, 0.0]
            views.append(points)
        if others is None:
            masks = self.update(views, pose, probability, frame, time_s)
        else:
            self._tracks = []
            masks = [_covered(to_map(pose, points), others) for points in views]
        return scan.without(masks[0]), laser if laser is None else laser.without(masks[1])

    def update(
        self,
        views: Sequence[Float[np.ndarray, "_ 2"]],
        pose: Pose,
        probability: Float32[Grid, "ny nx"],
        frame: GridFrame,
        time_s: float | None = None,
    ) -> list[Bool[np.ndarray, " _"]]:
        """Find and track moving things in the scans of all sensors.

        Args:
            views: Points of each sensor (x ahead, y left) [m], in order of their bearing; NaN where nothing was hit.
            pose: Predicted pose of the robot.
            probability: Probability of an obstacle on the map.
            frame: Of the map.
            time_s: Time since the last update.

        Returns:
            Which points belong to moving things or candidates, for each sensor.
        """
        for track in self._tracks:
            track.predict(self.config.update_s if time_s is None else time_s)
        masks = [np.zeros(len(points), bool) for points in views]
        unmatched: list[_Segment] = []
        assigned: dict[int, list[_Segment]] = {}
        for sensor, points in enumerate(views):
            for segment in self._segments(sensor, points, pose, probability, frame):
                if (near := self._nearest(segment)) is None:
                    unmatched.append(segment)
                else:
                    assigned.setdefault(near.number, []).append(segment)
        for track in self._tracks:
            if candidates := assigned.get(track.number):
                # Somebody else may stand next to it.
                gaps_m = [math.hypot(*(candidate.xy - track.state[:2])) for candidate in candidates]
                nearest = candidates[int(np.argmin(gaps_m))]
                is_own = [math.hypot(*(candidate.xy - nearest.xy)) < _SAME_M for candidate in candidates]
                assigned[track.number] = list(compress(candidates, is_own))
                unmatched += compress(candidates, np.logical_not(is_own))
                track.correct(np.mean([candidate.xy for candidate in assigned[track.number]], axis=0))
        self._forget_absent(views, pose)
        for segment in unmatched:
            if self._begin(segment):
                assigned[self._count] = [segment]
        for segment in (candidate for group in assigned.values() for candidate in group):
            masks[segment.sensor][segment.points] = True
        # The rest of a body may look like a part of the wall next to it.
        for track in self._tracks:
            centre = between(pose, np.array([*track.state[:2], 0.0]))[:2]
            for points, mask in zip(views, masks, strict=True):
                mask |= np.hypot(*(points - centre).T) < _BODY_M
        self._judge()
        return masks

    def _segments(
        self,
        sensor: int,
        points: Float[np.ndarray, "n 2"],
        pose: Pose,
        probability: Float32[Grid, "ny nx"],
        frame: GridFrame,
    ) -> Iterator[_Segment]:
        """Segments narrow enough to be a thing."""
        config, range_m = self.config, np.hypot(*points.T)
        known = range_m <= config.range_m  # not for NaN
        placed = to_map(pose, np.where(known[:, None], points, 0.0))
        iy, ix = frame.index(placed)
        margin = math.ceil(config.margin_m / frame.resolution_m)
        y0, x0 = (max(int(index.min()) - margin, 0) for index in (iy, ix))
        around = probability[y0 : max(int(iy.max()) + margin, 0) + 1, x0 : max(int(ix.max()) + margin, 0) + 1]
        kind = _kinds(np.ascontiguousarray(around), iy - y0, ix - x0, margin)
        with np.errstate(invalid="ignore"):
            cut = (np.abs(np.diff(range_m)) > _JUMP_M) | ~known[1:] | ~known[:-1]
        cut |= (kind[1:] == _FREE) != (kind[:-1] == _FREE)
        edges = np.concatenate([[0], np.flatnonzero(cut) + 1, [len(points)]])
        for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            width_m = math.hypot(*(points[last - 1] - points[first]))
            if last - first < 2 or not known[first] or width_m > config.width_m:
                continue
            beams, nearest_m = slice(first, last), float(range_m[first:last].min())
            sides = [range_m[k] for k in (first - 1, last) if 0 <= k < len(points)]
            middle = points[beams].mean(axis=0)
            yield _Segment(
                xy=to_map(pose, middle * (1 + _DEPTH_M / max(nearest_m, 0.1))),
                sensor=sensor,
                points=beams,
                free=float(np.mean(kind[beams] == _FREE)),
                unknown=float(np.mean(kind[beams] == _UNKNOWN)),
                is_front=len(sides) == 2 and not any(side < nearest_m + _JUMP_M for side in sides),
            )

    def _nearest(self, segment: _Segment) -> _Track | None:
        """The track that a segment may belong to: one near by, where the map does not explain it."""
        if segment.free + segment.unknown < 0.5:
            return None
        gaps = [(math.hypot(*(track.state[:2] - segment.xy)), track) for track in self._tracks]
        gap_m, track = min(gaps, key=lambda pair: pair[0], default=(math.inf, None))
        return track if gap_m < self.config.gate_m else None

    def _begin(self, segment: _Segment) -> bool:
        """Begin a track with a segment, if it may be a moving thing."""
        is_moving = segment.free >= 0.5
        is_static = any(math.hypot(*(place - segment.xy)) < 2 * self.config.still_m for place in self._static)
        if not is_moving and (is_static or not segment.is_front or segment.unknown < 0.5):
            return False
        self._count += 1
        covariance = np.diag([_CENTRE_M**2] * 2 + [_SPEED_MPS**2] * 2)
        state = np.array([*segment.xy, 0.0, 0.0])
        self._tracks.append(_Track(state, covariance, self._count, segment.xy, is_moving))
        return True

    def _forget_absent(self, views: Sequence[Float[np.ndarray, "_ 2"]], pose: Pose) -> None:
        """End tracks that are not seen where a sensor sees farther than they would be."""
        left = []
        for track in self._tracks:
            offset = between(pose, np.array([*track.state[:2], 0.0]))[:2]
            away_m, bearing = math.hypot(*offset), math.atan2(offset[1], offset[0])
            is_absent = False
            for points in views if track.unseen_s > 0 else ():
                ahead = (
                    np.abs(wrap(np.arctan2(points[:, 1], points[:, 0]) - bearing)) * away_m < 0.5 * _DEPTH_M
                )
                is_absent |= bool(ahead.any() and np.hypot(*points[ahead].T).min() > away_m + _BEYOND_M)
            if not is_absent:
                left.append(track)
        self._tracks = left

    def _judge(self) -> None:
        """Confirm candidates that have moved, and end tracks that are out of sight or part of the building."""
        left = []
        for track in self._tracks:
            moved_m = math.hypot(*(track.state[:2] - track.first))
            track.is_confirmed |= track.sightings >= 3 and moved_m > 2 * self.config.still_m
            if not track.is_confirmed and track.sightings >= self.config.still:
                self._static.append(track.state[:2])
            elif track.unseen_s <= self.config.forget_s:
                left.append(track)
        self._tracks = left


def _covered(points: Float[np.ndarray, "n 2"], disks: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " n"]:
    """Which points (x, y) [m] lie in a disk, or hardly outside of it; none that are NaN."""
    away_m = np.hypot(*(points[:, None] - disks[:, :2]).transpose(2, 0, 1))
    return np.asarray((away_m < disks[:, 2] + _AROUND_M).any(axis=1))


#: Kinds of cells around a point: an obstacle near, unknown cells near, or free all around.
_OBSTACLE, _UNKNOWN, _FREE = 0, 1, 2


@compiled
def _kinds(
    probability: Float32[np.ndarray, "ny nx"], iy: np.ndarray, ix: np.ndarray, margin: int
) -> Int[np.ndarray, " n"]:
    """Kind of the cells within some cells of each point's."""
    kinds = np.empty(len(iy), np.int64)
    for k in range(len(iy)):
        kind = _FREE
        for i in range(iy[k] - margin, iy[k] + margin + 1):
            for j in range(ix[k] - margin, ix[k] + margin + 1):
                if not (0 <= i < probability.shape[0] and 0 <= j < probability.shape[1]):
                    kind = min(kind, _UNKNOWN)
                elif probability[i, j] > 0.5:
                    kind = _OBSTACLE
                elif probability[i, j] == 0.5:
                    kind = min(kind, _UNKNOWN)
        kinds[k] = kind
    return kinds
