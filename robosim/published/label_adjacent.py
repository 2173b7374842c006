"""Adjacent paths: which paths the published ray tracer could find, as it looked for them at a quarter of the receivers.

It saved time where receivers are dense: rays were shot to a coarser grid only, every second receiver of every second
row, and a receiver between adopted the interactions of the paths found around it, and the exact paths that have them
were computed. So a path that exists between but nowhere around is missing there. The maker describes this as adjacent
path generation; which receivers are the coarse grid and how far around is looked was found from the labels.

The coarse grid goes on outside of the building, where nothing is published: these receivers are traced too.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from wireless.paths import Paths

#: Distance between receivers [m].
SPACING_M = 0.15
#: Receivers adopt what is found at most so many rows and columns away: 93.4 % of links of seven buildings agree
#: so, 93.2 % with 2.
REACH = 1
#: More than there are rows or columns.
_WIDE = 1 << 20


def fully_traced(cell: Int[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Which receivers, by row and column from 1, rays were shot to: even row, odd column."""
    return (cell[:, 0] % 2 == 0) & (cell[:, 1] % 2 == 1)


def with_coarse(
    cell: Int[np.ndarray, "n 2"], position: Float[np.ndarray, "n 2"]
) -> tuple[Int[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
    """Cells and positions [m] of receivers, and then of all others around to which rays were shot.

    Cells are rows and columns from 1 at the north-west.

    Raises:
        ValueError: If receivers are on no grid of `SPACING_M`.
    """
    corner = position - SPACING_M * cell[:, ::-1] * (1, -1)
    origin = np.median(corner, axis=0)
    off = np.abs(corner - origin).max()
    if not off < 0.01 * SPACING_M:
        raise ValueError(
            f"a receiver is {off:.3g} m off its place in a grid of {SPACING_M} m. "
            "Are its row and column those of the published data?"
        )
    around = np.unique((cell[:, None] + _steps()).reshape(-1, 2), axis=0)
    around = around[fully_traced(around)]
    around = around[~np.isin(_number(around), _number(cell))]
    return np.vstack([cell, around]), np.vstack([position, origin + SPACING_M * around[:, ::-1] * (1, -1)])


def adopted(paths: Paths, cell: Int[np.ndarray, "n_rx 2"]) -> Bool[np.ndarray, " n"]:
    """Which paths of one transmitter end at a fully traced receiver, or have the interactions of one around."""
    rows = np.column_stack([paths.interaction.astype(np.int64), paths.primitive])
    sequence = np.unique(rows, axis=0, return_inverse=True)[1].ravel().astype(np.int64)
    n_sequences = int(sequence.max(initial=0)) + 1
    full = fully_traced(cell)
    there = full[paths.rx]
    known = np.unique(_number(cell)[paths.rx[there]] * n_sequences + sequence[there])
    found = there.copy()
    for step in _steps():
        near = cell + step
        wanted = _number(near)[paths.rx] * n_sequences + sequence
        found |= ~there & fully_traced(near)[paths.rx] & np.isin(wanted, known)
    return found


def _steps() -> Int[np.ndarray, "k 2"]:
    """Rows and columns to the receivers around, and to the receiver itself."""
    one = np.arange(-REACH, REACH + 1)
    return np.stack(np.meshgrid(one, one, indexing="ij"), axis=-1).reshape(-1, 2)


def _number(cell: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    """One number for each cell."""
    return (cell[:, 0] + _WIDE // 2) * _WIDE + cell[:, 1] + _WIDE // 2
