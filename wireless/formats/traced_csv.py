"""Traced paths as the CSV files of mmwRobotNav, `NAME_Tx_K.csv`: one row per receiver, 25 paths side by side.

Columns: line_index, rx_pos_ind_row, rx_pos_ind_column, rx_pos_x, rx_pos_y, npaths, los, link_state, 1st_NLOS,
and for path i from 1 to 25: i_srcvdpower [dBm], i_arrival_time [s], i_aoa_az, i_aoa_el, i_aod_az, i_aod_el
[degrees, elevation from the zenith], i_path_loss [dB]. Rows of the grid count from 1 at the top, columns from
1 at the left; line_index counts receivers of the full grid from 0 at the lower left, row by row, as in the
published measurements. Link states are those of `wireless.paths.LinkState`. Paths that are not there are empty
fields.

Reference: the public repository mmwRobotNav (Yin et al., IEEE OJ-COMS 2022) and its MATLAB reader.
"""

import csv
import io

import numpy as np
from jaxtyping import Float, Int

from wireless.paths import LinkState, Paths

N_PATHS = 25
_LINK = (
    "line_index",
    "rx_pos_ind_row",
    "rx_pos_ind_column",
    "rx_pos_x",
    "rx_pos_y",
    "npaths",
    "los",
    "link_state",
    "1st_NLOS",
)
_PATH = ("srcvdpower", "arrival_time", "aoa_az", "aoa_el", "aod_az", "aod_el", "path_loss")


def traced_csv(
    paths: Paths,
    tx: int,
    cell: Int[np.ndarray, "n_rx 2"],
    grid_shape: tuple[int, int],
    *,
    tx_power_dbm: float = 23.0,
    threshold_db: float = -np.inf,
) -> bytes:
    """The paths of one transmitter to all receivers, as the content of a file.

    Args:
        paths: Paths of this transmitter, and perhaps of others.
        tx: Number of the transmitter.
        cell: Row from the bottom and column of each receiver in its grid, from 0.
        grid_shape: Rows and columns of the grid.
        tx_power_dbm: Power sent, which received powers count from.
        threshold_db: Paths of less power gain do not count for the link state; they are written nevertheless.
    """
    some = paths.select(paths.tx == tx).strongest(N_PATHS)
    state = some.link_state(threshold_db)[tx]
    found = some.count()[tx]
    link = np.column_stack(
        [
            *grid_columns(cell, grid_shape),
            np.round(paths.rx_position[:, :2], 9),
            found,
            state == LinkState.LOS,
            state,
            state == LinkState.FIRST_ORDER,
        ]
    )
    values = _values(some, tx_power_dbm)
    start = np.concatenate([[0], np.cumsum(found)])
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow([*_LINK, *(f"{i}_{name}" for i in range(1, N_PATHS + 1) for name in _PATH)])
    for i, row in enumerate(link):
        mine = values[start[i] : start[i + 1]].ravel()
        empty = [""] * (N_PATHS * len(_PATH) - len(mine))
        writer.writerow([*(f"{v:.10g}" for v in row), *(f"{v:.9g}" for v in mine), *empty])
    return text.getvalue().encode("ascii")


def grid_columns(
    cell: Int[np.ndarray, "n 2"], grid_shape: tuple[int, int]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Line index, row and column of receivers as mmwRobotNav counts them.

    Args:
        cell: Row from the bottom and column of each receiver in its grid, from 0.
        grid_shape: Rows and columns of the grid.
    """
    rows, columns = cell.T
    return rows * grid_shape[1] + columns, grid_shape[0] - rows, columns + 1


def _values(paths: Paths, tx_power_dbm: float) -> Float[np.ndarray, "n 7"]:
    """What is written of each path."""
    gain_db = paths.power_db
    return np.column_stack(
        [
            tx_power_dbm + gain_db,
            paths.delay_s,
            np.degrees(paths.aoa_az),
            90 - np.degrees(paths.aoa_el),
            np.degrees(paths.aod_az),
            90 - np.degrees(paths.aod_el),
            -gain_db,
        ]
    )
