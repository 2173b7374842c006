"""Top-down grids published with mmwRobotNav: `NAME.glb_topdownmap.out`.

Rows of comma-separated integers, the top one first: 0 outside, 1 navigable, 2 the border of the navigable
area, which is navigable too. A cell measures 0.05 m; the centre of the cell in row r and column c (from 0)
lies at x = 0.05 c, y = -0.05 r. The area is what an agent of radius 0.1 m could stand on, so that margin is
missing, and the published radio data had its walls through the centres of the outermost navigable cells.

Taken too: blanks instead of or around commas, commas at the end of rows, empty lines, and numbers as
`numpy.savetxt` writes them.

Reference: Yin et al., "Millimeter wave wireless assisted robot navigation with link state classification",
IEEE OJ-COMS 2022, and its repository mmwRobotNav.
"""

import re
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from robosim.floorplan import FREE, MAX_CELLS, OCCUPIED, FloorPlan, MapError
from robosim.formats.plan_bytes import read_plan_bytes

RESOLUTION_M = 0.05
ERODED_M = 0.1


def read_mmwrobotnav(path: Path, resolution_m: float = RESOLUTION_M) -> FloorPlan:
    """Floor plan from a top-down grid; both kinds of navigable cells are free.

    Raises:
        MapError: If the file cannot be read, rows differ in length, or a value is not 0, 1 or 2.
    """
    values = parse_grid(read_plan_bytes(path, "top-down grid"), str(path))
    return FloorPlan(
        occupancy=np.where(values == 0, OCCUPIED, FREE).astype(np.uint8)[::-1].copy(),
        resolution_m=resolution_m,
        origin=(-resolution_m / 2, -resolution_m * (len(values) - 1) - resolution_m / 2, 0.0),
        name=re.sub(r"(\.glb)?(_topdownmap)?\.out$", "", path.name, flags=re.IGNORECASE) or path.stem,
        wall_line="cell_centre",
        eroded_m=ERODED_M,
    )


def parse_grid(content: bytes, source: str) -> UInt8[np.ndarray, "rows columns"]:
    """Values 0, 1 and 2 of a grid, row 0 at the top; `source` names the file in messages.

    Raises:
        MapError: If rows differ in length, or a value is not 0, 1 or 2.
    """
    rows = [row for line in content.splitlines() if (row := _row(line))]
    if not rows:
        raise MapError(f"{source}: no values, expected rows of comma-separated 0, 1 and 2.")
    n_columns = len(rows[0])
    if len(rows) * n_columns > MAX_CELLS:
        raise MapError(f"{source}: {n_columns} x {len(rows)} cells, expected at most {MAX_CELLS:.0e} in all.")
    for number, row in enumerate(rows, start=1):
        if len(row) != n_columns:
            raise MapError(
                f"{source}: row {number} has {len(row)} values, but row 1 has {n_columns}. "
                "Rows must be equally long; was the file cut off?"
            )
    # A file has few different words, each looked at once.
    value_of = {word: _value(word) for word in set(chain.from_iterable(rows))}
    values = np.fromiter(map(value_of.__getitem__, chain.from_iterable(rows)), np.int8, len(rows) * n_columns)
    values = values.reshape(len(rows), n_columns)
    if (values < 0).any():
        r, c = (int(i) for i in np.argwhere(values < 0)[0])
        raise MapError(
            f"{source}: row {r + 1}, column {c + 1} is {rows[r][c].decode(errors='replace')[:40]!r}, "
            "expected 0 (outside), 1 (navigable) or 2 (border). Is this a top-down grid?"
        )
    return values.astype(np.uint8)


def _row(line: bytes) -> list[bytes]:
    """The words of a line."""
    line = line.strip(b" \t\r,")
    return line.split(b",") if b"," in line else line.split()


def _value(word: bytes) -> int:
    """0, 1, 2, or -1 for anything else."""
    try:
        number = float(word)
    except ValueError:
        return -1
    return int(number) if number in (0.0, 1.0, 2.0) else -1
