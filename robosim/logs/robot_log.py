"""A robot's log for mapping: scans of a laser, and odometry between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from slam.poses import compose

#: Bearings of one laser that differ by less from scan to scan are the same, rounded [rad].
_SAME_RAD = 1e-3


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
    """Its name in reports."""
    bearing_rad: Float[np.ndarray, " w"]
    """Directions of the beams in the laser's frame [rad], rising: counter-clockwise, 0 ahead."""
    range_m: Float[np.ndarray, "n w"]
    """How far each beam went [m]; inf where nothing was hit."""
    displacement: Float[np.ndarray, "n 3"]
    """Displacement since the scan before by odometry: x, y [m], yaw [rad] in the frame before; 0 for the first."""
    known: Bool[np.ndarray, " n"]
    """Whether odometry measured it."""
    times: Float[np.ndarray, " n"]
    """Times [s], rising; numbers of the scans if the log's own times do not rise."""
    file: Path | None = None
    """The file it was read from, for messages."""
    reference: Float[np.ndarray, "n 3"] | None = None
    """Poses from another source: x [m], y [m], yaw [rad]; None if the log has none."""

    def odometry(self) -> Float[np.ndarray, "n 3"]:
        """Poses by odometry alone, from (0, 0, 0)."""
        poses = [np.zeros(3)]
        for step in self.displacement[1:]:
            poses.append(compose(poses[-1], step))
        return np.array(poses)
