"""Links as rows of a Parquet file: places, true state, true paths, and estimated paths.

One file is one transmitter of one building, one row per link. Columns (also in `COLUMNS`, and in the metadata of the
file):

    plan, tx, rx, link                  names and numbers; tx counts from 1, as in file names
    rx_row, rx_column                   place in the grid of receivers, from 0 at the lower left
    tx_x_m ... rx_z_m                   positions in `map`
    rx_heading_rad                      azimuth of the receiver's first array
    link_state, n_paths                 true state (`wireless.paths.LinkState`), and number of true paths
    path_*                              true paths, the strongest first, as lists
    n_estimates                         number of estimated paths, at most five
    aoa_az_rad_k, aod_az_rad_k          estimated azimuths of path k = 1 to 5, the strongest first
    snr_db_k, delay_s_k                 its SNR (`wireless.estimates`), and delay after path 1

Azimuths are in the frame of the scene. Missing estimates are NaN, and so are departures and delays that the radio does
not resolve. True paths are those between vertically polarised isotropic antennas: enough to sound the links again
(`read_rays`). Left out: points of interaction, horizontal polarisation (`wireless.paths.Paths.write_parquet` has them).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float, Int, UInt8

from robosim.support.reading import reading
from wireless.estimates import PathEstimates
from wireless.paths import LinkState, Paths
from wireless.sounding.sounder import Rays
from wireless.support.columns import FAR, check_within, lists, parquet_table, values

#: Estimates of a link.
N_ESTIMATES = 5
_PLACES = range(1, N_ESTIMATES + 1)
_FLOATS = pa.list_(pa.float32())
_WHAT, _REMEDY = "links of a data set", "Make it again with `robosim dataset`."

#: Columns: type, unit and meaning.
COLUMNS: dict[str, tuple[pa.DataType, str, str]] = {
    "plan": (pa.dictionary(pa.int32(), pa.string()), "", "name of the building"),
    "tx": (pa.int16(), "", "number of the transmitter in its building, from 1"),
    "rx": (pa.int32(), "", "number of the receiver in its building, from 0"),
    "link": (pa.int64(), "", "number of the link in its building, from 0: by transmitter, then receiver"),
    "rx_row": (pa.int32(), "", "row of the receiver in its grid, from 0 at the bottom"),
    "rx_column": (pa.int32(), "", "column of the receiver, from 0 at the left"),
    **{f"tx_{axis}_m": (pa.float64(), "m", f"transmitter's {axis}") for axis in "xyz"},
    **{f"rx_{axis}_m": (pa.float64(), "m", f"receiver's {axis}") for axis in "xyz"},
    "rx_heading_rad": (pa.float32(), "rad", "azimuth of the receiver's own +x, which its arrays turn with"),
    "link_state": (pa.uint8(), "", "true state: 0 outage, 1 line of sight, 2 first order, 3 higher order"),
    "n_paths": (pa.uint8(), "", "number of true paths, of the strongest"),
    "path_gain_db": (_FLOATS, "dB", "true paths: power gain"),
    "path_phase_rad": (_FLOATS, "rad", "true paths: phase of the gain"),
    "path_delay_s": (_FLOATS, "s", "true paths: time of flight"),
    "path_aoa_az_rad": (_FLOATS, "rad", "true paths: azimuth of arrival"),
    "path_aoa_el_rad": (_FLOATS, "rad", "true paths: elevation of arrival"),
    "path_aod_az_rad": (_FLOATS, "rad", "true paths: azimuth of departure"),
    "path_aod_el_rad": (_FLOATS, "rad", "true paths: elevation of departure"),
    "path_interactions": (
        pa.list_(pa.int64()),
        "",
        "true paths: kinds of interaction from the transmitter on, as decimal digits: 1 reflection, 2 diffraction, "
        "3 scattering, 4 transmission; 0 for line of sight",
    ),
    "n_estimates": (pa.uint8(), "", "number of estimated paths"),
    **{f"aoa_az_rad_{k}": (pa.float32(), "rad", f"estimate {k}: azimuth of arrival") for k in _PLACES},
    **{f"aod_az_rad_{k}": (pa.float32(), "rad", f"estimate {k}: azimuth of departure") for k in _PLACES},
    **{
        f"snr_db_{k}": (
            pa.float32(),
            "dB",
            f"estimate {k}: SNR by the link budget, before correlation",
        )
        for k in _PLACES
    },
    **{f"delay_s_{k}": (pa.float32(), "s", f"estimate {k}: delay after estimate 1") for k in _PLACES},
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkRecords:
    """Links of a transmitter, without their true paths."""

    plan: str
    """Name of the building."""
    number: int
    """Number of the transmitter, from 1."""
    tx_position: Float[np.ndarray, "3"]
    """Place of the transmitter [m]."""
    rx_position: Float[np.ndarray, "n 3"]
    """Places of receivers [m]."""
    rx_cell: Int[np.ndarray, "n 2"]
    """Row and column of receivers in their grid, from 0 at the lower left."""
    rx_heading: Float[np.ndarray, " n"]
    """Azimuth of each receiver's own +x [rad]."""
    state: UInt8[np.ndarray, " n"]
    """True `wireless.paths.LinkState`."""
    n_paths: UInt8[np.ndarray, " n"]
    """Number of true paths."""
    estimates: PathEstimates
    """Estimated paths, in the frame of the scene."""


