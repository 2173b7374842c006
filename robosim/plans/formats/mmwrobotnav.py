"""Top-down grids published with mmwRobotNav: `NAME.glb_topdownmap.out`.

Rows of comma-separated integers, the top one first: 0 outside, 1 navigable, 2 the border of the navigable
area, which is navigable too. A cell measures 0.05 m; the centre of the cell in row r and column c (from 0)
lies at x = 0.05 c, y = -0.05 r. The area is what an agent of radius 0.1 m could stand on, so that margin is
missing, and the published radio data had its walls through the centres of the outermost navigable cells.

Accepted too: blanks instead of or around commas, commas at the end of rows, empty lines, and numbers as
`numpy.savetxt` writes them.

Reference: Yin et al., "Millimeter wave wireless assisted robot navigation with link state classification",
IEEE OJ-COMS 2022, and its repository mmwRobotNav.
"""

import re
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from robosim.plans.floorplan import FREE, MAX_CELLS, OCCUPIED, FloorPlan, MapError, ReadingOptions
from robosim.support.reading import reading

RESOLUTION_M = 0.05
ERODED_M = 0.1
#: Numbers as `numpy.savetxt` writes them take 25 bytes.
_MOST_BYTES = 150_000_000


def read_mmwrobotnav(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan from a top-down grid; both kinds of navigable cells are free. Uses `resolution_m`."""
    resolution_m = options.resolution_m or RESOLUTION_M
    with reading(path, "a top-down grid of mmwRobotNav", most_bytes=_MOST_BYTES, kind=MapError) as file:
        values = parse_grid(file.read())
        return FloorPlan(
            occupancy=np.where(values == 0, OCCUPIED, FREE).astype(np.uint8)[::-1].copy(),
            resolution_m=resolution_m,
            origin=(-resolution_m / 2, -resolution_m * (len(values) - 1) - resolution_m / 2, 0.0),
            name=re.sub(r"(\.glb)?(_topdownmap)?\.out$", "", path.name, flags=re.IGNORECASE) or path.stem,
            wall_line="cell_centre",
            eroded_m=ERODED_M,
        )


def parse_grid(content: bytes) -> UInt8[np.ndarray, "rows columns"]:
    """Values 0, 1 and 2 of a grid, row 0 at the top; ValueError for others, uneven rows, or too many of them."""
    value_of, cells = _Values(), 0
    rows: list[np.ndarray] = []
    for line in content.splitlines():
        words = _row(line)
        if not words:
            continue
        if rows and len(words) != len(rows[0]):
            raise ValueError(
                f"row {len(rows) + 1} has {len(words)} values, but row 1 has {len(rows[0])}; rows must be equally "
                "long: was the file cut off?"
            )
        cells += len(words)
        if cells > MAX_CELLS:
            raise ValueError(f"more than {MAX_CELLS:.2g} cells")
        row = np.fromiter(map(value_of.__getitem__, words), np.int8, len(words))
        if row.min() < 0:
            column = int(np.argmin(row))
            raise ValueError(
                f"row {len(rows) + 1}, column {column + 1} is {words[column].decode(errors='replace')[:40]!r}, "
                "expected 0 (outside), 1 (navigable) or 2 (border)"
            )
        rows.append(row.astype(np.uint8))
    if not rows:
        raise ValueError("no values, expected rows of comma-separated 0, 1 and 2")
    return np.stack(rows)


def _row(line: bytes) -> list[bytes]:
    """The words of a line."""
    line = line.strip(b" \t\r,")
    return line.split(b",") if b"," in line else line.split()


class _Values(dict[bytes, int]):
    """0, 1, 2, or -1 for anything else, by the word; each different word is parsed once."""

    def __missing__(self, word: bytes) -> int:
        try:
            number = float(word)
        except ValueError:
            number = -1.0
        self[word] = int(number) if number in (0.0, 1.0, 2.0) else -1
        return self[word]
