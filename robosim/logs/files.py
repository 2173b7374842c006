"""Logs of every format that is known."""

from pathlib import Path

from robosim.logs.carmen import read_carmen
from robosim.logs.robot_log import RobotLog
from robosim.logs.tum_log import read_tum_log, with_reference


def read_log(path: Path, scans: Path | None = None, reference: Path | None = None) -> RobotLog:
    """Read a log.

    Args:
        path: A CARMEN log, packed by gzip or not; or odometry as a TUM file, which needs `scans`.
        scans: Scans beside a TUM file: a line each of time [s], first and last bearing [rad], and ranges [m].
        reference: Poses to compare with, as a TUM file; instead of those in the log.

    Raises:
        FileError: If a file is damaged, or none of these.
        ValueError: If scans are missing or too many.
    """
    if path.suffix in (".tum", ".txt"):
        if scans is None:
            raise ValueError(f"{path} is a trajectory: give the scans that were made on it by --scans.")
        log = read_tum_log(path, scans)
    elif scans is not None:
        raise ValueError(f"scans is {str(scans)!r}, but {path} has its own. Leave --scans away.")
    else:
        log = read_carmen(path)
    return log if reference is None else with_reference(log, reference)
