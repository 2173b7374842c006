"""Radio paths measured in a real hall, and which traced paths they are.

A table with a row for each path: place, tx_x_m, tx_y_m, tx_heading_rad, rx_x_m, rx_y_m, rx_heading_rad, range_m,
aod_rad, aoa_rad, and power_db if it is known; further columns are passed over. Directions are in the frame of each
end, powers relative to each other.
Data of that form: Kaltiokallio et al., Robust snapshot radio SLAM, 2024 (arXiv:2404.10291), at 60 GHz.

A measured path is explained by a traced one if delay and both azimuths agree and, if it is compared, strength. Each
traced path explains one measured path at most; of all pairings the one that explains most is taken, the closest of
these.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.constants import speed_of_light
from scipy.optimize import linear_sum_assignment

from robosim.support.checks import Range, checked
from robosim.support.reading import reading
from robosim.support.text_in import csv_number, csv_rows
from slam.poses import wrap
from wireless.paths import Interaction, Paths
from wireless.tracing.tracer import Tracer

#: Columns that have to be there.
COLUMNS = (
    "place",
    "tx_x_m",
    "tx_y_m",
    "tx_heading_rad",
    "rx_x_m",
    "rx_y_m",
    "rx_heading_rad",
    "range_m",
    "aod_rad",
    "aoa_rad",
)
#: Values are no larger [m, rad].
_MOST = 1e5
#: A range is no shorter than the straight line by more, with the errors of clocks and positions [m].
_SHORTER_M = 1.0


@dataclass(frozen=True, eq=False)
class MeasuredHall:
    """A transmitter and the places of a receiver."""

    table: Float[np.ndarray, "n columns"]
    """Rows of the table."""
    power_db: Float[np.ndarray, " n"] | None = None
    """Power of each path, up to an offset of all [dB]; None if it was not measured."""

    @property
    def transmitter(self) -> Float[np.ndarray, "3"]:
        """True pose of the transmitter: x [m], y [m], heading [rad]."""
        return self.table[0, 1:4]

    @property
    def receivers(self) -> Float[np.ndarray, "m 3"]:
        """True x [m], y [m] and heading [rad] at each place, in the order of its number."""
        return self.table[np.unique(self.table[:, 0], return_index=True)[1], 4:7]


def read_measured_paths(path: Path, turn_rad: float = 0.0) -> MeasuredHall:
    """Read a table of measured paths (.csv); the transmitter's heading is corrected by `turn_rad`.

    The authors of the public data turn it by -1.6 degrees.

    Raises:
        FileError: If the file is damaged, a column is missing, a value is no number, an end moves, or a range is
            shorter than the straight line.
    """
    remedy = f"Give a CSV file with columns {','.join(COLUMNS)}: a row for each path"
    with reading(path, "a table of measured paths", remedy) as file:
        lines, names = csv_rows(file.read(), COLUMNS)
        rows = list(lines)
        has_power = "power_db" in names
        columns = (*COLUMNS, "power_db") if has_power else COLUMNS
        table = np.array(
            [[csv_number(row, name, line, -_MOST, _MOST) for name in columns] for line, row in rows]
        )
        if not len(table):
            raise ValueError("there is no path in it")
        _, first_row, place = np.unique(table[:, 0], return_index=True, return_inverse=True)
        differs = table[:, 1:7] != np.column_stack(
            [table[[0] * len(table), 1:4], table[first_row[place], 4:7]]
        )
        if differs.any():
            k = int(differs.any(axis=1).argmax())
            raise ValueError(
                f"line {rows[k][0]}: {COLUMNS[1 + int(differs[k].argmax())]} is another than in earlier lines, "
                "expected one transmitter in a table, and one pose of the receiver at each place"
            )
        apart_m = np.hypot(*(table[:, 4:6] - table[:, 1:3]).T)
        if (shorter := table[:, 7] < apart_m - _SHORTER_M).any():
            first = int(shorter.argmax())
            raise ValueError(
                f"line {rows[first][0]}: range_m is {table[first, 7]:g}, but its ends are {apart_m[first]:.1f} m "
                f"apart, expected no path shorter than the straight line ({shorter.sum()} of {len(table)} are). Give "
                "the delay in seconds times 299792458, less the offset of the clocks"
            )
        table[:, 3] += turn_rad
        return MeasuredHall(table[:, : len(COLUMNS)], table[:, -1] if has_power else None)


@dataclass(frozen=True, kw_only=True)
@checked
class MatchConfig:
    """Tolerances between a measured and a traced path."""

    delay_ns: Annotated[float, Range(1e-3, 1e3, "ns")] = 1.0
    angle_deg: Annotated[float, Range(1e-3, 180, "degrees")] = 5.0
    height_m: Annotated[float, Range(0, 100, "m")] = 1.5
    """Height of both ends [m], which such tables do not have."""
    range_db: Annotated[float, Range(0, 300, "dB")] = 40.0
    """Traced paths weaker than the strongest of their place by more explain nothing [dB]."""
    strength_db: Annotated[float | None, Range(0.01, 300, "dB")] = None
    """Strengths, from those of direct paths, differ by no more than this [dB]; None for any strength."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Matched:
    """For each measured path, in the order of the table."""

    explained: Bool[np.ndarray, " n"]
    """Whether a traced path is the same."""
    traced_db: Float[np.ndarray, " n"]
    """Power gain of that path [dB]; NaN for none."""
    path: Int[np.ndarray, " n"]
    """Number of the matching traced path, -1 for none."""
    order: Int[np.ndarray, " n"]
    """Number of interactions of the matching path, -1 for none."""
    diffracted: Bool[np.ndarray, " n"]
    """Whether it met an edge."""
    by_chance: float
    """Share of the paths that would be explained by those traced to other places, mean over all other places."""


