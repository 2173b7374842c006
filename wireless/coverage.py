"""Coverage of transmitters over the cells of a level grid: power, link states, delays, spreads, SNR, SINR, best server.

Gains are those between the ports of the antennas (`wireless.channel`), summed over the paths, with their powers or, if
coherent, with their phases. Transmit ports share the power equally, and receive ports add what they receive.
A gain is NaN in cells that are outside or in a body and 0 without a path; the other values are NaN without a path.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Int, UInt8

from robosim.support.axes import axes_in_metres
from wireless.antennas.mounting import MountedArray
from wireless.channel import Channel
from wireless.paths import Paths

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Values of each link in a map, besides gain and category.
_VALUES = (
    "delay_s",
    "delay_spread_s",
    *(f"{angle}_spread_rad" for angle in ("aoa_az", "aoa_el", "aod_az", "aod_el")),
)
#: Links whose values are computed at once.
_BATCH_LINKS = 8192
#: Labels of what `CoverageMap.plot` draws, and factors to their units.
_LABELS = {
    "power_dbm": ("received power [dBm]", 1.0),
    "snr_db": ("SNR [dB]", 1.0),
    "sinr_db": ("SINR [dB]", 1.0),
    "best_server": ("best server, from 1", 1.0),
    "delay_s": ("delay of the first path [ns]", 1e9),
    "delay_spread_s": ("delay spread [ns]", 1e9),
}


class CellState(IntEnum):
    """Whether a transmitter reaches a cell, or why not."""

    OUTSIDE = 0
    IN_BODY = 1
    NO_PATH = 2
    REACHED = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class ReceiverGrid:
    """Receivers in cells of a grid."""

    position: Float[np.ndarray, "n 3"]
    """Positions [m] in `map`, or in the frame of the scene."""
    cell: Int[np.ndarray, "n 2"]
    """Row from the bottom and column of each, from 0."""
    shape: tuple[int, int]
    """Rows and columns of the whole grid."""
    edges: Float[np.ndarray, "ny1 nx1 2"]
    """Corners (x, y) [m] of the grid's cells, whose centres receivers are."""
    unreached: UInt8[np.ndarray, "ny nx"]
    """`CellState` of each cell if no path arrives there."""

    def within(self, bounds_m: tuple[float, ...] | None) -> "ReceiverGrid":
        """The receivers in a box x, y, x, y [m], also without bounds; the cells of others are outside.

        Raises:
            ValueError: If the box is empty or has no receiver.
        """
        if bounds_m is None:
            return self
        check_bounds(bounds_m)
        west, south, east, north = bounds_m
        x, y = self.position[:, :2].T
        is_inside = (west <= x) & (x <= east) & (south <= y) & (y <= north)
        if not is_inside.any():
            raise outside_error(bounds_m, self.edges.min(axis=(0, 1)), self.edges.max(axis=(0, 1)))
        unreached = np.full_like(self.unreached, CellState.OUTSIDE)
        cell = self.cell[is_inside]
        unreached[tuple(cell.T)] = self.unreached[tuple(cell.T)]
        return ReceiverGrid(
            position=self.position[is_inside],
            cell=cell,
            shape=self.shape,
            edges=self.edges,
            unreached=unreached,
        )


def check_bounds(bounds_m: tuple[float, ...]) -> None:
    """Raise ValueError if four numbers are no box x, y, x, y [m]."""
    if (
        len(bounds_m) != 4
        or not np.isfinite(bounds_m).all()
        or not bounds_m[0] < bounds_m[2]
        or not bounds_m[1] < bounds_m[3]
    ):
        raise ValueError(
            f"bounds are {_text(bounds_m)}, expected the lower-left and the upper-right corner x, y, x, y [m]."
        )


def outside_error(
    bounds_m: tuple[float, ...], low: Float[np.ndarray, "..."], high: Float[np.ndarray, "..."]
) -> ValueError:
    """Error of a box x, y, x, y [m] that has nothing in common with a scene between two corners."""
    return ValueError(
        f"bounds are {_text(bounds_m)}, outside of the scene, which reaches from {_text(low[:2])} to {_text(high[:2])} "
        "m. Give others, or leave them out for the whole scene."
    )


def _text(values: Any) -> str:
    return f"({', '.join(f'{value:g}' for value in values)})"


