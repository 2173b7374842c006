"""Received powers along a route, for finding their transmitters: a table with a row for each reading.

Columns beacon and power_dbm are required, and x_m and y_m or, with a log of the robot, time_s. Optional are heading_rad
and, for comparison, beacon_x_m and beacon_y_m. Readings of a beacon are in the order of time, or have time_s. An empty
power, or a number given for it, is a reading that was not received, and does not count.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.calibration.measured_powers import beacon_name, check_varying, number_of, warn_of_lowest
from robosim.logs.beam_times import OdometryTrack
from robosim.logs.log_mapping import LogConfig, make_log_plan, map_log
from robosim.logs.robot_log import RobotLog
from robosim.logs.trajectory_scores import alignment
from robosim.plans.floorplan import FloorPlan
from robosim.support.reading import reading
from robosim.support.text_in import csv_rows
from slam.poses import compose
from wireless.positioning.received_power import PowerReadings

logger = logging.getLogger(__name__)

_REMEDY = (
    "Give a CSV file with columns beacon,x_m,y_m,power_dbm (or time_s instead of x_m,y_m, with --map-from) and, if "
    "known, heading_rad: a row for each reading."
)
#: Fewest readings of a beacon.
_LEAST_READINGS = 10
_OPTIONAL = ("time_s", "x_m", "y_m", "heading_rad", "beacon_x_m", "beacon_y_m")


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerRoute:
    """Readings of beacons in the order of time; values of columns that are missing are NaN."""

    beacon: tuple[str, ...]
    """Name of the beacon of each reading."""
    time_s: Float[np.ndarray, " n"]
    """Times."""
    poses: Float[np.ndarray, "n 3"]
    """x [m], y [m], heading [rad] of the receiver."""
    power_dbm: Float[np.ndarray, " n"]
    """Powers."""
    true_xy: dict[str, Float[np.ndarray, "2"]]
    """True places of beacons [m], of those that are known."""

    @property
    def names(self) -> list[str]:
        """All beacons, in the order in which they are first received."""
        return list(dict.fromkeys(self.beacon))

    def readings(self, name: str, share: float = 1.0) -> PowerReadings:
        """Readings of a beacon in the first part of the route."""
        used = np.flatnonzero(np.array(self.beacon) == name)
        used = used[: round(share * len(used))]
        return PowerReadings(
            xy=self.poses[used, :2],
            heading_rad=self.poses[used, 2],
            power_dbm=self.power_dbm[used],
            count=np.ones(len(used)),
        )


def read_power_route(path: Path, *, needs_time: bool, not_received: float | None = None) -> PowerRoute:
    """Read powers along a route (.csv); times are required, or positions. `not_received` is no power.

    Raises:
        FileError: If the file is damaged, a column is missing, a value is not understood, a beacon has several places,
            or too few readings.
    """
    with reading(path, "powers along a route", _REMEDY) as file:
        needed = ("beacon", "power_dbm", *(("time_s",) if needs_time else ("x_m", "y_m")))
        rows, columns = csv_rows(file.read(), needed)
        beacons: list[str] = []
        values: list[list[float]] = []
        true_xy: dict[str, np.ndarray] = {}
        for line, row in rows:
            name = beacon_name(row, line)
            number = {
                column: number_of(row, column, line, not_received) if column in columns else np.nan
                for column in (*_OPTIONAL, "power_dbm")
            }
            at = np.array([number["beacon_x_m"], number["beacon_y_m"]])
            if np.isfinite(at).all() and (true_xy.setdefault(name, at) != at).any():
                raise ValueError(f"line {line}: beacon {name!r} has more than one place")
            if np.isfinite(number["power_dbm"]):
                beacons.append(name)
                values.append([number[key] for key in ("time_s", "x_m", "y_m", "heading_rad", "power_dbm")])
        for name in dict.fromkeys(beacons):
            if (count := beacons.count(name)) < _LEAST_READINGS:
                raise ValueError(f"beacon {name!r} has {count} readings, expected {_LEAST_READINGS} or more")
        if not beacons:
            raise ValueError("there is no reading in it")
        table = np.array(values)
        for name in dict.fromkeys(beacons):
            check_varying(name, table[np.array(beacons) == name, 4])
        warn_of_lowest(path, table[:, 4])
        order = np.argsort(table[:, 0], kind="stable")
        table, beacons = table[order], [beacons[i] for i in order]
        return PowerRoute(
            beacon=tuple(beacons),
            time_s=table[:, 0],
            poses=table[:, 1:4],
            power_dbm=table[:, 4],
            true_xy=true_xy,
        )


def _unit_of(log: RobotLog, powers: PowerRoute) -> str:
    """Advice on times of readings that fit those of a log in another unit; empty if none does."""
    for unit, per_s in (("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)):
        seconds = powers.time_s / per_s
        if ((seconds >= log.times[0]) & (seconds <= log.times[-1])).any():
            return f", in seconds: time_s of the readings is in {unit}"
    return ""


def map_route(
    log: RobotLog,
    powers: PowerRoute,
    watched: Callable[[range, str], Iterable[int]] = lambda numbers, _: numbers,
    config: LogConfig | None = None,
) -> tuple[FloorPlan, PowerRoute]:
    """Map a robot's log, and bring map and readings into one frame.

    Readings with positions place the map in their frame. Without positions they get the robot's by the map, and without
    headings its headings. Readings outside of the log's times do not count.

    Raises:
        ValueError: If none of the readings is made within the log's times.
    """
    within = np.flatnonzero((powers.time_s >= log.times[0]) & (powers.time_s <= log.times[-1]))
    if not len(within):
        raise ValueError(
            f"{log.file or log.name}: its times are {log.times[0]:.1f} s to {log.times[-1]:.1f} s, and those of the "
            f"readings {powers.time_s[0]:.1f} s to {powers.time_s[-1]:.1f} s. Give both by one "
            f"clock{_unit_of(log, powers)}."
        )
    if lost := len(powers.time_s) - len(within):
        logger.warning(f"{lost} readings outside of the log's times do not count")
    config = config or LogConfig()
    poses = map_log(log, config, watched=watched).poses
    used = replace(
        powers,
        beacon=tuple(powers.beacon[i] for i in within),
        time_s=powers.time_s[within],
        poses=powers.poses[within],
        power_dbm=powers.power_dbm[within],
    )
    at = OdometryTrack(times=log.times, poses=poses).at(used.time_s)
    if np.isfinite(used.poses[:, :2]).all():
        frame = alignment(at, used.poses)
        poses = np.array([compose(frame, pose) for pose in poses])
        at[:, 2] += frame[2]
        at[:, :2] = used.poses[:, :2]
    known = np.isfinite(used.poses[:, 2])
    at[known, 2] = used.poses[known, 2]
    return make_log_plan(log, poses, config.resolution_m, config.range_m), replace(used, poses=at)
