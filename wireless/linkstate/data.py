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
from typing import BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8

from robosim.support.reading import reading
from wireless.estimates import measured
from wireless.formats.link_records import LinkRecords
from wireless.formats.link_records import read_links as read_records
from wireless.formats.mmwrobotnav_measurements import Measurements, find_measurements, read_measurements
from wireless.linkstate.tokens import COLUMNS, make_tokens

_MOST_MANIFEST = 50_000_000


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

    def __getitem__(self, rows: Bool[np.ndarray, " n"]) -> "Links":
        """Return the links of a mask."""
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


class _Unit(NamedTuple):
    """Links of one transmitter."""

    building: str
    tokens: Float32[np.ndarray, "n 5 5"]
    links: LinkRecords | Measurements


def read_links(data: Path) -> Links:
    """All links of a folder of public measurements, or of a data set.

    Raises:
        ValueError: If a file is missing or damaged.
    """
    units = _data_set(data) if is_data_set(data) else _public(data)
    names, count = tuple(sorted({unit.building for unit in units})), [len(unit.tokens) for unit in units]
    return Links(
        tokens=np.concatenate([unit.tokens for unit in units]),
        state=np.concatenate([unit.links.state for unit in units]),
        building=np.repeat([names.index(unit.building) for unit in units], count),
        transmitter=np.repeat(np.arange(len(units)), count),
        position=np.concatenate([unit.links.rx_position[:, :2].astype(np.float32) for unit in units]),
        tx_position=np.repeat(
            [unit.links.tx_position[:2].astype(np.float32) for unit in units], count, axis=0
        ),
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


def _public(data: Path) -> list[_Unit]:
    units = []
    for name, number in find_measurements(data):
        links = read_measurements(data, name, number)
        tokens = make_tokens(links.aoa_az, links.snr_db, aod_rad=links.aod_az, peak=links.peak_fraction)
        units.append(_Unit(name, tokens, links))
    return units


def _data_set(data: Path) -> list[_Unit]:
    with _manifest(data) as file:
        files = [data / unit["file"] for unit in json.loads(file.read())["units"]]
        if not files:
            raise ValueError("it lists no links")
        if missing := [file for file in files if not file.is_file()]:
            raise ValueError(f"it lists {missing[0].name}, which is not there")
    units = []
    for unit in files:
        links = read_records(unit)
        paths = links.estimates
        resolved = measured(aod_rad=paths.aod_rad, delay_s=paths.delay_s)
        tokens = make_tokens(paths.aoa_rad, paths.snr_db, **resolved)
        units.append(_Unit(links.plan, tokens, links))
    return units
