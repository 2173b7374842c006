"""A robot's log for mapping: scans of a laser, and odometry between them."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from robosim.logs.beam_times import OdometryTrack, corrected_beams, relative
from robosim.support.checks import ADVANCED, Range, checked
from slam.poses import Pose, Poses, between, compose

logger = logging.getLogger(__name__)

#: Bearings of one laser that differ by less from scan to scan are the same, rounded [rad].
_SAME_RAD = 1e-3
#: Scans last at most this, relative to the time from one to the next.
LONGEST_TURN = 1.2
#: Beams are measured no more than this from the time of their scan [s].
_MOST_LATE_S = 10.0


def check_bearings(
    lines: Sequence[int], bearings: Sequence[Float[np.ndarray, " w"]] | Float[np.ndarray, "n w"]
) -> None:
    """Raise ValueError for the first line whose bearings [rad], all of them or first and last, are not those before."""
    first = bearings[0]
    for line, other in zip(lines, bearings, strict=True):
        if not (np.abs(other - first) <= _SAME_RAD).all():
            raise ValueError(
                f"line {line} has bearings from {other[0]:g} to {other[-1]:g} rad, those before from {first[0]:g} to "
                f"{first[-1]:g}; give the scans of one laser"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLog:
    """A log, with one entry per scan."""

    name: str
    """Name of the log in reports."""
    bearing_rad: Float[np.ndarray, "*n w"]
    """Directions of the beams in the laser's frame [rad], rising: counter-clockwise, 0 ahead; or a row per scan."""
    range_m: Float[np.ndarray, "n w"]
    """Range of each beam [m]; inf where nothing was hit, NaN where nothing was measured."""
    displacement: Float[np.ndarray, "n 3"]
    """Displacement since the scan before by odometry: x, y [m], yaw [rad] in the frame before; 0 for the first."""
    known: Bool[np.ndarray, " n"]
    """Whether odometry measured it."""
    times: Float[np.ndarray, " n"]
    """Times [s], rising; numbers of the scans if the log's own times do not rise."""
    is_counted: bool = False
    """Whether times are numbers of the scans."""
    beam_s: Float[np.ndarray, "*n w"] | None = None
    """Time of each beam after its scan's [s], or a row per scan; None if scans are those of one moment."""
    track: OdometryTrack | None = None
    """Odometry at times of its own; None if it is known at the scans only."""
    file: Path | None = None
    """The file it was read from, for messages."""
    mount: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Pose of the laser on the robot, whose poses all others are: x, y [m], yaw [rad]."""
    reference: Float[np.ndarray, "n 3"] | None = None
    """Poses from another source: x [m], y [m], yaw [rad]; None if the log has none."""

    def odometry(self) -> Poses:
        """Poses by odometry alone, from (0, 0, 0)."""
        poses = [np.zeros(3)]
        for step in self.displacement[1:]:
            poses.append(compose(poses[-1], step))
        return np.array(poses)

    def beams(self) -> Float[np.ndarray, "n w"]:
        """Directions of the beams of each scan [rad]."""
        return np.broadcast_to(self.bearing_rad, self.range_m.shape)

    def step_rad(self) -> float:
        """Mean angle between beams [rad]."""
        return float(np.diff(self.bearing_rad).mean())

    def moving(self) -> Bool[np.ndarray, " n"]:
        """Scans of beams at different times between which odometry does not know the motion."""
        if self.beam_s is None:
            return np.zeros(len(self.times), bool)
        late_s = np.broadcast_to(self.beam_s, self.range_m.shape)
        first, last = np.minimum(late_s.min(axis=1), 0), np.maximum(late_s.max(axis=1), 0)
        return ~self._track().is_known(self.times + first, self.times + last)

    def corrected(self, other: OdometryTrack | None = None) -> "RobotLog":
        """The log with scans as from one pose each, by the motion of odometry, or of `other` where that is not known.

        Scans remain as they are where neither is.
        """
        if self.beam_s is None:
            return self
        bearing_rad, range_m = self.beams().copy(), self.range_m.copy()
        late_s = np.broadcast_to(self.beam_s, range_m.shape)
        for k, unknown in enumerate(self.moving()):
            track = other if unknown else self._track()
            if track is not None:
                poses = track.at(self.times[k] + np.append(0.0, late_s[k]))
                bearing_rad[k], range_m[k] = corrected_beams(
                    bearing_rad[k], range_m[k], relative(poses[0], poses[1:])
                )
        return replace(self, bearing_rad=bearing_rad, range_m=range_m, beam_s=None)

    def seen_from(self, offset: Pose) -> "RobotLog":
        """The log of a frame at a pose on the robot [m, rad] instead of the robot's; the first pose is (0, 0, 0)."""
        if not offset.any():
            return self
        steps = [between(offset, compose(step, offset)) for step in self.displacement]
        track = self.track
        if track is not None:
            track = replace(track, poses=np.array([compose(pose, offset) for pose in track.poses]))
        return replace(self, displacement=np.array(steps), track=track, mount=between(offset, self.mount))

    def laser_poses(self, poses: Poses) -> Poses:
        """Poses of the laser, of those of the robot: x, y [m], yaw [rad]."""
        return np.array([compose(pose, self.mount) for pose in poses])

    def _track(self) -> OdometryTrack:
        """Odometry of the laser; `mount` is zero where beams are corrected."""
        return self.track or OdometryTrack(times=self.times, poses=self.odometry(), known=self.known)


