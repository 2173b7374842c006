"""Radio paths of many links as columns: one row per path, the strongest of each link first.

Angles are radians in the frame of the scene: azimuth counter-clockwise from +x, elevation up from the
horizon. Departure directions leave the transmitter; arrival directions point from the receiver back along
the path. Gains are between isotropic antennas, [theta, phi at the receiver, theta, phi at the transmitter]
(`wireless.em.fields`).

Link states are those of the reference data: of the paths above a power threshold, line of sight if the
strongest has no interaction, first order if any has exactly one, higher order if all have more, outage if
there are none.

`print(paths)` shows the first of them as a table, in degrees and nanoseconds; R, D and T are reflection, diffraction
and transmission from the transmitter on.
"""

from base64 import b64decode, b64encode
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Complex, Float, Int, UInt8
from numpy.typing import ArrayLike
from scipy.constants import speed_of_light

from robosim.support.axes import axes_in_metres
from robosim.support.checks import check_number
from robosim.support.reading import reading
from wireless.support.arrays import to_array
from wireless.support.columns import FAR, check_within, lists, numbers, parquet_table
from wireless.support.counting import counted
from wireless.support.listing import MOST_ROWS, Listing
from wireless.support.ray_colours import ray_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Keys of the metadata of a table of paths.
_SCENE = ("frequency_hz", "tx_position_m", "rx_position_m")
#: Unit and meaning of the columns of a table of paths, by how their names begin.
_MEANING = {
    "tx_": ("m", "place of the transmitter"),
    "tx": ("", "number of the transmitter, from 0"),
    "rx_": ("m", "place of the receiver"),
    "rx": ("", "number of the receiver, from 0"),
    "gain_": (
        "",
        "complex gain between isotropic antennas, polarisation at the receiver and at the transmitter",
    ),
    "power": ("", "power gain in the tracer's polarisation, a ratio"),
    "delay_s": ("s", "time of flight, with the group delay of passed walls"),
    "aoa_": ("rad", "direction that the path arrives from"),
    "aod_": ("rad", "direction in which it departs"),
    "order": ("", "number of interactions, 0 for line of sight"),
    "interaction": (
        "",
        "kind at each point: 1 reflection, 2 diffraction, 3 scattering, 4 transmission, 0 beyond the last",
    ),
    "primitive": ("", "number of the wall or edge at each point, -1 beyond the last"),
    "point_m": ("m", "x, y, z of each point, one after the other, NaN beyond the last"),
}
#: A file holds the paths of many links [bytes].
_MOST_BYTES = 100_000_000_000


class LinkState(IntEnum):
    """How a transmitter reaches a receiver; numbers as in the public data."""

    OUTAGE = 0
    LOS = 1
    FIRST_ORDER = 2
    HIGHER_ORDER = 3


class LinkCategory(IntEnum):
    """`LinkState` with line of sight through walls apart, as tables and pictures show it."""

    OUTAGE = 0
    LOS = 1
    FIRST_ORDER = 2
    HIGHER_ORDER = 3
    OBSTRUCTED_LOS = 4