def link_values(
    paths: Paths,
    *,
    tx: MountedArray | None = None,
    rx: MountedArray | None = None,
    coherent: bool = False,
    threshold_db: float = -np.inf,
) -> dict[str, np.ndarray]:
    """Values of links by the names of the fields of `CoverageMap`, n_tx x n_rx each, computed in batches.

    Args:
        paths: Paths of all links.
        tx: Antennas of transmitters; None for isotropic, vertically polarised ones.
        rx: Antennas of receivers; likewise.
        coherent: Whether paths add with their phases.
        threshold_db: Paths of less power gain do not count for link categories.
    """
    n_rx, size = len(paths.rx_position), max(1, _BATCH_LINKS // len(paths.tx_position))
    if n_rx > size:
        options = {"tx": tx, "rx": rx, "coherent": coherent, "threshold_db": threshold_db}
        parts = []
        for first in range(0, n_rx, size):
            batch = paths.select((first <= paths.rx) & (paths.rx < first + size))
            batch = replace(batch, rx=batch.rx - first, rx_position=paths.rx_position[first : first + size])
            parts.append(link_values(batch, **options))
        return {name: np.concatenate([part[name] for part in parts], axis=1) for name in parts[0]}
    channel = Channel.from_paths(paths, tx=tx, rx=rx)
    values = {
        "gain": channel.power(coherent=coherent).sum(axis=2).mean(axis=2),
        "category": paths.link_category(threshold_db),
        "delay_s": channel.first_delay_s(),
        "delay_spread_s": channel.delay_spread_s(),
    }
    for angle in ("aoa_az", "aoa_el", "aod_az", "aod_el"):
        values[f"{angle}_spread_rad"] = channel.angular_spread_rad(angle)
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class CoverageMap:
    """Radio coverage of the cells of a grid, rows upwards, by each transmitter."""

    tx_position: Float[np.ndarray, "n_tx 3"]
    """Positions of transmitters [m]."""
    tx_power_dbm: Float[np.ndarray, " n_tx"]
    """Their powers [dBm]."""
    noise_dbm: float
    """Noise of a receiver in its bandwidth, losses included [dBm]."""
    frequency_hz: float
    """Carrier frequency."""
    coherent: bool
    """Whether paths add with their phases."""
    points_per_cell: int
    """Points that a cell is the mean of; 1 for its middle alone."""
    position: Float[np.ndarray, "ny nx 3"]
    """Middles of cells [m]."""
    edges: Float[np.ndarray, "ny1 nx1 2"]
    """Corners (x, y) of cells [m]."""
    state: UInt8[np.ndarray, "n_tx ny nx"]
    """`CellState` of each cell."""
    category: UInt8[np.ndarray, "n_tx ny nx"]
    """`wireless.paths.LinkCategory`: the link state, with line of sight through walls apart."""
    gain: Float[np.ndarray, "n_tx ny nx"]
    """Power gain, a ratio; 0 without a path, NaN outside and in bodies."""
    delay_s: Float[np.ndarray, "n_tx ny nx"]
    """Time of flight of the first path; NaN without a path."""
    delay_spread_s: Float[np.ndarray, "n_tx ny nx"]
    """Root mean square delay spread; NaN without a path, likewise the others."""
    aoa_az_spread_rad: Float[np.ndarray, "n_tx ny nx"]
    """Angular spread of the azimuth of arrival, a circular standard deviation."""
    aoa_el_spread_rad: Float[np.ndarray, "n_tx ny nx"]
    """Angular spread of its elevation."""
    aod_az_spread_rad: Float[np.ndarray, "n_tx ny nx"]
    """Angular spread of the azimuth of departure."""
    aod_el_spread_rad: Float[np.ndarray, "n_tx ny nx"]
    """Angular spread of its elevation."""

    @classmethod
    def from_links(cls, links: Mapping[str, np.ndarray], grid: ReceiverGrid, **about: Any) -> "CoverageMap":
        """A map of `link_values` to the receivers of a grid; `about` are the first six fields, of one point a cell."""
        n_tx, at = len(links["gain"]), (slice(None), *grid.cell.T)
        filled = {name: np.full((n_tx, *grid.shape), np.nan) for name in ("gain", *_VALUES)}
        filled["category"] = np.zeros((n_tx, *grid.shape), np.uint8)
        for name, cells in filled.items():
            cells[at] = links[name]
        state = np.where(filled["gain"] > 0, np.uint8(CellState.REACHED), grid.unreached)
        filled["gain"][state < CellState.NO_PATH] = np.nan
        corner = grid.edges
        middle = (corner[:-1, :-1] + corner[1:, 1:]) / 2
        height = np.full((*grid.shape, 1), grid.position[0, 2])
        position = np.concatenate([middle, height], axis=2)
        position[tuple(grid.cell.T)] = grid.position
        return cls(position=position, edges=corner, state=state, points_per_cell=1, **filled, **about)

    @property
    def power_dbm(self) -> Float[np.ndarray, "n_tx ny nx"]:
        """Received power [dBm]; -inf without a path, NaN outside and in bodies."""
        with np.errstate(divide="ignore"):
            return 10 * np.log10(self.gain) + self.tx_power_dbm[:, None, None]

    @property
    def snr_db(self) -> Float[np.ndarray, "n_tx ny nx"]:
        """Received power over noise [dB]."""
        return self.power_dbm - self.noise_dbm

    @property
    def sinr_db(self) -> Float[np.ndarray, "n_tx ny nx"]:
        """Received power over noise and the powers of all other transmitters [dB], if all send at once."""
        power = 10 ** (self.power_dbm / 10)
        others = np.stack([np.nansum(np.delete(power, i, axis=0), axis=0) for i in range(len(power))])
        with np.errstate(divide="ignore"):
            return 10 * np.log10(power / (10 ** (self.noise_dbm / 10) + others))

    @property
    def best_server(self) -> Int[np.ndarray, "ny nx"]:
        """Number of the transmitter that is received with most power; -1 where none is."""
        power = np.nan_to_num(10 ** (self.power_dbm / 10))
        return np.where(power.max(axis=0) > 0, power.argmax(axis=0), -1)

    def best(self, quantity: str) -> Float[np.ndarray, "ny nx"]:
        """A quantity of the best server of each cell, such as `sinr_db`; NaN where none is."""
        server = self.best_server
        values = np.take_along_axis(getattr(self, quantity), np.maximum(server, 0)[None], axis=0)[0]
        return np.where(server >= 0, values, np.nan)

    def averaged(self, side: int) -> "CoverageMap":
        """A map of larger cells, of side x side cells each; cells left over at the upper and right edges are dropped.

        Gains are means over the cells in free space; delays are the smallest, spreads means weighted by gains, states
        the best, and link categories those of the strongest.
        """
        ny, nx = (n // side for n in self.gain.shape[1:])

        def blocks(values: np.ndarray) -> np.ndarray:
            """Values of each larger cell along the last axis."""
            split = values[:, : ny * side, : nx * side].reshape(-1, ny, side, nx, side)
            return np.moveaxis(split, 2, 3).reshape(-1, ny, nx, side * side)

        gain, state = blocks(self.gain), blocks(self.state)
        n_free, weight = (state >= CellState.NO_PATH).sum(axis=3), np.nan_to_num(gain)
        total = weight.sum(axis=3)
        with np.errstate(invalid="ignore"):
            averages = {"gain": total / np.where(n_free, n_free, np.nan)}
            for name in _VALUES[1:]:
                averages[name] = (weight * np.nan_to_num(blocks(getattr(self, name)))).sum(axis=3) / total
        delay_s = np.nan_to_num(blocks(self.delay_s), nan=np.inf).min(axis=3)
        strongest = weight.argmax(axis=3)[..., None]
        return replace(
            self,
            **averages,
            points_per_cell=self.points_per_cell * side**2,
            position=np.moveaxis(blocks(np.moveaxis(self.position, 2, 0)).mean(axis=3), 0, 2),
            edges=self.edges[: ny * side + 1 : side, : nx * side + 1 : side],
            state=state.max(axis=3),
            category=np.take_along_axis(blocks(self.category), strongest, axis=3)[..., 0],
            delay_s=np.where(np.isfinite(delay_s), delay_s, np.nan),
        )

    def to_arrays(self) -> dict[str, Any]:
        """All fields, and power, SNR, SINR and best server, by their names."""
        derived = ("power_dbm", "snr_db", "sinr_db", "best_server")
        return {**vars(self), **{name: getattr(self, name) for name in derived}}

    def to_table(self) -> pa.Table:
        """One row per transmitter and cell, as an Arrow table (`to_table().to_pandas()`)."""
        tx, row, column = np.indices(self.gain.shape)
        place = {
            f"{axis}_m": np.broadcast_to(self.position[..., i], tx.shape) for i, axis in enumerate("xyz")
        }
        columns = {
            "tx": tx,
            "row": row,
            "column": column,
            **place,
            "state": self.state,
            "category": self.category,
        }
        columns |= {name: getattr(self, name) for name in ("power_dbm", "snr_db", "sinr_db", *_VALUES)}
        columns["is_best_server"] = tx == self.best_server
        about = {
            "noise_dbm": self.noise_dbm,
            "frequency_hz": self.frequency_hz,
            "points_per_cell": self.points_per_cell,
        }
        table = pa.table({name: np.ascontiguousarray(values).ravel() for name, values in columns.items()})
        return table.replace_schema_metadata({name: repr(value) for name, value in about.items()})

    def plot(self, quantity: str = "power_dbm", tx: int | None = None, axes: "Axes | None" = None) -> "Axes":
        """Draw a quantity from above, and the transmitters.

        Args:
            quantity: Name of a field or property, such as `power_dbm`, `sinr_db`, `best_server` or `delay_spread_s`.
            tx: Number of the transmitter; None for the best server of each cell.
            axes: Where to draw, such as `building.plot()` gives; None for axes of a new figure.
        """
        from matplotlib import colormaps

        axes, n_tx, style = axes_in_metres(axes), len(self.gain), {"cmap": "cividis"}
        if quantity == "best_server":
            values = np.where(self.best_server >= 0, self.best_server + 1.0, np.nan)  # as in names of files
            style = {"cmap": colormaps["viridis"].resampled(n_tx), "vmin": 0.5, "vmax": n_tx + 0.5}
        elif tx is None:
            values = self.best(quantity)
        else:
            values = np.where(self.state[tx] == CellState.REACHED, getattr(self, quantity)[tx], np.nan)
        label, factor = _LABELS.get(quantity, (quantity, 1.0))
        image = axes.pcolormesh(*np.moveaxis(self.edges, 2, 0), factor * values, rasterized=True, **style)
        bar = axes.figure.colorbar(image, ax=axes, label=label, shrink=0.8)
        if quantity == "best_server" and n_tx <= 20:
            bar.set_ticks(range(1, n_tx + 1))
        axes.plot(*self.tx_position[:, :2].T, "*", color="#CC0000", mec="white", ms=13)
        return axes
