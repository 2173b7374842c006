"""CARMEN logs: lines of odometry and of laser scans, as most public logs of 2D lasers are written.

    ODOM x y theta tv rv accel ...
    FLASER n r1 ... rn x y theta odom_x odom_y odom_theta ...
    ROBOTLASER1 type start fov step range accuracy mode n r1 ... rn m r1 ... rm x y theta odom_x odom_y odom_theta ...

Of FLASER the beams begin at -90 degrees, 1 or 1/2 degree apart. If the first pose of a scan drifts away from the
second, it is a reference and the second is odometry; if their distance is constant, the first is the laser on the
robot.

A log that a mapping program has written has both poses corrected, and resets odometry to them after each scan. There
the displacement is that of the ODOM lines from one scan's corrected pose to the next, and that pose is the reference.
If odometry was reset in between, the displacement is unknown. In other logs ODOM lines are odometry at times of their
own, which corrects scans of lidars that turn. A last line that was cut off is left out.
Reference: the CARMEN robot navigation toolkit, Montemerlo et al., IROS 2003.
"""

import gzip
import io
import logging
import math
import re
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.logs.beam_times import OdometryTrack
from robosim.logs.no_returns import without_longest
from robosim.logs.robot_log import BagTopics, LogReader, RobotLog, check_bearings
from robosim.support.reading import reading
from robosim.support.text_in import line_numbers
from slam.poses import between, compose, wrap

logger = logging.getLogger(__name__)

#: Largest log, unpacked [bytes], and most beams of a scan.
_MOST_BYTES, _MOST_BEAMS = 500_000_000, 10_000
#: Numbers of beams of a SICK laser, which FLASER lines are of, in half a turn at 1 or 1/2 degree.
_FLASER_BEAMS = (180, 181, 360, 361)
#: Ranges from here on hit nothing [m]. Nearer than this is the robot itself.
_FARTHEST_M, _NEAREST_M = 79.0, 0.05
#: Coordinates are no larger [m, rad].
_FARTHEST = 1e6
#: Odometry that goes farther from one line to the next was reset [m]. A robot drives a metre or two a second.
_RESET_M = 5.0
#: With a larger part of times that do not rise from scan to scan, scans are counted instead.
_OUT_OF_ORDER = 0.1
#: Scans that follow each other faster are matched without odometry if its pose never changes [s].
_OFTEN_S = 0.6
#: A pose that stays within this of another does not drift away from it [m, rad].
_RIGID = 0.02


class _Scan(NamedTuple):
    """A line with a laser scan."""

    line: int
    bearings: Float[np.ndarray, " w"]
    ranges: Float[np.ndarray, " w"]
    laser: Float[np.ndarray, "3"]
    robot: Float[np.ndarray, "3"]
    time: float
    displacement: Float[np.ndarray, "3"] = np.zeros(3)
    """Displacement by ODOM lines since the scan before."""
    n_odometry: int = 0
    """Number of these lines."""


class CarmenReader(LogReader):
    """Reads CARMEN logs; any text may be one."""

    def matches(self, path: Path) -> bool:
        """Always true: this reader is the last one."""
        return True

    def read(self, path: Path, scans: Path | None, topics: BagTopics) -> RobotLog:
        """Read a CARMEN log; see `read_carmen`."""
        return read_carmen(path)


def read_carmen(path: Path) -> RobotLog:
    """Read a CARMEN log, packed by gzip or not; FileError if it is damaged, or has no two scans."""
    remedy = (
        "Give a CARMEN log with FLASER or ROBOTLASER1 lines, or a bag. `robosim replay` plays an episode, "
        "`robosim plan` reads a map."
    )
    with reading(path, "a robot's log", remedy) as file:
        packed = file.read()
        if packed[:2] == b"\x1f\x8b":
            with gzip.GzipFile(fileobj=io.BytesIO(packed)) as unpacked:
                packed = unpacked.read(_MOST_BYTES + 1)
            if len(packed) > _MOST_BYTES:
                raise ValueError(f"it unpacks to more than {_MOST_BYTES} bytes")
        scans, readings, resets = _parse(packed.decode("ascii", "replace"))
        if len(scans) < 2:
            raise ValueError(f"{len(scans)} scans in it, expected two at least")
        if (n := len(scans[0].ranges)) not in _FLASER_BEAMS and re.search(rb"^FLASER", packed, re.MULTILINE):
            logger.warning(
                f"{path}: FLASER lines state no angles, and those of {n} beams count as over 180 degrees. If the laser "
                "sees another angle, give ROBOTLASER1 lines."
            )
        return _log(path, scans, readings, resets)