class Interaction(IntEnum):
    """Interaction of a path at a point; numbers as in DeepMIMO."""

    NONE = 0
    REFLECTION = 1
    DIFFRACTION = 2
    SCATTERING = 3
    TRANSMISSION = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """Paths between transmitters and receivers."""

    tx_position: Float[np.ndarray, "n_tx 3"]
    """Positions of transmitters [m]."""
    rx_position: Float[np.ndarray, "n_rx 3"]
    """Positions of receivers [m]."""
    frequency_hz: float
    """Carrier frequency."""
    tx: Int[np.ndarray, " n"]
    """Transmitter of each path."""
    rx: Int[np.ndarray, " n"]
    """Receiver of each path."""
    gain: Complex[np.ndarray, "n 2 2"]
    """Complex gain, [theta, phi at the receiver, theta, phi at the transmitter]."""
    power: Float[np.ndarray, " n"]
    """Power gain in the tracer's polarisation, by which paths are sorted."""
    delay_s: Float[np.ndarray, " n"]
    """Time of flight: unfolded length over the speed of light, and the group delay of each passed wall beyond that of
    air, at the carrier. A gain at the carrier, which holds the phase within walls, times e^(-j 2 pi (f - f_c) delay) is
    the response at a frequency f next to it."""
    aoa_az: Float[np.ndarray, " n"]
    """Azimuth of arrival [rad]."""
    aoa_el: Float[np.ndarray, " n"]
    """Elevation of arrival [rad]."""
    aod_az: Float[np.ndarray, " n"]
    """Azimuth of departure [rad]."""
    aod_el: Float[np.ndarray, " n"]
    """Elevation of departure [rad]."""
    order: UInt8[np.ndarray, " n"]
    """Number of interactions, 0 for line of sight."""
    interaction: UInt8[np.ndarray, "n m"]
    """`Interaction` at each point, from transmitter to receiver; 0 beyond the last."""
    primitive: Int[np.ndarray, "n m"]
    """Facet or edge at each point, by the tracer's numbers; -1 beyond the last."""
    point: Float[np.ndarray, "n m 3"]
    """Position of each interaction [m]; NaN beyond the last."""

    def __len__(self) -> int:
        return len(self.tx)

    def __repr__(self) -> str:
        return f"<Paths: {self._summary()}>"

    def __str__(self) -> str:
        return self._listing().text()

    def _repr_html_(self) -> str:
        return self._listing().html()

    @property
    def link(self) -> Int[np.ndarray, " n"]:
        """Number of each path's link: transmitter times number of receivers plus receiver."""
        return self.tx * len(self.rx_position) + self.rx

    @property
    def rank(self) -> Int[np.ndarray, " n"]:
        """Place of each path in its link by power, 0 for the strongest, in whatever order the paths are."""
        link = self.link
        order = np.lexsort((-self.power, link))
        rank = np.empty_like(order)
        rank[order] = np.arange(len(link)) - np.searchsorted(link[order], link[order])
        return rank

    @property
    def power_db(self) -> Float[np.ndarray, " n"]:
        """Power gain in decibels; -inf for none."""
        with np.errstate(divide="ignore"):
            return 10 * np.log10(self.power)

    @property
    def digits(self) -> Int[np.ndarray, " n"]:
        """Kinds of interactions from the transmitter on, as decimal digits of one number; 0 for line of sight."""
        number = np.zeros(len(self), np.int64)
        for kind in self.interaction.T:
            number = np.where(kind == Interaction.NONE, number, 10 * number + kind)
        return number

    def select(self, which: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> "Paths":
        """Return the paths of a mask, or of numbers in any order, with the same links."""
        return replace(self, **{f.name: getattr(self, f.name)[which] for f in fields(self)[3:]})

    def strongest(self, n_max: int = 1) -> "Paths":
        """At most so many paths of each link."""
        among = self.rank < n_max
        return self if among.all() else self.select(among)

    def between(self, tx: int, rx: int) -> "Paths":
        """Paths of one link, by the numbers of its ends from 0 on; ValueError if there is no such link."""
        check_number("tx", tx, 0, len(self.tx_position) - 1, whole=True)
        check_number("rx", rx, 0, len(self.rx_position) - 1, whole=True)
        return self.select((self.tx == tx) & (self.rx == rx))

    def count(self) -> Int[np.ndarray, "n_tx n_rx"]:
        """Number of paths of each link."""
        shape = len(self.tx_position), len(self.rx_position)
        return np.bincount(self.link, minlength=shape[0] * shape[1]).reshape(shape)

    def doppler_hz(
        self,
        *,
        tx_velocity: ArrayLike | None = None,
        rx_velocity: ArrayLike | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Doppler shift of each path, positive where it becomes shorter.

        It is the frequency times the rate at which the delay falls, exactly: reflections and diffractions slide along
        their walls and edges so that the length does not change to first order.

        Args:
            tx_velocity: Velocity of the transmitters, 3 numbers, or of each, n_tx x 3 [m/s]; None for none.
            rx_velocity: Velocity of the receivers, or of each, likewise.

        Raises:
            ValueError: If velocities are of another number of terminals, or one is not finite.
        """
        rate = np.zeros(len(self))
        for name, velocity, position, end, az, el in (
            ("tx_velocity", tx_velocity, self.tx_position, self.tx, self.aod_az, self.aod_el),
            ("rx_velocity", rx_velocity, self.rx_position, self.rx, self.aoa_az, self.aoa_el),
        ):
            if velocity is not None:
                end_velocity = to_array(velocity, name)
                if end_velocity.shape not in ((3,), position.shape) or not np.isfinite(end_velocity).all():
                    raise ValueError(
                        f"{name} has shape {end_velocity.shape}, expected (3,) or {position.shape}, finite [m/s]."
                    )
                toward = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=1)
                rate += (np.broadcast_to(end_velocity, position.shape)[end] * toward).sum(axis=1)
        return rate * self.frequency_hz / speed_of_light

    def corners(self) -> Float[np.ndarray, "n m2 3"]:
        """Transmitter, interactions and receiver of each path [m]; NaN beyond the receiver."""
        corner = np.full((len(self), self.point.shape[1] + 2, 3), np.nan)
        corner[:, 0], corner[:, 1:-1] = self.tx_position[self.tx], self.point
        corner[np.arange(len(self)), self.order + 1] = self.rx_position[self.rx]
        return corner

    def link_state(self, threshold_db: float = -np.inf) -> UInt8[np.ndarray, "n_tx n_rx"]:
        """`LinkState` of each link.

        Line of sight: the strongest path is the direct one; as in the published data also if it passes walls, when it
        shows the direction of the transmitter but not a route there. First order: a path with a single reflection,
        diffraction or scattering that passes no wall. Higher order: anything else that arrives.

        Args:
            threshold_db: Paths of less power gain do not count.
        """
        category = self.link_category(threshold_db)
        return np.where(category == LinkCategory.OBSTRUCTED_LOS, np.uint8(LinkState.LOS), category)

    def link_category(self, threshold_db: float = -np.inf) -> UInt8[np.ndarray, "n_tx n_rx"]:
        """`LinkCategory` of each link: its link state, or obstructed line of sight if the direct path passes walls.

        Args:
            threshold_db: Paths of less power gain do not count.
        """
        above = self.select(self.power_db >= threshold_db)
        shape = len(self.tx_position), len(self.rx_position)
        direct = above.order == (above.interaction == Interaction.TRANSMISSION).sum(axis=1)
        state = np.zeros(shape[0] * shape[1], np.uint8)
        state[above.link] = LinkState.HIGHER_ORDER
        state[above.link[(above.order == 1) & ~direct]] = LinkState.FIRST_ORDER
        strongest = direct & (above.rank == 0)
        state[above.link[strongest]] = np.where(
            above.order[strongest] > 0, LinkCategory.OBSTRUCTED_LOS, LinkCategory.LOS
        )
        return state.reshape(shape)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw all paths from above, coloured by power gain, and the terminals that they join.

        For a single link: `paths.between(0, 3).plot()`.

        Args:
            axes: Where to draw, such as `building.plot()` gives; None for axes of a new figure.
        """
        from matplotlib.collections import LineCollection

        axes = axes_in_metres(axes)
        weakest_first = np.argsort(self.power, kind="stable")
        ends, corner = (self.tx_position[self.tx], self.rx_position[self.rx]), self.corners()
        lines = [corner[i, : self.order[i] + 2, :2] for i in weakest_first]
        rays = LineCollection(lines, cmap=ray_colours(), linewidths=1.0)
        rays.set_array(self.power_db[weakest_first])
        axes.add_collection(rays)
        for at, marker, name in ((ends[0], "*", "transmitter"), (ends[1], "P", "receiver")):
            axes.plot(*np.unique(at[:, :2], axis=0).T, marker, mec="white", ms=10, label=name)
        if len(self):
            axes.figure.colorbar(rays, ax=axes, label="power gain [dB]")
        axes.legend(fontsize="small")
        return axes

    def _summary(self) -> str:
        """Numbers of paths and links, and the frequency."""
        ends = (
            f"{counted(len(self.tx_position), 'transmitter')} to {counted(len(self.rx_position), 'receiver')}"
        )
        return f"{counted(len(self), 'path')}, {ends} at {self.frequency_hz / 1e9:g} GHz"

    def _listing(self) -> Listing:
        """The first paths as a table."""
        listed = self.select(np.arange(min(len(self), MOST_ROWS)))
        angles = [np.degrees(value) for value in (listed.aoa_az, listed.aoa_el, listed.aod_az, listed.aod_el)]
        rows = [
            (
                str(listed.tx[i]),
                str(listed.rx[i]),
                " ".join(Interaction(kind).name[0] for kind in listed.interaction[i, : listed.order[i]])
                or "direct",
                f"{listed.power_db[i]:.1f}",
                f"{1e9 * listed.delay_s[i]:.2f}",
                *(f"{angle[i]:.1f}" for angle in angles),
            )
            for i in range(len(listed))
        ]
        heads = (
            "tx",
            "rx",
            "interactions",
            "power [dB]",
            "delay [ns]",
            "AoA az [deg]",
            "AoA el [deg]",
            "AoD az [deg]",
            "AoD el [deg]",
        )
        return Listing(title=self._summary(), heads=heads, rows=rows, n_rows=len(self))

    def to_table(self) -> pa.Table:
        """As an Arrow table (and so a Pandas frame: `to_table().to_pandas()`), one row per path."""
        columns: dict[str, object] = {}
        for name in ("tx", "rx"):
            columns[name] = getattr(self, name)
            for i, axis in enumerate("xyz"):
                columns[f"{name}_{axis}_m"] = getattr(self, f"{name}_position")[getattr(self, name), i]
        for p, at_rx in enumerate(("theta", "phi")):
            for q, at_tx in enumerate(("theta", "phi")):
                columns[f"gain_{at_rx}_{at_tx}_re"] = np.ascontiguousarray(self.gain[:, p, q].real)
                columns[f"gain_{at_rx}_{at_tx}_im"] = np.ascontiguousarray(self.gain[:, p, q].imag)
        for name in ("power", "delay_s", "aoa_az", "aoa_el", "aod_az", "aod_el", "order"):
            columns[name + ("_rad" if name[0] == "a" else "")] = getattr(self, name)
        width = self.interaction.shape[1]
        columns["interaction"] = _lists(self.interaction, width)
        columns["primitive"] = _lists(self.primitive, width)
        columns["point_m"] = _lists(self.point.reshape(len(self), 3 * width), 3 * width)
        scene = {
            "frequency_hz": repr(self.frequency_hz),
            "tx_position_m": _as_text(self.tx_position),
            "rx_position_m": _as_text(self.rx_position),
        }
        table = pa.table(columns)
        fields = [field.with_metadata(_column_metadata(field.name)) for field in table.schema]
        return table.cast(pa.schema(fields, metadata=scene))

    def write_parquet(self, path: str | PathLike[str] | BytesIO) -> None:
        """Write all columns to a Parquet file, positions and frequency in its metadata."""
        pq.write_table(self.to_table(), path, compression="zstd")

    @classmethod
    def read_parquet(cls, path: str | PathLike[str], tx: int | None = None) -> "Paths":
        """Read what `write_parquet` wrote, or the paths of one of the transmitters without reading the others.

        Raises:
            FileError: If the file is not one of radio paths, or damaged.
        """
        with reading(Path(path), "radio paths", "Trace them again.", most_bytes=_MOST_BYTES) as file:
            return cls.from_table(parquet_table(file, filters=None if tx is None else [("tx", "=", tx)]))

    @classmethod
    def from_table(cls, table: pa.Table) -> "Paths":
        """Paths from what `to_table` made, or some of its rows.

        Args:
            table: Rows with all columns, and the metadata.

        Raises:
            ValueError: If the table is not one of radio paths.
        """
        scene = table.schema.metadata or {}
        if missing := [key for key in _SCENE if key.encode() not in scene]:
            raise ValueError(f"no radio paths: its metadata lack {missing[0]}; columns: {table.column_names}")
        tx_position, rx_position = (_positions(scene, who) for who in ("tx", "rx"))
        gain = np.empty((len(table), 2, 2), complex)
        for p, at_rx in enumerate(("theta", "phi")):
            for q, at_tx in enumerate(("theta", "phi")):
                gain[:, p, q] = numbers(table, f"gain_{at_rx}_{at_tx}_re", pa.float64())
                gain[:, p, q] += 1j * numbers(table, f"gain_{at_rx}_{at_tx}_im", pa.float64())
        plain = {
            name: numbers(table, name + ("_rad" if name[0] == "a" else ""), pa.float64())
            for name in ("power", "delay_s", "aoa_az", "aoa_el", "aod_az", "aod_el")
        }
        width = table.schema.field("interaction").type.list_size
        paths = cls(
            tx_position=tx_position,
            rx_position=rx_position,
            frequency_hz=float(scene[b"frequency_hz"]),
            tx=numbers(table, "tx", pa.int64(), 0, len(tx_position) - 1),
            rx=numbers(table, "rx", pa.int64(), 0, len(rx_position) - 1),
            gain=gain,
            order=numbers(table, "order", pa.uint8(), 0, width),
            interaction=_matrix(table, "interaction", pa.uint8(), width),
            primitive=_matrix(table, "primitive", pa.int64(), width),
            point=_matrix(table, "point_m", pa.float64(), 3 * width).reshape(-1, width, 3),
            **plain,
        )
        if not 0 < paths.frequency_hz < np.inf or (np.diff(paths.link) < 0).any():
            raise ValueError("paths are out of order, or their frequency is not positive and finite")
        check_within(paths.interaction, "interaction", 0, max(Interaction))
        return paths


def _column_metadata(column: str) -> dict[str, str]:
    """Unit and meaning of a column."""
    unit, meaning = next(entry for name, entry in _MEANING.items() if column.startswith(name))
    return {"unit": unit, "meaning": meaning}


def _as_text(positions: Float[np.ndarray, "n 3"]) -> str:
    """Positions for metadata, which some readers treat as text: 64-bit floats, lowest byte first, as base64."""
    return b64encode(positions.astype("<f8").tobytes()).decode()


def _positions(scene: dict[bytes, bytes], who: str) -> Float[np.ndarray, "n 3"]:
    content = b64decode(scene[f"{who}_position_m".encode()], validate=True)
    positions = np.frombuffer(content, "<f8").astype(float).reshape(-1, 3)
    check_within(positions, f"{who}_position_m", -FAR, FAR)
    return positions


def _matrix(table: pa.Table, name: str, kind: pa.DataType, width: int) -> np.ndarray:
    """A column of lists of equal length."""
    entries, _ = lists(table, name, pa.list_(kind, width))
    return entries.reshape(-1, width)


def _lists(values: np.ndarray, width: int) -> pa.Array:
    """Column of lists of equal length."""
    return pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(values).ravel()), width)