def link_table(
    paths: Paths,
    tx: int,
    estimates: PathEstimates,
    cell: Int[np.ndarray, "n_rx 2"],
    *,
    plan: str,
    rx_heading_rad: float | Float[np.ndarray, " n_rx"] = 0.0,
    threshold_db: float = -np.inf,
    first_rx: int = 0,
    all_rx: int | None = None,
) -> pa.Table:
    """Links of one transmitter as a table of `COLUMNS`.

    Args:
        paths: True paths of this transmitter, and perhaps of others.
        tx: Number of the transmitter, from 0.
        estimates: Estimates of its links, in the frame of the scene.
        cell: Row from the bottom and column of each receiver in its grid, from 0.
        plan: Name of the building.
        rx_heading_rad: Azimuth of each receiver's own +x.
        threshold_db: Paths of less power gain do not count for the link state, but are written.
        first_rx: Number of the first receiver, if the table is a block of a transmitter's links.
        all_rx: Number of receivers of all blocks; None if the table holds all links.
    """
    tx_paths = paths.select(paths.tx == tx)
    n_paths = tx_paths.count()[tx]
    n = len(n_paths)
    filled: dict[str, np.ndarray | pa.Array] = {
        "plan": pa.DictionaryArray.from_arrays(pa.array(np.zeros(n, np.int32)), pa.array([plan])),
        "tx": np.full(n, tx + 1),
        "rx": first_rx + np.arange(n),
        "link": tx * (all_rx or n) + first_rx + np.arange(n),
        "rx_row": cell[:, 0],
        "rx_column": cell[:, 1],
        "rx_heading_rad": np.broadcast_to(np.asarray(rx_heading_rad, float), n),
        "link_state": tx_paths.link_state(threshold_db)[tx],
        "n_paths": n_paths,
        "n_estimates": estimates.count,
    }
    for i, axis in enumerate("xyz"):
        filled[f"tx_{axis}_m"] = np.full(n, paths.tx_position[tx, i])
        filled[f"rx_{axis}_m"] = paths.rx_position[:, i]
    present = np.arange(N_ESTIMATES) < estimates.count[:, None]
    for name, of_paths in (
        ("aoa_az_rad", estimates.aoa_rad),
        ("aod_az_rad", estimates.aod_rad),
        ("snr_db", estimates.snr_db),
        ("delay_s", estimates.delay_s),
    ):
        for k in _PLACES:
            filled[f"{name}_{k}"] = np.where(present, of_paths, np.nan)[:, k - 1]
    starts = pa.array(np.concatenate([[0], np.cumsum(n_paths)]).astype(np.int32))
    lists = {name: pa.ListArray.from_arrays(starts, pa.array(v)) for name, v in _true_paths(tx_paths).items()}
    return pa.table(
        [
            pa.array(filled[name] if name in filled else lists[name]).cast(COLUMNS[name][0])
            for name in COLUMNS
        ],
        schema=_schema(),
    )


def write_links(path: str | PathLike[str] | BytesIO, blocks: Iterable[pa.Table]) -> None:
    """Write tables of `link_table`, one or more blocks of a transmitter's links; each is a group of rows."""
    with pq.ParquetWriter(path, _schema(), compression="zstd") as writer:
        for table in blocks:
            writer.write_table(table)


