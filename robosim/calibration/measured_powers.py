"""Received powers of beacons, measured at places in a real building: a table with a row for each reading.

Columns beacon, beacon_x_m, beacon_y_m, beacon_z_m, x_m, y_m and power_dbm are required, z_m and heading_rad are
optional, and others are ignored. Positions are in the frame of the plan. An empty power or nan is a reading that was
not received, and so is a row that is missing. Receivers that write a number instead, such as 100, 0, -127 or 127, are
read with that number as an option only: powers are more than -127 dBm and less than 0. Powers of a beacon at the same
place and heading are averaged.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from robosim.plans.floorplan import FloorPlan
from robosim.support.reading import reading
from robosim.support.text_in import csv_number, csv_rows

logger = logging.getLogger(__name__)

#: Columns that are required; power_dbm, which tables of paths lack, marks a table of powers.
COLUMNS = ("beacon", "beacon_x_m", "beacon_y_m", "beacon_z_m", "x_m", "y_m", "power_dbm")
_REMEDY = f"Give a CSV file with columns {','.join(COLUMNS)} and, if known, z_m,heading_rad: a row for each reading."
#: Positions are no larger [m], nor times [s].
_MOST, _MOST_S = 1e5, 1e11
#: Received powers are between these, which are not among them [dBm].
_POWERS_DBM = (-127.0, 0.0)
#: Beacons hang on walls, and plans may end at the inner face of these [m].
_MARGIN_M = 1.0
#: Side of the squares of floor that alternately belong to the fit and are held out [m].
BLOCK_M = 1.0
#: A lowest power that is often there, so far below the others, may mean that nothing was received [dB].
_GAP_DB = 10.0
#: Fewest readings of a beacon in either half.
_LEAST_READINGS = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredPowers:
    """Beacons, the places of a receiver, and what it received."""

    names: tuple[str, ...]
    """Names of the beacons."""
    beacons: Float[np.ndarray, "b 3"]
    """Their positions [m]."""
    places: Float[np.ndarray, "n 3"]
    """Positions of the receiver [m]."""
    heading_rad: Float[np.ndarray, " n"] | None
    """Headings of the receiver; None if unknown."""
    power_dbm: Float[np.ndarray, "b n"]
    """Powers; NaN where none was received."""

    @property
    def held_out(self) -> Bool[np.ndarray, " n"]:
        """Places that are not for the fit: in every other square of a checkerboard of `BLOCK_M`."""
        return np.floor(self.places[:, :2] / BLOCK_M).sum(axis=1) % 2 == 1


def is_table_of_powers(path: Path) -> bool:
    """Whether a file has the column that tables of powers have, and tables of paths lack."""
    with reading(path, "a table of measurements") as file:
        return "power_dbm" in file.readline(10_000).decode("utf-8-sig", "replace").strip().split(",")


def read_measured_powers(path: Path, height_m: float, not_received: float | None = None) -> MeasuredPowers:
    """Read a table of received powers (.csv); places without z_m are at a height, `not_received` is no power.

    Raises:
        FileError: If the file is damaged, a column is missing, a value is not understood, a beacon has several
            positions, or too few readings are in either half of the floor.
    """
    with reading(path, "a table of received powers", _REMEDY) as file:
        rows, columns = csv_rows(file.read(), COLUMNS)
        optional = [name for name in ("z_m", "heading_rad") if name in columns]
        beacons: dict[str, tuple[float, ...]] = {}
        readings: dict[tuple[float, ...], dict[str, list[float]]] = {}
        for line, row in rows:
            name = beacon_name(row, line)
            values = {
                column: number_of(row, column, line, not_received) for column in (*COLUMNS[1:], *optional)
            }
            at = values["beacon_x_m"], values["beacon_y_m"], values["beacon_z_m"]
            if beacons.setdefault(name, at) != at:
                raise ValueError(f"line {line}: beacon {name!r} is at {at}, and at {beacons[name]} before")
            place = values["x_m"], values["y_m"], values.get("z_m", height_m), values.get("heading_rad", 0.0)
            received = readings.setdefault(place, {}).setdefault(name, [])
            if not np.isnan(values["power_dbm"]):
                received.append(values["power_dbm"])
        if not readings:
            raise ValueError("there is no reading in it")
        places = np.array(list(readings))
        measured = MeasuredPowers(
            names=tuple(beacons),
            beacons=np.array(list(beacons.values())),
            places=places[:, :3],
            heading_rad=places[:, 3] if "heading_rad" in columns else None,
            power_dbm=np.array(
                [[np.mean(of.get(name) or [np.nan]) for of in readings.values()] for name in beacons]
            ),
        )
        for name, power in zip(measured.names, measured.power_dbm, strict=True):
            received = ~np.isnan(power)
            for half, mask in (("fitted", ~measured.held_out), ("held-out", measured.held_out)):
                if (count := (received & mask).sum()) < _LEAST_READINGS:
                    raise ValueError(
                        f"beacon {name!r} has {count} readings in the {half} squares of {BLOCK_M:g} m, "
                        f"expected {_LEAST_READINGS} or more"
                    )
            check_varying(name, power[received])
        warn_of_lowest(path, measured.power_dbm[~np.isnan(measured.power_dbm)])
        return measured


def check_varying(name: str, power_dbm: Float[np.ndarray, " n"]) -> None:
    """Raise ValueError for powers of a beacon [dBm] that are all the same, as no receiver measures them."""
    if np.ptp(power_dbm) == 0:
        raise ValueError(f"all {len(power_dbm)} powers of beacon {name!r} are {power_dbm[0]:g} dBm")


def warn_of_lowest(path: Path, power_dbm: Float[np.ndarray, " n"]) -> None:
    """Warn of a lowest power [dBm] that is often there, far below the others."""
    lowest, is_lowest = power_dbm.min(), power_dbm == power_dbm.min()
    if 0.05 < is_lowest.mean() < 1 and power_dbm[~is_lowest].min() > lowest + _GAP_DB:
        logger.warning(
            f"{path}: {100 * is_lowest.mean():.0f} % of power_dbm are {lowest:g}, far below the others. If it means "
            f"that nothing was received, give --not-received {lowest:g}"
        )


def check_on_plan(plan: FloorPlan, beacons: Mapping[str, Float[np.ndarray, " d"]]) -> None:
    """Raise ValueError for a beacon outside of a plan and a margin of `_MARGIN_M`."""
    low = np.array(plan.origin[:2])
    high = low + np.array(plan.shape[::-1]) * plan.resolution_m
    for name, (x, y, *_) in beacons.items():
        cell = plan.to_cells(np.array([[x, y]]))[0] * plan.resolution_m
        if not ((cell >= -_MARGIN_M) & (cell <= high - low + _MARGIN_M)).all():
            raise ValueError(
                f"beacon {name!r} is at ({x:g}, {y:g}) m, outside of the plan of {high[0] - low[0]:.1f} m x "
                f"{high[1] - low[1]:.1f} m at ({low[0]:g}, {low[1]:g}) m. Give plan and table in one frame, in metres"
            )


def beacon_name(row: dict[str, str], line: int) -> str:
    """The name of the beacon of a row; ValueError if it is empty."""
    if not (name := (row["beacon"] or "").strip()):
        raise ValueError(f"line {line}: beacon is empty, expected a name or number")
    return name


def number_of(row: dict[str, str], column: str, line: int, not_received: float | None = None) -> float:
    """A number of a row; ValueError if it is none. Only powers may be empty, or `not_received`, which is NaN."""
    if column == "power_dbm":
        if (row[column] or "").strip().lower() in ("", "nan"):
            return np.nan
        power_dbm = csv_number(row, column, line, -np.inf, np.inf)
        if power_dbm == not_received:
            return np.nan
        if not _POWERS_DBM[0] < power_dbm < _POWERS_DBM[1]:
            raise ValueError(
                f"line {line}: {column} is {power_dbm:g}, expected between {_POWERS_DBM[0]:g} and {_POWERS_DBM[1]:g} "
                f"dBm: if it means that nothing was received, leave it empty, or give --not-received {power_dbm:g}"
            )
        return power_dbm
    bound = _MOST_S if column == "time_s" else _MOST
    if column == "time_s" and abs(csv_number(row, column, line, -np.inf, np.inf)) > bound:
        raise ValueError(
            f"line {line}: {column} is {row[column].strip()}, expected seconds: divide milliseconds by 1e3, "
            "nanoseconds by 1e9"
        )
    return csv_number(row, column, line, -bound, bound)
