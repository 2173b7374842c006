"""Odometry at its own times, and scans whose beams are measured one after another as the robot moves.

The pose of odometry at a time is interpolated between the two readings around it: linear in place, the smaller angle in
yaw. Where a reading comes late or odometry restarts, the motion is unknown.

A lidar that turns measures each beam from another pose. The pose of the robot at the time of each beam, relative to
that at the time of the scan, moves the end of the beam to where it would have been seen at the time of the scan. A beam
that hit nothing turns only. Left out: what moves in the surroundings, and motion out of the plane.
Reference: Zhang and Singh, LOAM: Lidar odometry and mapping in real-time, RSS 2014 (motion within a sweep).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from slam.poses import between, wrap

#: A reading is late if it comes so long after the one before, and after so many times the usual step [s].
_LATE_S, _LATE_STEPS = 0.5, 5.0
#: Odometry restarts where it jumps by more than this [m, rad] at more than this speed [m/s, rad/s], and than so many
#: times the speed that it rarely exceeds.
_JUMP_M, _JUMP_RAD, _JUMP_M_S, _JUMP_RAD_S, _JUMP_TIMES = 0.5, 0.5, 10.0, 20.0, 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class OdometryTrack:
    """Poses of odometry at times of its own."""

    times: Float[np.ndarray, " m"]
    """Times of the readings [s], rising."""
    poses: Float[np.ndarray, "m 3"]
    """Poses of the laser: x [m], y [m], yaw [rad]."""
    known: Bool[np.ndarray, " m"] | None = None
    """Whether the motion since the reading before is known, but for late readings and restarts; None for all."""

    def late(self) -> Bool[np.ndarray, " m"]:
        """Mask of readings that come too long after the one before."""
        step_s = np.diff(self.times, prepend=self.times[0])
        usual_s = float(np.median(step_s[1:])) if len(step_s) > 1 else 0.0
        return step_s > max(_LATE_S, _LATE_STEPS * usual_s)

    def restarts(self) -> Bool[np.ndarray, " m"]:
        """Mask of readings that jump to another place, such as back to where odometry began."""
        step, step_s = np.diff(self.poses, axis=0), np.diff(self.times)
        jumps = np.zeros(len(self.times), bool)
        for size, least, speed in (
            (np.hypot(step[:, 0], step[:, 1]), _JUMP_M, _JUMP_M_S),
            (np.abs(wrap(step[:, 2])), _JUMP_RAD, _JUMP_RAD_S),
        ):
            fast = float(np.percentile(size / step_s, 90)) if len(size) else 0.0
            jumps[1:] |= size > np.maximum(least, max(speed, _JUMP_TIMES * fast) * step_s)
        return jumps

    @cached_property
    def _unknown(self) -> Bool[np.ndarray, " m"]:
        lost = self.late() | self.restarts()
        return lost if self.known is None else lost | ~self.known

    @cached_property
    def _values(self) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        x, y, yaw = self.poses.T
        return x, y, np.unwrap(yaw)

    def at(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
        """Interpolated poses at some times; those of the first and last reading outside of them."""
        return np.column_stack([np.interp(times, self.times, column) for column in self._values])

    def steps(
        self, times: Float[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "k 3"], Bool[np.ndarray, " k"]]:
        """Displacement since the time before, of each time [s], and whether it is known; 0 for the first, or if not."""
        displacement = np.array([np.zeros(3), *(between(a, b) for a, b in pairwise(self.at(times)))])
        known = np.append(True, self.is_known(times[:-1], times[1:]))
        displacement[~known] = 0.0
        return displacement, known

    def is_known(
        self, start: Float[np.ndarray, " k"], end: Float[np.ndarray, " k"]
    ) -> Bool[np.ndarray, " k"]:
        """Whether the motion between two times [s] each, the earlier one first, is known."""
        # Readings that end an interval in which one of the times lies, or between the two.
        first, last = np.searchsorted(self.times, start, "right"), np.searchsorted(self.times, end, "left")
        count = np.append(0, np.cumsum(self._unknown))
        n_readings = len(self.times)
        return count[np.minimum(last + 1, n_readings)] - count[np.minimum(first, n_readings)] <= 0


def relative(start: Float[np.ndarray, "3"], poses: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """Poses in the frame of another: x, y [m], yaw [rad]."""
    c, s = math.cos(start[2]), math.sin(start[2])
    x, y, yaw = (poses - start).T
    return np.column_stack([c * x + s * y, c * y - s * x, wrap(yaw)])


def corrected_beams(
    bearing_rad: Float[np.ndarray, " w"],
    range_m: Float[np.ndarray, " w"],
    motion: Float[np.ndarray, "w 3"],
) -> tuple[Float[np.ndarray, " w"], Float[np.ndarray, " w"]]:
    """Beams as from one pose, in order of their direction from there.

    Args:
        bearing_rad: Directions in the frame of the laser as each is measured [rad], rising.
        range_m: How far each beam went [m]; inf where nothing was hit, NaN where nothing was measured.
        motion: Pose of the laser at the time of each beam, in the frame of the scan's time: x, y [m], yaw [rad].

    Returns:
        Directions [rad] in [-pi, pi], rising, at unequal steps, and ranges [m]. What a full turn sees again comes last,
        as not measured.
    """
    angle = bearing_rad + motion[:, 2]
    hit = np.isfinite(range_m)
    reached = np.where(hit, range_m, 0.0)
    x, y = motion[:, 0] + reached * np.cos(angle), motion[:, 1] + reached * np.sin(angle)
    again = ~((angle >= angle[0]) & (angle < angle[0] + 2 * math.pi)) | np.isnan(range_m)
    bearing = np.where(again, math.pi, np.where(hit, np.arctan2(y, x), wrap(angle)))
    ranges = np.where(again, np.nan, np.where(hit, np.hypot(x, y), range_m))
    order = np.lexsort((again, bearing))
    return bearing[order], ranges[order]
