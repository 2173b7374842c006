"""Houses of HouseExpo: one JSON file each, with the outline of the floor.

`verts` lists the corners of one polygon in metres. It follows all walls, inner ones through slits, so that its inside
is the free floor of all rooms. A cell is free if its centre lies inside, by the even-odd rule; the rest is occupied.
Coordinates of the file become those of `map`, y upwards (the data set's viewer draws y downwards). Left out:
`room_category`, the rectangles of room types.

Reference: Li et al., "HouseExpo: a large-scale 2D indoor layout dataset for learning-based algorithms on
mobile robots", IROS 2020.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan, MapError, ReadingOptions, grid_size
from robosim.plans.formats.raster import winding_numbers
from robosim.support.reading import reading
from robosim.support.text_in import MOST_JSON, check_object, parse_json

RESOLUTION_M = 0.05
_REMEDY = (
    "Copy or export it again; expected are `verts` in metres, as in "
    '{"id": "house", "verts": [[0, 0], [4, 0], [4, 3], [0, 3]]}.'
)


def read_houseexpo(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan from a HouseExpo file, with a margin of one occupied cell around the house; uses `resolution_m`."""
    resolution_m = options.resolution_m or RESOLUTION_M
    with reading(
        path, "a HouseExpo file, which is JSON", _REMEDY, most_bytes=MOST_JSON, kind=MapError
    ) as file:
        house = check_object(parse_json(file.read()), ("verts",))
        corners = _corners(house["verts"])
        lower = corners.min(axis=0)
        nx, ny = grid_size(lower, corners.max(axis=0), resolution_m, "the house")
        origin = lower - resolution_m
        cells = (corners - origin) / resolution_m
        inside = winding_numbers(cells, np.roll(cells, -1, axis=0), (ny, nx)) % 2 == 1
        if not inside.any():
            raise MapError(f"the house holds no whole cell of {resolution_m:g} m. Are `verts` in metres?")
        label = house.get("id")
        return FloorPlan(
            occupancy=np.where(inside, FREE, OCCUPIED).astype(np.uint8),
            resolution_m=resolution_m,
            origin=(float(origin[0]), float(origin[1]), 0.0),
            name=label if isinstance(label, str) and label else path.stem,
        )


def _corners(verts: Any) -> Float[np.ndarray, "n 2"]:
    try:
        corners = np.array(verts, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError("`verts` holds other things than pairs of numbers") from error
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ValueError(
            f"`verts` has shape {corners.shape}, expected at least three corners [x, y] in metres"
        )
    if not np.isfinite(corners).all():
        i = int(np.argwhere(~np.isfinite(corners))[0, 0])
        raise ValueError(f"corner {i} of `verts` is {corners[i].tolist()}, expected finite numbers of metres")
    return corners
