"""Radio paths measured in a real hall, with the places of both ends.

A table with a row for each path: place, tx_x_m, tx_y_m, tx_heading_rad, rx_x_m, rx_y_m, rx_heading_rad, range_m,
aod_rad, aoa_rad, and power_db if it is known; further columns are passed over. Directions are in the frame of each
end, powers relative to each other.
Data of that form: Kaltiokallio et al., Robust snapshot radio SLAM, 2024 (arXiv:2404.10291), at 60 GHz.
"""

import csv
import io
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.support.reading import reading
from wireless.positioning.single_bounce import MeasuredPaths

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


@dataclass(frozen=True, eq=False)
class MeasuredPlace:
    """What was measured at one place."""

    receiver: Float[np.ndarray, "3"]
    """Where the receiver truly was: x [m], y [m], heading [rad]."""
    seen_from_transmitter: MeasuredPaths
    """To look for the receiver, the transmitter known."""


@dataclass(frozen=True, eq=False)
class MeasuredHall:
    """A transmitter and the places of a receiver."""

    table: Float[np.ndarray, "n columns"]
    """Rows of the table."""
    power_db: Float[np.ndarray, " n"] | None = None
    """Power of each path, up to an offset of all [dB]; None if it was not measured."""

    @property
    def transmitter(self) -> Float[np.ndarray, "3"]:
        """Where the transmitter truly is: x [m], y [m], heading [rad]."""
        return self.table[0, 1:4]

    @cached_property
    def places(self) -> list[MeasuredPlace]:
        """The places, in the order of their numbers."""
        return [self._place(self.table[self.table[:, 0] == number]) for number in np.unique(self.table[:, 0])]

    @property
    def seen_from_receiver(self) -> MeasuredPaths:
        """All paths, to look for the transmitter, the receiver known."""
        rows = self.table
        return MeasuredPaths(
            known_xy=rows[:, 4:6], known_rad=rows[:, 6] + rows[:, 9], own_rad=rows[:, 8], length_m=rows[:, 7]
        )

    def _place(self, rows: Float[np.ndarray, "m columns"]) -> MeasuredPlace:
        seen = MeasuredPaths(
            known_xy=rows[:, 1:3], known_rad=rows[:, 3] + rows[:, 8], own_rad=rows[:, 9], length_m=rows[:, 7]
        )
        return MeasuredPlace(rows[0, 4:7], seen)


def read_measured_paths(path: Path, turn_rad: float = 0.0) -> MeasuredHall:
    """Read a table of measured paths (.csv); the transmitter's heading is corrected by `turn_rad`.

    The authors of the public data turn it by -1.6 degrees.

    Raises:
        FileError: If the file is damaged, a column is missing, or a value is no number.
    """
    remedy = f"Give a CSV file with columns {','.join(COLUMNS)}: a row for each path"
    with reading(path, "a table of measured paths", remedy) as file:
        rows = csv.DictReader(io.StringIO(file.read().decode("utf-8-sig")))
        has_power = "power_db" in (rows.fieldnames or ())
        if missing := [name for name in COLUMNS if name not in (rows.fieldnames or ())]:
            raise ValueError(f"column {missing[0]!r} is missing")
        columns = (*COLUMNS, "power_db") if has_power else COLUMNS
        table = np.array([[float(row[name]) for name in columns] for row in rows]).reshape(-1, len(columns))
        if not len(table):
            raise ValueError("there is no path in it")
        if not (np.abs(table) <= _MOST).all():
            raise ValueError("a value is no number, or too large")
        table[:, 3] += turn_rad
        return MeasuredHall(table[:, : len(COLUMNS)], table[:, -1] if has_power else None)
