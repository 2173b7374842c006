"""Estimated paths as the CSV files of mmwRobotNav, `NAME_Tx_K_beam_search.csv`: one row a link, five paths.

Columns: an index, lineIndex, rxPos_1 and rxPos_2 (x, y [m]), rxPosInd_1 and rxPosInd_2 (row from 1 at the top, column
from 1 at the left), linkState, and for path i of 5: aoaAzResult_i, aodAzResult_i [degrees, counter-clockwise from
+x], snrResult_i [dB], peakFracResult_i. Places without a path hold zeros, as published links in outage do.

What differs from the published files: strong paths have SNRs beyond the 55 dB where those level off
(`wireless.estimates`), and peakFracResult, which compares a peak with its surroundings on the published receiver's
grid, is 0. `wireless.formats.mmwrobotnav` reads these files.
Reference: the public repository mmwRobotNav (Yin et al., IEEE OJ-COMS 2022).
"""

import csv
import io

import numpy as np
from jaxtyping import Float, Int, UInt8

from wireless.estimates import PathEstimates
from wireless.formats.traced_csv import grid_columns

N_PATHS = 5
_LINK = ("", "lineIndex", "rxPos_1", "rxPos_2", "rxPosInd_1", "rxPosInd_2", "linkState")
_PATH = ("aoaAzResult", "aodAzResult", "snrResult", "peakFracResult")


def estimated_csv(
    estimates: PathEstimates,
    rx_position: Float[np.ndarray, "n 3"],
    state: UInt8[np.ndarray, " n"],
    cell: Int[np.ndarray, "n 2"],
    grid_shape: tuple[int, int],
) -> bytes:
    """The links of one transmitter, as the content of a file.

    Args:
        estimates: Estimated paths, in the frame of the scene.
        rx_position: Where receivers are [m].
        state: True link states.
        cell: Row from the bottom and column of each receiver in its grid, from 0.
        grid_shape: Rows and columns of the grid.
    """
    line, row, column = grid_columns(cell, grid_shape)
    found = np.arange(N_PATHS) < estimates.count[:, None]
    link = np.column_stack([np.arange(len(line)), line, np.round(rx_position[:, :2], 9), row, column, state])
    values = [np.degrees(estimates.aoa_rad), np.degrees(estimates.aod_rad), estimates.snr_db]
    paths = np.column_stack([*(np.where(found, v, 0.0) for v in values), np.zeros(found.shape)])
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow([*_LINK, *(f"{name}_{i}" for name in _PATH for i in range(1, N_PATHS + 1))])
    for start, rest in zip(link, paths, strict=True):
        writer.writerow([*(f"{v:.10g}" for v in start), *(f"{v:.9g}" for v in rest)])
    return text.getvalue().encode("ascii")