def _parse(text: str) -> tuple[list[_Scan], list[Float[np.ndarray, "4"]], int]:
    """Scans in their order, times and poses of ODOM lines, and the number of resets of odometry to a scan's pose."""
    scans, readings, resets, rows = list[_Scan](), list[np.ndarray](), 0, text.splitlines()
    last: Float[np.ndarray, 3] | None = None
    step, n_odometry, is_fresh = np.zeros(3), 0, False
    for number, line in enumerate(rows, 1):
        words = line.split()
        kind = words[0] if words else ""
        try:
            if kind == "ODOM":
                pose = _numbers(words[1:4], 3, number)
                readings.append(np.array([_time(words[7:8]), *pose]))
            elif kind in ("FLASER", "ROBOTLASER1"):
                scan = _flaser(words, number) if kind == "FLASER" else _robotlaser(words, number)
        except ValueError:
            if number == len(rows) and not text.endswith("\n"):
                break  # a recording may be cut off anywhere
            raise
        if kind == "ODOM":
            if is_fresh and np.array_equal(pose, scans[-1].robot):
                resets += 1
            elif last is not None and not np.array_equal(pose, last) and not _was_reset(last, pose):
                step, n_odometry = compose(step, between(last, pose)), n_odometry + 1
            last, is_fresh = pose, False
        elif kind in ("FLASER", "ROBOTLASER1"):
            scans.append(scan._replace(displacement=step, n_odometry=n_odometry))
            last, step, n_odometry, is_fresh = scan.robot, np.zeros(3), 0, True
    return scans, readings, resets


def _was_reset(before: Float[np.ndarray, "3"], after: Float[np.ndarray, "3"]) -> bool:
    return math.hypot(after[0] - before[0], after[1] - before[1]) > _RESET_M


def _flaser(words: list[str], line: int) -> _Scan:
    count = _count(words[1:2], line)
    ranges = _numbers(words[2 : 2 + count], count, line)
    poses = _numbers(words[2 + count : 8 + count], 6, line)
    step = math.pi / (count - 1 if count % 2 else count)
    bearings, time = -math.pi / 2 + step * np.arange(count), _time(words[8 + count :])
    return _Scan(line, bearings, ranges, poses[:3], poses[3:], time)


def _robotlaser(words: list[str], line: int) -> _Scan:
    start, _, step, longest = _numbers(words[2:6], 4, line)
    count = _count(words[8:9], line)
    if not (abs(start) < 7 and 0 < step * (count - 1) < 6.6):
        raise ValueError(f"line {line} has {step:g} rad between beams, {count} from {start:g} rad on")
    ranges = _numbers(words[9 : 9 + count], count, line)
    remissions = _count(words[9 + count : 10 + count], line, least=0)
    rest = words[10 + count + remissions :]
    poses = _numbers(rest[:6], 6, line)
    ranges = np.where(ranges >= longest, np.inf, ranges)
    return _Scan(line, start + step * np.arange(count), ranges, poses[:3], poses[3:], _time(rest[11:]))


def _numbers(words: list[str], count: int, line: int) -> Float[np.ndarray, " n"]:
    values = np.array(line_numbers(words, line))
    if len(values) != count or not (np.abs(values) <= _FARTHEST).all():
        raise ValueError(f"line {line} breaks off, or has a value that is none of a robot's")
    return values


def _count(words: list[str], line: int, least: int = 3) -> int:
    if not words or not words[0].isdigit() or not least <= int(words[0]) <= _MOST_BEAMS:
        word = words[0] if words else "nothing"
        raise ValueError(f"line {line} has {word} for a number of beams, expected {least} to {_MOST_BEAMS}")
    return int(words[0])


def _time(words: list[str]) -> float:
    try:
        value = float(words[0])
    except (IndexError, ValueError):
        return math.nan
    return value if abs(value) < 1e12 else math.nan