def trace_hall(hall: MeasuredHall, tracer: Tracer, height_m: float) -> Paths:
    """Paths from the transmitter to each place."""
    rx = np.column_stack([hall.receivers[:, :2], np.full(len(hall.receivers), height_m)])
    return tracer.trace(np.array([[*hall.transmitter[:2], height_m]]), rx)


def offset_db(hall: MeasuredHall, matched: Matched) -> float:
    """Measured strength over traced power of direct paths, median.

    Raises:
        ValueError: If powers were not measured, or no direct path is explained.
    """
    if hall.power_db is None:
        raise ValueError("the table has no column power_db, which the fit needs.")
    direct = matched.order == 0
    if not direct.any():
        raise ValueError("no direct path is explained: are plan and table in one frame, and the turn right?")
    return float(np.median((hall.power_db - matched.traced_db)[direct]))


def match(hall: MeasuredHall, paths: Paths, config: MatchConfig) -> Matched:
    """Pair measured paths with those of `trace_hall`; ValueError as in `offset_db` if strengths are compared."""
    table, strength = hall.table, np.zeros(len(hall.table))
    if config.strength_db is not None:
        from_db = offset_db(hall, match(hall, paths, replace(config, strength_db=None)))
        assert hall.power_db is not None  # or there is no offset
        strength = hall.power_db - from_db
    number, place_of = np.unique(table[:, 0], return_inverse=True)
    strongest = paths.strongest()
    most_db = np.full(len(number), -np.inf)
    most_db[strongest.rx] = strongest.power_db
    loud = paths.power_db >= most_db[paths.rx] - config.range_db
    length = paths.delay_s * speed_of_light
    matched_path = np.full(len(table), -1)
    by_chance = 0
    for here in range(len(number)):
        rows = np.flatnonzero(place_of == here)
        measured = np.column_stack(
            [table[rows, 7], table[rows, 3] + table[rows, 8], table[rows, 6] + table[rows, 9], strength[rows]]
        )
        for there in range(len(number)):
            candidates = np.flatnonzero(loud & (paths.rx == there))
            traced = np.column_stack(
                [
                    length[candidates],
                    paths.aod_az[candidates],
                    paths.aoa_az[candidates],
                    paths.power_db[candidates],
                ]
            )
            pairs = _pairs(measured, traced, config)
            if there != here:
                by_chance += len(pairs)
                continue
            matched_path[rows[pairs[:, 0]]] = candidates[pairs[:, 1]]
    explained = matched_path >= 0
    traced_db, order = np.full(len(table), np.nan), np.full(len(table), -1)
    traced_db[explained], order[explained] = (
        paths.power_db[matched_path[explained]],
        paths.order[matched_path[explained]],
    )
    diffracted = np.zeros(len(table), bool)
    diffracted[explained] = (paths.interaction[matched_path[explained]] == Interaction.DIFFRACTION).any(
        axis=1
    )
    return Matched(
        explained=explained,
        traced_db=traced_db,
        path=matched_path,
        order=order,
        diffracted=diffracted,
        by_chance=by_chance / max(1, len(table) * (len(number) - 1)),
    )


def _pairs(
    measured: Float[np.ndarray, "n 4"], traced: Float[np.ndarray, "m 4"], config: MatchConfig
) -> Int[np.ndarray, "k 2"]:
    """Indices of measured and traced paths (length [m], departure, arrival [rad], power [dB]) that are the same."""
    off = traced[None] - measured[:, None]
    off[..., 1:3] = wrap(off[..., 1:3])
    angle = np.radians(config.angle_deg)
    off /= [config.delay_ns * 1e-9 * speed_of_light, angle, angle, config.strength_db or np.inf]
    near = (np.abs(off) <= 1).all(axis=-1)
    cost = np.where(near, (off**2).sum(axis=-1), 1e3)  # one pair more is worth any distance
    pairs = np.column_stack(linear_sum_assignment(cost))
    return pairs[near[pairs[:, 0], pairs[:, 1]]]
