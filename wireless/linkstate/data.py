"""Links with known states, ready for training: all transmitters of the buildings in a folder.

Two kinds of folders are read. The public measurements (`wireless.formats.mmwrobotnav_measurements`) have heights of
peaks but no delays; a link without paths holds zeros there, which `make_tokens` takes as missing. Data sets of our own
(`wireless.formats.link_records`), known by their `manifest.json`, have delays but no peaks.
"""

import json
import os
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8

from robosim.support.reading import FileError, reading, shown
from wireless.estimates import measured
from wireless.formats.link_records import LinkRecords
from wireless.formats.link_records import read_links as read_records
from wireless.formats.mmwrobotnav_measurements import Measurements, find_measurements, read_measurements
from wireless.linkstate.tokens import COLUMNS, make_tokens

_MOST_MANIFEST = 500_000_000
#: Columns that tables of several transmitters have in common.
_COLUMNS = ("tokens", "state", "position", "tx_position")


@dataclass(frozen=True, kw_only=True, eq=False)
class Links:
    """Links with known states."""

    tokens: Float32[np.ndarray, "n 5 5"]
    """Estimated paths from `make_tokens`."""
    state: UInt8[np.ndarray, " n"]
    """True `wireless.paths.LinkState`."""
    building: Int[np.ndarray, " n"]
    """Building of each link, as a number into the names."""
    transmitter: Int[np.ndarray, " n"]
    """Number of the transmitter of each link, different between buildings."""
    position: Float32[np.ndarray, "n 2"]
    """Where the receiver of each link is [m]."""
    tx_position: Float32[np.ndarray, "n 2"]
    """Where its transmitter is [m]."""
    names: tuple[str, ...]
    """Names of the buildings, sorted."""

    def __getitem__(self, rows: Bool[np.ndarray, " n"] | slice) -> "Links":
        """Return the links of a mask or slice."""
        return Links(
            **{name: values if name == "names" else values[rows] for name, values in vars(self).items()}
        )

    @property
    def measured(self) -> tuple[str, ...]:
        """Columns of tokens that this data has."""
        return tuple(name for i, name in enumerate(COLUMNS) if np.isfinite(self.tokens[:, 0, i]).any())

    def within(self, buildings: tuple[int, ...]) -> Bool[np.ndarray, " n"]:
        """Which links are in some buildings."""
        return np.isin(self.building, buildings)


class LinkTable(NamedTuple):
    """Links of one transmitter that are read when they are needed."""

    building: str
    """Name of the building."""
    rows: int
    """Number of links."""
    file: Path
    """File of a data set, or folder of public measurements."""
    number: int | None = None
    """Number of the transmitter in public measurements."""

    def read(self, rows: range) -> Links:
        """Read the links of some rows; FileError if the file is damaged, or is not as the manifest says."""
        if self.number is not None:
            return _measured(self.file, self.building, self.number)[slice(rows.start, rows.stop)]
        links = _recorded(self.file, rows)
        if links.names != (self.building,):
            raise FileError(
                f"{shown(self.file)}: links of {links.names[0]!r}, but manifest.json lists {self.building!r}. Make the "
                "data set again."
            )
        return links


def link_tables(data: Path) -> list[LinkTable]:
    """Tables of a data set by its manifest, or of a folder of public measurements, which are read to be counted.

    Raises:
        ValueError: If a file is missing or damaged.
    """
    if not is_data_set(data):
        return [
            LinkTable(name, len(_measured(data, name, number).state), data, number)
            for name, number in find_measurements(data)
        ]
    with _manifest(data) as file:
        units = _units(data, file)
        if wrong := [unit for unit in units if not (isinstance(unit["rows"], int) and unit["rows"] > 0)]:
            raise ValueError(f"rows of {wrong[0]['file']} is {wrong[0]['rows']!r}, expected 1 or more")
        return [LinkTable(str(unit["plan"]), unit["rows"], data / unit["file"]) for unit in units]


def read_links(data: Path) -> Links:
    """All links of a folder of public measurements, or of a data set.

    Raises:
        ValueError: If a file is missing or damaged.
    """
    if is_data_set(data):
        with _manifest(data) as file:
            files = [data / unit["file"] for unit in _units(data, file)]
        units = [_recorded(path) for path in files]
    else:
        units = [_measured(data, name, number) for name, number in find_measurements(data)]
    names, count = tuple(sorted({unit.names[0] for unit in units})), [len(unit.tokens) for unit in units]
    return Links(
        **{name: np.concatenate([getattr(unit, name) for unit in units]) for name in _COLUMNS},
        building=np.repeat([names.index(unit.names[0]) for unit in units], count),
        transmitter=np.repeat(np.arange(len(units)), count),
        names=names,
    )


def is_data_set(data: Path) -> bool:
    """Whether a folder is a data set of our own."""
    # A folder that cannot be read is reported, rather than passed over.
    return os.path.lexists(data / "manifest.json")


def carrier_hz(data: Path) -> float | None:
    """Carrier frequency of the links of a folder; None if its manifest does not name it, FileError if it is damaged."""
    if not is_data_set(data):
        return 28e9  # of all public measurements
    with _manifest(data) as file:
        frequency_hz = json.loads(file.read()).get("config", {}).get("radio", {}).get("frequency_hz")
        if frequency_hz is not None and not 0 < float(frequency_hz) < np.inf:
            raise ValueError(f"frequency_hz is {frequency_hz}, expected more than 0")
        return None if frequency_hz is None else float(frequency_hz)


def _manifest(data: Path) -> AbstractContextManager[BinaryIO]:
    path, what = data / "manifest.json", "the manifest of a data set of links"
    return reading(path, what, "Make it again.", most_bytes=_MOST_MANIFEST)


def _units(data: Path, file: BinaryIO) -> list[dict[str, Any]]:
    """Units of a manifest, whose tables exist."""
    units: list[dict[str, Any]] = json.loads(file.read())["units"]
    if not units:
        raise ValueError("it lists no links")
    if missing := [unit["file"] for unit in units if not (data / unit["file"]).is_file()]:
        raise ValueError(f"it lists {Path(missing[0]).name}, which is not there")
    return units


def _measured(data: Path, name: str, number: int) -> Links:
    links = read_measurements(data, name, number)
    return _unit(
        links, make_tokens(links.aoa_az, links.snr_db, aod_rad=links.aod_az, peak=links.peak_fraction)
    )


def _recorded(file: Path, rows: range | None = None) -> Links:
    links = read_records(file, rows)
    paths = links.estimates
    resolved = measured(aod_rad=paths.aod_rad, delay_s=paths.delay_s)
    return _unit(links, make_tokens(paths.aoa_rad, paths.snr_db, **resolved))


def _unit(links: LinkRecords | Measurements, tokens: Float32[np.ndarray, "n 5 5"]) -> Links:
    """Links of one transmitter."""
    name = links.plan if isinstance(links, LinkRecords) else links.building
    return Links(
        tokens=tokens,
        state=links.state,
        building=np.zeros(len(tokens), int),
        transmitter=np.zeros(len(tokens), int),
        position=links.rx_position[:, :2].astype(np.float32),
        tx_position=np.tile(links.tx_position[:2].astype(np.float32), (len(tokens), 1)),
        names=(name,),
    )