def _log(path: Path, scans: list[_Scan], readings: list[Float[np.ndarray, "4"]], resets: int) -> RobotLog:
    count = len(scans[0].ranges)
    for scan in scans:
        if (n_beams := len(scan.ranges)) != count:
            raise ValueError(
                f"line {scan.line} has another number of beams than others: {n_beams}, not {count}"
            )
    check_bearings([scan.line for scan in scans], [scan.bearings for scan in scans])
    ranges, laser, robot = (np.array([scan[k] for scan in scans]) for k in (2, 3, 4))
    ranges = np.where(ranges >= _FARTHEST_M, np.inf, np.where(ranges > _NEAREST_M, ranges, np.nan))
    ranges = without_longest(path, ranges)
    reference: Float[np.ndarray, "n 3"] | None
    times, is_counted = _rising(path, np.array([scan.time for scan in scans]))
    track_of_odometry = None
    if resets > 0.5 * len(laser):
        displacement, reference = np.array([scan.displacement for scan in scans]), laser
        known = np.array([scan.n_odometry > 0 for scan in scans])
    else:
        apart = np.array([between(b, a) for a, b in zip(laser, robot, strict=True)])
        drifts = _spread(apart) > _RIGID
        track = robot if drifts else laser
        steps = [between(a, b) for a, b in pairwise(track)]
        displacement = np.array([np.zeros(3), *steps])
        known = np.array([True, *(not _was_reset(a, b) for a, b in pairwise(track))])
        displacement[~known] = 0.0
        # A pose that never changes was not filled in.
        if _spread(track) == 0 and not is_counted and np.median(np.diff(times)) < _OFTEN_S:
            known[1:] = False
        elif not is_counted and readings:
            offset = np.zeros(3) if drifts else between(robot[0], laser[0])
            track_of_odometry = _track(times, track, np.array(readings), offset)
        reference = laser if drifts and _spread(laser) > 0 else None
    displacement[0] = 0.0
    name = path.name.removesuffix(".gz").removesuffix(".log").removesuffix(".clf")
    return RobotLog(
        name=name,
        file=path,
        bearing_rad=scans[0].bearings,
        range_m=ranges,
        displacement=displacement,
        known=known,
        times=times,
        is_counted=is_counted,
        track=track_of_odometry,
        reference=reference,
    )


def _track(
    times: Float[np.ndarray, " n"],
    poses: Float[np.ndarray, "n 3"],
    readings: Float[np.ndarray, "m 4"],
    offset: Float[np.ndarray, "3"],
) -> OdometryTrack | None:
    """Odometry of scans and of ODOM lines, whose poses lack an offset; None if few of the lines have rising times."""
    own_s = readings[:, 0]
    before = np.maximum.accumulate(np.append(-np.inf, np.nan_to_num(own_s, nan=-np.inf)))[:-1]
    good = readings[own_s > before]
    if len(good) < (1 - _OUT_OF_ORDER) * len(readings):
        return None
    every = np.concatenate(
        [np.column_stack([times, poses]), [[row[0], *compose(row[1:], offset)] for row in good]]
    )
    every = every[np.unique(every[:, 0], return_index=True)[1]]
    known = np.array([True, *(not _was_reset(a[1:], b[1:]) for a, b in pairwise(every))])
    return OdometryTrack(times=every[:, 0], poses=every[:, 1:], known=known)


def _rising(path: Path, times: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], bool]:
    """Rising times: the log's, with those that repeat or go back put after the one before; else scans' numbers.

    Returns:
        The times [s], and whether they are the numbers.
    """
    late = np.diff(times) <= 0
    if np.isnan(times).all():
        return np.arange(len(times), dtype=float), True
    rising, late_scans = times.copy(), np.flatnonzero(np.maximum.accumulate(times)[:-1] >= times[1:]) + 1
    for k in late_scans:
        rising[k] = rising[k - 1] + 1e-6
    if late.mean() > _OUT_OF_ORDER or not (np.diff(rising) > 0).all():
        return np.arange(len(times), dtype=float), True
    if len(late_scans):
        logger.warning(
            f"{path}: {len(late_scans)} times repeat or go back, and are put after the one before."
        )
    return rising, False


def _spread(poses: Float[np.ndarray, "n 3"]) -> float:
    away = poses - poses[0]
    away[:, 2] = [wrap(float(turn)) for turn in away[:, 2]]
    return float(np.abs(away).max())
