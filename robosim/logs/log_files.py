"""Logs of robots of any format, odometry as a TUM file with scans in another file, and reference trajectories."""

import logging
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.logs.bag import is_bag
from robosim.logs.beam_times import OdometryTrack
from robosim.logs.no_returns import without_longest
from robosim.logs.robot_log import (
    BagTopics,
    LogReader,
    RobotLog,
    check_bearings,
    report_track,
    with_beam_times,
)
from robosim.parts import LOG_READER
from robosim.support.parts import Part
from robosim.support.reading import FileError, reading
from robosim.support.text_in import check_rising, number_rows
from robosim.support.tum import read_tum

logger = logging.getLogger(__name__)

#: Content that shows what a file is [bytes].
_HEAD_BYTES = 4096
#: Scans outside of the trajectory's time by more than this have no pose [s].
_OUTSIDE_S = 0.5


def read_tum_log(path: Path, scans: Path) -> RobotLog:
    """A log of odometry (TUM) and scans; FileError if a file is damaged, or they have no time in common."""
    times, bearing, ranges = _read_scans(scans)
    track = _read_track(path, times)
    report_track(path, track)
    steps, known = track.steps(times)
    return RobotLog(
        name=path.stem,
        file=path,
        bearing_rad=bearing,
        range_m=ranges,
        displacement=steps,
        known=known,
        times=times,
        track=track,
    )


def with_reference(log: RobotLog, path: Path) -> RobotLog:
    """The log with poses of a TUM file to compare with; FileError if that is damaged, or of another time."""
    track = _read_track(path, log.times)
    report_track(
        path,
        track,
        "the reference is interpolated there, so that errors against it are wrong; cut the log there",
    )
    return replace(log, reference=track.at(log.times))


def _read_track(path: Path, times: Float[np.ndarray, " n"]) -> OdometryTrack:
    """A trajectory that has poses at some times."""
    known, poses = read_tum(path)
    with reading(path, "a trajectory", "Give one of the time of the scans"):
        if times[0] < known[0] - _OUTSIDE_S or times[-1] > known[-1] + _OUTSIDE_S:
            raise ValueError(
                f"it lasts from {known[0]:.3f} to {known[-1]:.3f} s, and the scans from {times[0]:.3f} to "
                f"{times[-1]:.3f} s"
            )
    return OdometryTrack(times=known, poses=poses)


def _read_scans(
    path: Path,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " w"], Float[np.ndarray, "n w"]]:
    remedy = "Give a line a scan: time [s], first and last bearing [rad], ranges [m]"
    with reading(path, "a table of scans", remedy) as file:
        lines, rows = number_rows(file.read())
        if len(rows) < 2:
            raise ValueError(f"{len(rows)} scans in it, expected two at least")
        for line, row in zip(lines, rows, strict=True):
            if len(row) != len(rows[0]) or len(row) < 6:
                raise ValueError(f"line {line} has {len(row) - 3} ranges, the first {len(rows[0]) - 3}")
        values = np.array(rows)
        times, (first, last) = values[:, 0], values[0, 1:3]
        check_rising(lines, times)
        if not -7 < first < last < min(first + 6.3, 7):
            raise ValueError(
                f"line {lines[0]} has bearings from {first:g} to {last:g}, expected rising ones in radians, of one "
                "turn at most"
            )
        check_bearings(lines, values[:, 1:3])
        ranges = np.where(values[:, 3:] > 0.05, values[:, 3:], np.nan)
        ranges = without_longest(path, np.where(ranges >= 1e3, np.inf, ranges))
        turn = 2 * np.pi if first < -np.pi - 1e-6 else 0.0
        return times, turn + np.linspace(first, last, ranges.shape[1]), ranges


class TumReader(LogReader):
    """Reads odometry as a TUM file, with scans in another file."""

    takes_scans = True

    def matches(self, path: Path) -> bool:
        """Whether a path is a trajectory, by its ending or its first line."""
        return path.suffix == ".tum" or _begins_with_numbers(path)

    def read(self, path: Path, scans: Path | None, topics: BagTopics) -> RobotLog:
        """Read odometry and scans; see `read_tum_log`."""
        if scans is None:
            raise ValueError(f"{path} is a trajectory: give the scans that were made on it by --scans.")
        return read_tum_log(path, scans)


def read_log(
    path: Path,
    scans: Path | None = None,
    reference: Path | None = None,
    beam_seconds: tuple[float, float] | None = None,
    topics: BagTopics | None = None,
    reader: Part = "auto",
    *,
    needs_times: bool = False,
) -> RobotLog:
    """Read a log of any format, such as a CARMEN log, odometry as a TUM file with scans, or a ROS bag.

    Each line of `scans` has time [s], first and last bearing [rad], and ranges [m]. A TUM file of reference poses
    replaces those of the log. `beam_seconds` are the times of the first and the last beam after that of the scan [s];
    None if all are measured at once. `reader` is one of `robosim.parts.LOG_READER`; "auto" takes the first that
    matches. `needs_times` rejects logs without.

    Raises:
        FileError: If a file is damaged, or none of these.
        ValueError: If scans are missing or too many, or have no such beams.
    """
    for file in (scans, reference):
        if file is not None and is_bag(file):
            raise FileError(f"{file}: is a bag, expected a table. Give the bag as the log.")
    readers = map(LOG_READER.make, LOG_READER.names)
    chosen: LogReader = (
        next(each for each in readers if each.matches(path))
        if reader == "auto"
        else LOG_READER.make(reader, field="reader")
    )
    if scans is not None and not chosen.takes_scans:
        raise FileError(f"{path}: is a log with scans, such as a bag. Leave --scans away.")
    unused = {} if reader != "auto" or is_bag(path) else asdict(topics or BagTopics())
    usual = asdict(BagTopics())
    for name, value in unused.items():
        if value != usual[name]:
            logger.warning(f"{path}: is no bag, and does not use --{name.replace('_', '-')} {value}.")
    log = chosen.read(path, scans, topics or BagTopics())
    if log.is_counted:
        problem = f"{path}: times of scans are missing or do not rise"
        if needs_times:
            raise FileError(f"{problem}, expected times of each scan. Give a log with times.")
        if beam_seconds is None:
            logger.warning(f"{problem}, so that scans are counted instead.")
    if beam_seconds is not None:
        log = with_beam_times(log, *beam_seconds)
    return log if reference is None else with_reference(log, reference)


def _begins_with_numbers(path: Path) -> bool:
    """Whether the first line with content holds numbers only, as of a trajectory; lines of CARMEN begin with a word."""
    with reading(path, "a robot's log", most_bytes=1 << 50) as file:
        head = file.read(_HEAD_BYTES).decode("utf-8-sig", "replace")
    lines = (line.replace(",", " ").split() for line in head.splitlines())
    first = next((words for words in lines if words and not words[0].startswith("#")), [])
    try:
        return len([float(word) for word in first]) > 0
    except ValueError:
        return False
