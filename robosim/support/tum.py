"""Trajectories as TUM files: `timestamp x y z qx qy qz qw` a line, in seconds and metres, as evo reads them."""

import logging
import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.support.files import whole_file
from robosim.support.reading import reading
from robosim.support.text_in import check_rising, number_rows

logger = logging.getLogger(__name__)

#: Values of a trajectory are no larger.
_MOST = 1e12
#: Quaternions that are longer or shorter than 1 by more are none.
_OFF_UNIT = 0.05
#: Robots that drive on a floor are not tipped by more than this; by less than the other it is not worth a word [rad].
_TIPPED, _LEVEL = math.radians(20), math.radians(2)


def write_tum(path: Path, times: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n 3"]) -> None:
    """Write a trajectory: times [s], and x [m], y [m], yaw [rad]."""
    zero = np.zeros(len(poses))
    half = poses[:, 2] / 2
    rows = np.column_stack([times, poses[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    with whole_file(path) as partial:
        np.savetxt(partial, rows, fmt="%.9f")


def read_tum(path: Path) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Times [s], rising, and poses x [m], y [m], yaw [rad]; FileError if the file is damaged, or no such trajectory."""
    remedy = "Give lines of: timestamp x y z qx qy qz qw"
    with reading(path, "a trajectory", remedy) as file:
        lines, rows = number_rows(file.read())
        for line, row in zip(lines, rows, strict=True):
            if len(row) != 8:
                kitti = ", as KITTI's poses have, which have no times" if len(row) == 12 else ""
                raise ValueError(f"line {line} has {len(row)} values{kitti}, expected 8")
            if not all(abs(value) <= _MOST for value in row):
                raise ValueError(f"line {line} has a value that is NaN, infinite or above {_MOST:g}")
        if not rows:
            raise ValueError("there is no pose in it")
        values = np.array(rows)
        check_rising(lines, values[:, 0])
        return values[:, 0], np.column_stack([values[:, 1:3], _yaw(path, lines, values[:, 4:])])


def _yaw(path: Path, lines: list[int], quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " n"]:
    """Yaw [rad] of robots on a floor from quaternions (qx, qy, qz, qw), which are normalised."""
    length = np.linalg.norm(quaternion, axis=1)
    off = np.abs(length - 1) > _OFF_UNIT
    if off.any():
        k = int(off.argmax())
        raise ValueError(f"line {lines[k]} has a quaternion of length {length[k]:.3g}, expected 1")
    qx, qy, qz, qw = (quaternion / length[:, None]).T
    tilt = np.arccos(np.clip(1 - 2 * (qx**2 + qy**2), -1, 1))
    over = tilt > _TIPPED
    if over.any():
        k = int(over.argmax())
        raise ValueError(
            f"line {lines[k]} tips the robot by {np.degrees(tilt[k]):.0f} degrees, expected a robot on a floor; the "
            "order of a quaternion is qx qy qz qw, qw last"
        )
    if tilt.max() > _LEVEL:
        logger.warning(
            f"{path}: poses tip by up to {np.degrees(tilt.max()):.1f} degrees (line {lines[int(tilt.argmax())]}); of "
            "their rotation only the heading is used."
        )
    return np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy**2 + qz**2))
