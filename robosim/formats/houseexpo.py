"""Houses of HouseExpo: one JSON file each, with the outline of the floor.

`verts` lists the corners of one polygon in metres. It runs along all walls, around inner ones through slits,
so that its inside is the free floor of all rooms. A cell is free if its centre lies inside, by the even-odd
rule; the rest is occupied. Coordinates of the file become those of `map`, y upwards (the data set's own
viewer draws y downwards). Left out: `room_category`, the rectangles of room types.

Reference: Li et al., "HouseExpo: a large-scale 2D indoor layout dataset for learning-based algorithms on
mobile robots", IROS 2020.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.floorplan import FREE, OCCUPIED, FloorPlan, MapError, grid_size
from robosim.formats.plan_bytes import read_plan_bytes
from robosim.formats.scanline import winding_numbers

RESOLUTION_M = 0.05


def read_houseexpo(path: Path, resolution_m: float = RESOLUTION_M) -> FloorPlan:
    """Floor plan from a HouseExpo file, with a margin of one occupied cell around the house.

    Raises:
        MapError: If the file is no such JSON, a corner is not two finite numbers, or the house is absurdly
            large or smaller than a cell.
    """
    house = _load(path)
    corners = _corners(house.get("verts"), path)
    lower = corners.min(axis=0)
    nx, ny = grid_size(lower, corners.max(axis=0), resolution_m, f"{path}: the house")
    origin = lower - resolution_m
    cells = (corners - origin) / resolution_m
    inside = winding_numbers(cells, np.roll(cells, -1, axis=0), (ny, nx)) % 2 == 1
    if not inside.any():
        raise MapError(f"{path}: the house holds no whole cell of {resolution_m:g} m. Are `verts` in metres?")
    label = house.get("id")
    return FloorPlan(
        occupancy=np.where(inside, FREE, OCCUPIED).astype(np.uint8),
        resolution_m=resolution_m,
        origin=(float(origin[0]), float(origin[1]), 0.0),
        name=label if isinstance(label, str) and label else path.stem,
    )


def _load(path: Path) -> dict[str, Any]:
    content = read_plan_bytes(path, "HouseExpo JSON file")
    try:
        house = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise MapError(f"{path}: not readable as JSON: {error}. Copy or export it again.") from error
    if not isinstance(house, dict) or "verts" not in house:
        raise MapError(
            f"{path}: has no `verts`, expected a HouseExpo file such as "
            '{"id": "house", "verts": [[0, 0], [4, 0], [4, 3], [0, 3]]} in metres.'
        )
    return house


def _corners(verts: Any, path: Path) -> Float[np.ndarray, "n 2"]:
    try:
        corners = np.array(verts, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise MapError(f"{path}: `verts` holds other things than pairs of numbers ({error}).") from error
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise MapError(
            f"{path}: `verts` has shape {corners.shape}, expected at least three corners [x, y] in metres."
        )
    if not np.isfinite(corners).all():
        i = int(np.argwhere(~np.isfinite(corners))[0, 0])
        raise MapError(
            f"{path}: corner {i} of `verts` is {corners[i].tolist()}, expected finite numbers of metres."
        )
    return corners
