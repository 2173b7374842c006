"""The public radio data of mmwRobotNav: transmitters, receivers, true link states and estimated paths.

One folder per building has `NAME/NAME_tx_pos.csv` with a row per transmitter and `NAME/NAME_Tx_K_beam_search.csv`
with a row per link, K from 1. Positions are metres in the frame of the plans (`robosim.plans.formats.mmwrobotnav`:
x to the right, y up, so that y is negative). Angles in the files are degrees, counter-clockwise from +x; here
they are radians. The link states come from a commercial ray tracer, the paths from a simulated receiver.

The rule of the link states was derived from the data: walls are sheets that a path can pass once, and the passage is an
additional interaction, but a direct path counts as line of sight even so (`link_states`).

Reference: Yin et al., "Millimeter wave wireless assisted robot navigation with link state classification",
IEEE OJ-COMS 2022, and its repository mmwRobotNav.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as csv
from jaxtyping import Float, Int, UInt8

from robosim.support.reading import FileError, reading
from wireless.paths import Interaction, LinkState, Paths
from wireless.support.columns import numbers

__all__ = [
    "FileError",
    "Measurements",
    "find_measurements",
    "link_states",
    "read_measurements",
    "read_tx_positions",
]

#: Estimated paths of a link.
N_ESTIMATES = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurements:
    """All links of one transmitter."""

    building: str
    """Name of the building."""
    number: int
    """Number of the transmitter, from 1."""
    tx_position: Float[np.ndarray, "3"]
    """Place of the transmitter [m]."""
    rx_position: Float[np.ndarray, "n 2"]
    """Places of receivers [m]; they are as high as the transmitter."""
    rx_cell: Int[np.ndarray, "n 2"]
    """Row and column of receivers in their grid, from 1, row 1 at the top."""
    state: UInt8[np.ndarray, " n"]
    """True `wireless.paths.LinkState`."""
    aoa_az: Float[np.ndarray, "n 5"]
    """Estimated azimuths of arrival [rad], strongest path first."""
    aod_az: Float[np.ndarray, "n 5"]
    """Estimated azimuths of departure [rad]."""
    snr_db: Float[np.ndarray, "n 5"]
    """Estimated signal-to-noise ratios."""
    peak_fraction: Float[np.ndarray, "n 5"]
    """`peakFracResult`, as published."""


def find_measurements(data: str | Path) -> list[tuple[str, int]]:
    """Buildings and numbers of transmitters in a folder, sorted.

    Raises:
        FileError: If there are none.
    """
    measurements = []
    for path in sorted(Path(data).glob("*/*_Tx_*_beam_search.csv")):
        match = re.fullmatch(r"(.+)_Tx_(\d+)_beam_search\.csv", path.name)
        if match and match[1] == path.parent.name:
            measurements.append((match[1], int(match[2])))
    if not measurements:
        raise FileError(
            f"{data}: no NAME/NAME_Tx_K_beam_search.csv below it. Give the folder that holds one folder per building."
        )
    return sorted(measurements)


def read_measurements(data: str | Path, building: str, number: int) -> Measurements:
    """Links of one transmitter.

    Args:
        data: Folder with a folder for each building.
        building: Name of the building.
        number: Number of the transmitter, from 1.

    Raises:
        FileError: If a file is missing or damaged, or there is no such transmitter.
    """
    data = Path(data)
    transmitters = read_tx_positions(data / building / f"{building}_tx_pos.csv")
    if not 1 <= number <= len(transmitters):
        raise FileError(
            f"{data / building}: there is no transmitter {number}, but {len(transmitters)} in "
            f"{building}_tx_pos.csv."
        )
    path = data / building / f"{building}_Tx_{number}_beam_search.csv"
    lists = {
        name: [f"{name}_{i}" for i in range(1, N_ESTIMATES + 1)]
        for name in ("aoaAzResult", "aodAzResult", "snrResult", "peakFracResult")
    }
    plain = ["rxPos_1", "rxPos_2", "rxPosInd_1", "rxPosInd_2", "linkState"]
    table = _read(path, [*plain, *(column for columns in lists.values() for column in columns)])

    def columns(names: list[str]) -> Float[np.ndarray, "n k"]:
        return np.column_stack([table[name] for name in names])

    state = table["linkState"]
    if not np.isin(state, list(LinkState)).all():
        row = int(np.argmin(np.isin(state, list(LinkState))))
        raise FileError(f"{path}: linkState of row {row + 1} is {state[row]:g}, expected 0, 1, 2 or 3.")
    return Measurements(
        building=building,
        number=number,
        tx_position=transmitters[number - 1],
        rx_position=columns(plain[:2]),
        rx_cell=columns(plain[2:4]).astype(np.int64),
        state=state.astype(np.uint8),
        aoa_az=np.radians(columns(lists["aoaAzResult"])),
        aod_az=np.radians(columns(lists["aodAzResult"])),
        snr_db=columns(lists["snrResult"]),
        peak_fraction=columns(lists["peakFracResult"]),
    )


def read_tx_positions(path: Path) -> Float[np.ndarray, "n 3"]:
    """Positions of transmitters [m]; FileError if the file is missing or damaged."""
    table = _read(path, ["x", "y", "z"])
    return np.column_stack([table["x"], table["y"], table["z"]])


def link_states(paths: Paths) -> UInt8[np.ndarray, "n_tx n_rx"]:
    """`LinkState` of each link by the rule of the published labels.

    A direct path is line of sight, also if it passes a wall. First order needs a path with a single reflection or
    diffraction that passes no wall. Links with other paths only are of higher order.
    """
    passed = (paths.interaction == Interaction.TRANSMISSION).sum(axis=1)
    direct = paths.order == passed
    shape = len(paths.tx_position), len(paths.rx_position)
    state = np.full(shape[0] * shape[1], LinkState.OUTAGE, np.uint8)
    state[paths.link] = LinkState.HIGHER_ORDER
    state[paths.link[(paths.order == 1) & ~direct]] = LinkState.FIRST_ORDER
    state[paths.link[direct]] = LinkState.LOS
    return state.reshape(shape)


def _read(path: Path, names: list[str]) -> dict[str, Float[np.ndarray, " n"]]:
    """Columns of a file as finite numbers."""
    with reading(path, "a table of mmwRobotNav", "Copy it again.") as file:
        table = csv.read_csv(pa.PythonFile(file, mode="r"))
        if not len(table):
            raise ValueError("no rows below the header")
        return {name: numbers(table, name, pa.float64()) for name in names}
