"""Reading logs of all supported formats."""

from pathlib import Path

from robosim.logs.carmen import read_carmen
from robosim.logs.robot_log import RobotLog
from robosim.logs.tum_log import read_tum_log, with_reference
from robosim.support.reading import FileError, reading

#: First bytes of recordings that are not supported, and their names.
_RECORDINGS = {b"#ROSBAG": "a ROS 1 bag", b"\x89MCAP": "an MCAP recording", b"SQLite format 3": "a ROS 2 bag"}


def read_log(path: Path, scans: Path | None = None, reference: Path | None = None) -> RobotLog:
    """Read a CARMEN log, packed by gzip or not, or odometry as a TUM file with scans.

    Each line of `scans` has time [s], first and last bearing [rad], and ranges [m]. A TUM file of reference poses
    replaces those of the log.

    Raises:
        FileError: If a file is damaged, or none of these.
        ValueError: If scans are missing or too many.
    """
    for file in (path, scans, reference):
        if file is not None:
            _check_kind(file)
    if path.suffix in (".tum", ".txt"):
        if scans is None:
            raise ValueError(f"{path} is a trajectory: give the scans that were made on it by --scans.")
        log = read_tum_log(path, scans)
    elif scans is not None:
        raise ValueError(f"scans is {str(scans)!r}, but {path} has its own. Leave --scans away.")
    else:
        log = read_carmen(path)
    return log if reference is None else with_reference(log, reference)


def _check_kind(path: Path) -> None:
    """Reject recordings that are not supported, however large they are."""
    with reading(path, "a robot's log", most_bytes=1 << 50) as file:
        head = file.read(16)
        for magic, kind in _RECORDINGS.items():
            if head.startswith(magic):
                raise FileError(
                    f"is {kind}, which is not supported yet. Convert its odometry to a TUM trajectory (evo_traj can) "
                    "and its scans to lines of time, first and last bearing, ranges (--scans); or all to a CARMEN log."
                )
