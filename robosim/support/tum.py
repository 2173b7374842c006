"""Trajectories as TUM files: `timestamp x y z qx qy qz qw` a line, in seconds and metres, as evo reads them."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.support.files import whole_file
from robosim.support.reading import reading

#: Values of a trajectory are no larger.
_MOST = 1e12


def write_tum(path: Path, times: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n 3"]) -> None:
    """Write a trajectory: times [s], and x [m], y [m], yaw [rad]."""
    zero = np.zeros(len(poses))
    half = poses[:, 2] / 2
    rows = np.column_stack([times, poses[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    with whole_file(path) as partial:
        np.savetxt(partial, rows, fmt="%.9f")


def read_tum(path: Path) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Times [s], rising, and poses x [m], y [m], yaw [rad].

    Raises:
        FileError: If the file is damaged, or no such trajectory.
    """
    remedy = "Give lines of: timestamp x y z qx qy qz qw"
    with reading(path, "a trajectory", remedy) as file:
        lines = [line.split() for line in file.read().decode("utf-8-sig").splitlines()]
        rows = [row for row in lines if row and not row[0].startswith("#")]
        for number, row in enumerate(rows, 1):
            if len(row) != 8:
                raise ValueError(f"pose {number} has {len(row)} values, expected 8")
        values = np.array(rows, float).reshape(-1, 8)
        if not len(values):
            raise ValueError("there is no pose in it")
        if not (np.abs(values) <= _MOST).all():
            raise ValueError("a value is no number")
        if not (np.diff(values[:, 0]) > 0).all():
            raise ValueError("times do not rise")
        _, _, _, _, qx, qy, qz, qw = values.T
        yaw = np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy**2 + qz**2))
        return values[:, 0], np.column_stack([values[:, 1:3], yaw])