def read_links(path: str | PathLike[str], rows: range | None = None) -> LinkRecords:
    """Read a file of links, or some of its rows, without the true paths.

    Raises:
        FileError: If the file is of another kind, or damaged.
    """
    names = [name for name in COLUMNS if not name.startswith("path_")]
    with reading(Path(path), _WHAT, _REMEDY) as file:
        table = _table(file, names, rows)
        column = {name: values(table, name, COLUMNS[name][0]) for name in names}
        check_within(column["link_state"], "link_state", 0, max(LinkState))
        check_within(column["n_estimates"], "n_estimates", 0, N_ESTIMATES)
        check_within(column["rx_heading_rad"], "rx_heading_rad", -FAR, FAR)
        present = np.arange(N_ESTIMATES) < column["n_estimates"][:, None]

        def stack(names: list[str]) -> np.ndarray:
            return np.column_stack([column[name] for name in names])

        def position(end: str) -> Float[np.ndarray, "n 3"]:
            xyz_m = stack([f"{end}_{axis}_m" for axis in "xyz"])
            check_within(xyz_m, f"{end} position", -FAR, FAR)
            return xyz_m

        def estimated(name: str, missing: float) -> Float[np.ndarray, "n 5"]:
            estimates = stack([f"{name}_{k}" for k in _PLACES]).astype(float)
            # Departures and delays that were not resolved are NaN, all of them.
            if name in ("aod_az_rad", "delay_s") and np.isnan(estimates).all():
                return estimates
            check_within(np.where(present, estimates, 0.0), name, -FAR, FAR)
            return np.where(present, estimates, missing)

        return LinkRecords(
            plan=str(column["plan"][0]),
            number=int(column["tx"][0]),
            tx_position=position("tx")[0],
            rx_position=position("rx"),
            rx_cell=stack(["rx_row", "rx_column"]).astype(np.int64),
            rx_heading=column["rx_heading_rad"].astype(float),
            state=column["link_state"],
            n_paths=column["n_paths"],
            estimates=PathEstimates(
                aoa_rad=estimated("aoa_az_rad", 0.0),
                aod_rad=estimated("aod_az_rad", 0.0),
                snr_db=estimated("snr_db", -np.inf),
                delay_s=estimated("delay_s", 0.0),
                count=column["n_estimates"].astype(np.int64),
            ),
        )


def read_columns(path: str | PathLike[str], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Read some columns of numbers of a file of links; FileError if the file is of another kind, or damaged."""
    with reading(Path(path), _WHAT, _REMEDY) as file:
        table = _table(file, names)
        return {name: values(table, name, COLUMNS[name][0]) for name in names}


def read_rays(path: str | PathLike[str]) -> Rays:
    """Read the true paths of a file of links, to sound them again.

    Raises:
        FileError: If the file is of another kind, or damaged.
    """
    names = ("gain_db", "phase_rad", "delay_s", "aoa_az_rad", "aoa_el_rad", "aod_az_rad", "aod_el_rad")
    with reading(Path(path), _WHAT, _REMEDY) as file:
        table = _table(file, ["n_paths", *(f"path_{name}" for name in names)])
        count = values(table, "n_paths", COLUMNS["n_paths"][0]).astype(np.int64)
        present = np.arange(max(1, int(count.max(initial=0)))) < count[:, None]

        def padded(name: str, missing: float = 0.0) -> Float[np.ndarray, "n k"]:
            entries, lengths = lists(table, f"path_{name}", _FLOATS)
            if not np.array_equal(lengths, count):
                raise ValueError(f"the numbers of paths in path_{name} differ from n_paths")
            check_within(entries, f"path_{name}", -FAR, FAR)
            filled = np.full(present.shape, missing)
            filled[present] = entries
            return filled

        return Rays(
            gain=10 ** (padded("gain_db", -np.inf) / 20) * np.exp(1j * padded("phase_rad")),
            delay_s=padded("delay_s"),
            aoa_az=padded("aoa_az_rad"),
            aoa_el=padded("aoa_el_rad"),
            aod_az=padded("aod_az_rad"),
            aod_el=padded("aod_el_rad"),
        )


def _table(file: BinaryIO, names: Sequence[str], rows: range | None = None) -> pa.Table:
    table = parquet_table(file, names, rows=rows)
    if not len(table):
        raise ValueError("it has no rows")
    return table


def _true_paths(paths: Paths) -> dict[str, np.ndarray]:
    """Columns of all paths of a transmitter, one after the other."""
    gain = paths.gain[:, 0, 0]
    with np.errstate(divide="ignore"):
        gain_db = 20 * np.log10(np.abs(gain))
    return {
        "path_gain_db": gain_db,
        "path_phase_rad": np.angle(gain),
        "path_delay_s": paths.delay_s,
        "path_aoa_az_rad": paths.aoa_az,
        "path_aoa_el_rad": paths.aoa_el,
        "path_aod_az_rad": paths.aod_az,
        "path_aod_el_rad": paths.aod_el,
        "path_interactions": paths.digits,
    }


def _schema() -> pa.Schema:
    """Columns with units and meanings as metadata."""
    return pa.schema(
        [
            pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})
            for name, (kind, unit, meaning) in COLUMNS.items()
        ]
    )