@dataclass(frozen=True, kw_only=True)
@checked
class BagTopics:
    """Topics to read of a bag; those that are not given are found by type."""

    scan_topic: Annotated[str | None, ADVANCED] = None
    """Topic of a bag with scans, point clouds or depth images."""
    odometry_topic: Annotated[str | None, ADVANCED] = None
    """Topic of a bag with odometry; tf for transforms, none for a map of scans alone."""
    frame: Annotated[str | None, ADVANCED] = None
    """Frame of a bag whose trajectory is given, such as that of the laser; base_link by default, or base_footprint."""
    slice_m: Annotated[float, Range(-10, 100, "m"), ADVANCED] = 0.3
    """Height above the base at which point clouds and depth images of a bag become scans [m]."""


@runtime_checkable
class LogReader(Protocol):
    """Reads logs of robots of one format."""

    takes_scans: bool = False
    """Whether scans are in another file."""

    def matches(self, path: Path) -> bool:
        """Whether a file is of this format, by its ending or its first bytes."""

    def read(self, path: Path, scans: Path | None, topics: BagTopics) -> RobotLog:
        """The log in a file; `scans` and `topics` are for formats that need them. FileError if it is damaged."""


def report_track(
    path: Path,
    track: OdometryTrack,
    effect: str = "the motion is unknown there, and scans alone give it. If the map comes apart, {remedy}",
) -> None:
    """Warn of late readings and restarts, and of their effect."""
    step_s = np.diff(track.times, prepend=track.times[0])
    for is_faulty, what, remedy in (
        (track.late(), "the reading {step:.3g} s before is the last", "record odometry without gaps"),
        (track.restarts(), "odometry restarts or jumps", "give a log for each run"),
    ):
        if is_faulty.any():
            k = int(is_faulty.argmax())
            logger.warning(
                f"{path}: at {track.times[k]:.6f} s {what.format(step=step_s[k])} ({is_faulty.sum()} such places); "
                f"{effect.format(remedy=remedy)}."
            )


def with_beam_times(log: RobotLog, first_s: float, last_s: float) -> RobotLog:
    """The log with scans whose first and last beam are measured so long after a scan's time [s].

    Raises:
        ValueError: If the log has no times, or scans last longer than from one to the next.
    """
    name = log.file or log.name
    if log.is_counted:
        raise ValueError(
            f"{name}: its scans have no times, so that beams have none either. Leave --beam-seconds away, or give a "
            "log with times."
        )
    if not (abs(first_s) <= _MOST_LATE_S and abs(last_s) <= _MOST_LATE_S):
        raise ValueError(
            f"{name}: --beam-seconds {first_s:g} {last_s:g}, expected times of {_MOST_LATE_S:g} s at most. Give "
            "those of the first and the last beam after a scan's time, in seconds."
        )
    usual_s, turn_s = float(np.median(np.diff(log.times))), abs(last_s - first_s)
    if turn_s > LONGEST_TURN * usual_s:
        raise ValueError(
            f"{name}: --beam-seconds {first_s:g} {last_s:g} makes scans of {turn_s:g} s, and they follow each other "
            f"after {usual_s:.3g} s. Give the times of the first and the last beam after a scan's time, in seconds."
        )
    beam_s = np.linspace(first_s, last_s, log.range_m.shape[1])
    return replace(log, beam_s=np.broadcast_to(beam_s, log.bearing_rad.shape))
