"""Links as CSV files of mmwRobotNav: traced paths, `NAME_Tx_K.csv`, and estimated ones, `NAME_Tx_K_beam_search.csv`.

Both have one row per link. Rows of the grid count from 1 at the top, columns from 1 at the left; the line index counts
receivers of the full grid from 0 at the lower left, row by row. Link states are those of `wireless.paths.LinkState`.

Traced paths: line_index, rx_pos_ind_row, rx_pos_ind_column, rx_pos_x, rx_pos_y, npaths, los, link_state, 1st_NLOS, and
for path i of 25: i_srcvdpower [dBm], i_arrival_time [s], i_aoa_az, i_aoa_el, i_aod_az, i_aod_el [degrees, elevation
from the zenith], i_path_loss [dB]. Fields of missing paths are empty.

Estimated paths: an index, lineIndex, rxPos_1 and rxPos_2 (x, y [m]), rxPosInd_1 and rxPosInd_2 (row, column),
linkState, and for path i of 5: aoaAzResult_i, aodAzResult_i [degrees, counter-clockwise from +x], snrResult_i [dB],
peakFracResult_i. Missing paths hold zeros, like published links in outage. Unlike in the published files, SNRs of
strong paths exceed 55 dB, where those level off (`wireless.estimates`), and peakFracResult, which compares a peak with
its surroundings on the published receiver's grid, is 0. `wireless.formats.mmwrobotnav_measurements` reads these files.

Reference: the public repository mmwRobotNav (Yin et al., IEEE OJ-COMS 2022) and its MATLAB reader.
"""

import csv
import io
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int, UInt8

from wireless.estimates import PathEstimates
from wireless.paths import LinkState, Paths

#: Paths of a row, traced and estimated.
N_TRACED, N_ESTIMATED = 25, 5
_TRACED_LINK = (
    *("line_index", "rx_pos_ind_row", "rx_pos_ind_column", "rx_pos_x", "rx_pos_y"),
    *("npaths", "los", "link_state", "1st_NLOS"),
)
_TRACED_PATH = ("srcvdpower", "arrival_time", "aoa_az", "aoa_el", "aod_az", "aod_el", "path_loss")
_ESTIMATED_LINK = ("", "lineIndex", "rxPos_1", "rxPos_2", "rxPosInd_1", "rxPosInd_2", "linkState")
_ESTIMATED_PATH = ("aoaAzResult", "aodAzResult", "snrResult", "peakFracResult")


def traced_csv(
    paths: Paths,
    tx: int,
    cell: Int[np.ndarray, "n_rx 2"],
    grid_shape: tuple[int, int],
    *,
    tx_power_dbm: float = 23.0,
    threshold_db: float = -np.inf,
) -> bytes:
    """The traced paths of one transmitter to all receivers, as the content of a file.

    Args:
        paths: Paths of this transmitter, and perhaps of others.
        tx: Number of the transmitter.
        cell: Row from the bottom and column of each receiver in its grid, from 0.
        grid_shape: Rows and columns of the grid.
        tx_power_dbm: Transmit power.
        threshold_db: Paths of less power gain do not count for the link state, but are written.
    """
    strongest = paths.select(paths.tx == tx).strongest(N_TRACED)
    state, n_paths, gain_db = (
        strongest.link_state(threshold_db)[tx],
        strongest.count()[tx],
        strongest.power_db,
    )
    link = np.column_stack(
        [
            *_grid_columns(cell, grid_shape),
            np.round(paths.rx_position[:, :2], 9),
            n_paths,
            state == LinkState.LOS,
            state,
            state == LinkState.FIRST_ORDER,
        ]
    )
    values = np.column_stack(
        [
            tx_power_dbm + gain_db,
            strongest.delay_s,
            np.degrees(strongest.aoa_az),
            90 - np.degrees(strongest.aoa_el),
            np.degrees(strongest.aod_az),
            90 - np.degrees(strongest.aod_el),
            -gain_db,
        ]
    )
    header = [*_TRACED_LINK, *(f"{i}_{name}" for i in range(1, N_TRACED + 1) for name in _TRACED_PATH)]
    of_links = np.split(values, np.cumsum(n_paths))[:-1]
    return _csv(header, zip(link, (each.ravel() for each in of_links), strict=True))


def estimated_csv(
    estimates: PathEstimates,
    rx_position: Float[np.ndarray, "n 3"],
    state: UInt8[np.ndarray, " n"],
    cell: Int[np.ndarray, "n 2"],
    grid_shape: tuple[int, int],
) -> bytes:
    """The estimated paths of one transmitter, as the content of a file.

    Args:
        estimates: Estimated paths, in the frame of the scene.
        rx_position: Places of receivers [m].
        state: True link states.
        cell: Row from the bottom and column of each receiver in its grid, from 0.
        grid_shape: Rows and columns of the grid.
    """
    line, row, column = _grid_columns(cell, grid_shape)
    present = np.arange(N_ESTIMATED) < estimates.count[:, None]
    link = np.column_stack([np.arange(len(line)), line, np.round(rx_position[:, :2], 9), row, column, state])
    values = [np.degrees(estimates.aoa_rad), np.degrees(estimates.aod_rad), estimates.snr_db]
    paths = np.column_stack([*(np.where(present, v, 0.0) for v in values), np.zeros(present.shape)])
    header = [
        *_ESTIMATED_LINK,
        *(f"{name}_{i}" for name in _ESTIMATED_PATH for i in range(1, N_ESTIMATED + 1)),
    ]
    return _csv(header, zip(link, paths, strict=True))


def _grid_columns(
    cell: Int[np.ndarray, "n 2"], grid_shape: tuple[int, int]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Line index, row and column of receivers as mmwRobotNav counts them."""
    rows, columns = cell.T
    return rows * grid_shape[1] + columns, grid_shape[0] - rows, columns + 1


def _csv(header: list[str], rows: Iterable[tuple[np.ndarray, np.ndarray]]) -> bytes:
    """A file of links, each with the values of its paths; missing values are empty fields."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(header)
    for link, paths in rows:
        empty = [""] * (len(header) - len(link) - len(paths))
        writer.writerow([*(f"{v:.10g}" for v in link), *(f"{v:.9g}" for v in paths), *empty])
    return text.getvalue().encode("ascii")
