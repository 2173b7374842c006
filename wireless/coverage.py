"""Coverage of transmitters over the cells of a level grid: power, link states, delays, spreads, SNR, SINR, best server.

Gains are those between the ports of antennas (`wireless.channel`), summed over the paths: their powers or, if coherent,
their fields. Transmit ports share the power equally, and receive ports add what they receive.
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

#: Links whose values are computed at once.
_BATCH_LINKS = 8192
#: Values that are means over the points of a cell, weighted by gains.
_SPREADS = ("delay_spread_s", "aoa_az_spread_rad", "aod_az_spread_rad")
#: Labels of quantities in pictures, and the factors of their units.
_SHOWN = {
    "power_dbm": ("received power [dBm]", 1.0),
    "snr_db": ("SNR [dB]", 1.0),
    "sinr_db": ("SINR [dB]", 1.0),
    "best_server": ("best server", 1.0),
    "delay_s": ("delay of the first path [ns]", 1e9),
    "delay_spread_s": ("delay spread [ns]", 1e9),
    "aoa_az_spread_rad": ("spread of azimuths of arrival [degrees]", np.rad2deg(1.0)),
    "aod_az_spread_rad": ("spread of azimuths of departure [degrees]", np.rad2deg(1.0)),
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


def link_values(
    paths: Paths,
    tx: MountedArray,
    rx: MountedArray,
    *,
    coherent: bool = False,
    threshold_db: float = -np.inf,
    points: int = 1,
) -> dict[str, np.ndarray]:
    """Values of links between antennas by the names of the fields of `CoverageMap`, n_tx x n_rx each, in batches.

    Paths of less power gain than the threshold do not count for link categories. If each cell has several receivers,
    one after the other, gains are means over its points, spreads weighted ones; delays are the smallest, and categories
    those of the strongest.
    """
    parts, size = [], max(1, _BATCH_LINKS // len(paths.tx_position)) * points
    for first in range(0, len(paths.rx_position), size):
        batch = paths.select((first <= paths.rx) & (paths.rx < first + size))
        batch = replace(batch, rx=batch.rx - first, rx_position=paths.rx_position[first : first + size])
        channel = Channel.from_paths(batch, tx=tx, rx=rx.of_terminals(slice(first, first + size)))
        values = {
            "gain": channel.power(coherent=coherent).sum(axis=2).mean(axis=2),
            "category": batch.link_category(threshold_db),
            "delay_s": channel.first_delay_s(),
            "delay_spread_s": channel.delay_spread_s(),
            "aoa_az_spread_rad": channel.angular_spread_rad("aoa_az"),
            "aod_az_spread_rad": channel.angular_spread_rad("aod_az"),
        }
        values = {name: each.reshape(len(each), -1, points) for name, each in values.items()}
        weight, strongest = values["gain"], values["gain"].argmax(axis=2)[..., None]
        with np.errstate(invalid="ignore"):
            means = {name: np.nansum(weight * values[name], axis=2) / weight.sum(axis=2) for name in _SPREADS}
        first_s = np.fmin.reduce(values["delay_s"], axis=2)
        category = np.take_along_axis(values["category"], strongest, axis=2)[..., 0]
        parts.append({**means, "gain": weight.mean(axis=2), "delay_s": first_s, "category": category})
    return {name: np.concatenate([values[name] for values in parts], axis=1) for name in parts[0]}


@dataclass(frozen=True, kw_only=True, eq=False)
class CoverageMap:
    """Coverage of the cells of a grid, rows upwards, by each transmitter; delays and spreads are NaN without a path."""

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
    points_per_cell: int = 1
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
    """Time of flight of the first path."""
    delay_spread_s: Float[np.ndarray, "n_tx ny nx"]
    """Root mean square delay spread."""
    aoa_az_spread_rad: Float[np.ndarray, "n_tx ny nx"]
    """Circular standard deviation of the azimuth of arrival."""
    aod_az_spread_rad: Float[np.ndarray, "n_tx ny nx"]
    """Circular standard deviation of the azimuth of departure."""

    @classmethod
    def from_links(cls, links: Mapping[str, np.ndarray], grid: ReceiverGrid, **about: Any) -> "CoverageMap":
        """A map of `link_values` to the receivers of a grid; `about` are the first fields."""
        cells: dict[str, Any] = {}
        for name, values in links.items():
            empty = 0 if name == "category" else np.nan
            cells[name] = np.full((len(values), *grid.shape), empty, values.dtype)
            cells[name][:, *grid.cell.T] = values
        state = np.where(cells["gain"] > 0, np.uint8(CellState.REACHED), grid.unreached)
        cells["gain"][state < CellState.NO_PATH] = np.nan
        middle = (grid.edges[:-1, :-1] + grid.edges[1:, 1:]) / 2
        position = np.dstack([middle, np.full(grid.shape, grid.position[0, 2])])
        position[tuple(grid.cell.T)] = grid.position
        return cls(position=position, edges=grid.edges, state=state, **cells, **about)

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

    def to_arrays(self) -> dict[str, Any]:
        """All fields, and power, SNR, SINR and best server, by their names."""
        derived = ("power_dbm", "snr_db", "sinr_db", "best_server")
        return {**vars(self), **{name: getattr(self, name) for name in derived}}

    def to_table(self) -> pa.Table:
        """Rows of transmitters and cells, as an Arrow table (`to_table().to_pandas()`)."""
        tx, row, column = np.indices(self.gain.shape)
        columns: dict[str, Any] = {"tx": tx, "row": row, "column": column}
        columns |= {
            f"{axis}_m": np.broadcast_to(self.position[..., i], tx.shape) for i, axis in enumerate("xyz")
        }
        names = ("state", "category", "power_dbm", "snr_db", "sinr_db", "delay_s", *_SPREADS)
        columns |= {name: getattr(self, name) for name in names}
        columns["is_best_server"] = tx == self.best_server
        about = {name: repr(getattr(self, name)) for name in ("noise_dbm", "frequency_hz", "points_per_cell")}
        table = pa.table({name: np.ascontiguousarray(values).ravel() for name, values in columns.items()})
        return table.replace_schema_metadata(about)

    def plot(self, quantity: str, tx: int | None = None, axes: "Axes | None" = None) -> "Axes":
        """Draw a quantity of a transmitter, by default of the best server of each cell, from above.

        Args:
            quantity: Name of a field or property, such as `power_dbm`, `sinr_db`, `best_server` or `delay_spread_s`.
            tx: Number of the transmitter.
            axes: Where to draw, such as `building.plot()` gives; None for axes of a new figure.
        """
        from matplotlib.colors import BoundaryNorm

        axes = axes_in_metres(axes)
        style: dict[str, Any] = {}
        bar: dict[str, Any] = {}
        label, scale = _SHOWN.get(quantity, (quantity, 1.0))
        if quantity == "best_server":
            numbers = np.arange(len(self.gain)) + 1  # as in names of files
            values = np.where(self.best_server >= 0, self.best_server + 1.0, np.nan)
            style["norm"], bar["ticks"] = BoundaryNorm([0.5, *numbers + 0.5], 256), numbers
        else:
            if tx is None:
                values = self.best(quantity)
            else:
                values = np.where(self.state[tx] == CellState.REACHED, getattr(self, quantity)[tx], np.nan)
            values, bar["extend"] = scale * values, "both"
            known = values[np.isfinite(values)]
            # A few cells that hardly anything reaches would take most of the colours.
            style["vmin"], style["vmax"] = np.percentile(known, [1, 99.5]) if len(known) else (0, 1)
        image = axes.pcolormesh(*np.moveaxis(self.edges, 2, 0), values, cmap="cividis", **style)
        axes.figure.colorbar(image, ax=axes, label=label, shrink=0.8, **bar)
        axes.plot(*self.tx_position[:, :2].T, "*", color="#CC0000", mec="white", ms=13)
        return axes
