"""Floor plans from NumPy arrays, in memory or in `.npy` files.

``array[iy, ix]`` has y upwards, like a floor plan. By its type a cell is

- bool: True is occupied;
- integer: 0 free, 1 occupied, 2 unknown;
- floating point: the probability of being occupied, put to map_server's thresholds; NaN is unknown.

An image that was loaded as an array has row 0 at the top: pass ``array[::-1]``.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Shaped, UInt8

from robosim.plans.floorplan import (
    FREE,
    MAX_CELLS,
    OCCUPIED,
    UNKNOWN,
    FloorPlan,
    MapError,
    ReadingOptions,
    check_size,
)
from robosim.plans.formats.thresholds import Thresholds
from robosim.support.arrays_in import parse_npy
from robosim.support.reading import reading

_MOST_BYTES = 8 * MAX_CELLS + 10_000


def plan_from_array(
    array: Shaped[np.ndarray, "..."],
    resolution_m: float,
    *,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    name: str = "plan",
    free_thresh: float = Thresholds().free,
    occupied_thresh: float = Thresholds().occupied,
) -> FloorPlan:
    """Floor plan from occupancy as booleans, states or probabilities.

    Args:
        array: Cells, (ny, nx), y upwards.
        resolution_m: Side of a cell [m].
        origin: x [m], y [m], yaw [rad] of the lower-left corner of cell (0, 0).
        name: The plan's name in reports.
        free_thresh: Probability below which a cell is free.
        occupied_thresh: Probability above which a cell is occupied.

    Raises:
        MapError: If the shape or a value makes no sense, or no cell is free.
    """
    if array.ndim != 2 or not 0 < array.size <= MAX_CELLS:
        raise MapError(
            f"{name}: the array has shape {array.shape}, expected (ny, nx), at most {MAX_CELLS:.2g} cells."
        )
    if array.dtype.kind == "b":
        states = np.where(array, OCCUPIED, FREE).astype(np.uint8)
    elif array.dtype.kind in "iu":
        states = _from_integers(array, name)
    elif array.dtype.kind == "f":
        states = _from_probabilities(array, name, Thresholds(free_thresh, occupied_thresh))
    else:
        raise MapError(
            f"{name}: the array holds {array.dtype}, expected bool (True is occupied), integers 0, 1, 2 "
            "(free, occupied, unknown) or floating-point probabilities."
        )
    return FloorPlan(occupancy=states, resolution_m=float(resolution_m), origin=origin, name=name)


def _from_integers(array: np.ndarray, name: str) -> UInt8[np.ndarray, "ny nx"]:
    wrong = array[(array < FREE) | (array > UNKNOWN)]
    if len(wrong):
        raise MapError(
            f"{name}: a cell is {wrong[0]}, expected 0 free, 1 occupied, 2 unknown. For percentages pass "
            "array / 100, unknown cells as NaN; for grey values write an image."
        )
    return np.array(array, dtype=np.uint8)


def _from_probabilities(array: np.ndarray, name: str, thresholds: Thresholds) -> UInt8[np.ndarray, "ny nx"]:
    wrong = array[(array < 0) | (array > 1)]
    if len(wrong):
        raise MapError(
            f"{name}: a cell is {wrong[0]:g}, expected a probability of being occupied between 0 and 1, "
            "or NaN for unknown."
        )
    return thresholds.states(array)


def read_npy(path: Path, options: ReadingOptions) -> FloorPlan:
    """Floor plan from a `.npy` file, by the rules of `plan_from_array`; uses `resolution_m` and `allow_large`."""
    if options.resolution_m is None:
        raise MapError(
            f"{path}: an array does not say how large a cell is. Pass the resolution, for example 0.05 "
            "for 5 cm (resolution_m=0.05, or --resolution 0.05)."
        )
    what = "one NumPy array of numbers"
    with reading(path, what, "Write it with numpy.save.", most_bytes=_MOST_BYTES, kind=MapError) as file:
        plan = plan_from_array(parse_npy(file.read()), options.resolution_m, name=path.stem)
    if not options.allow_large:
        check_size(plan.shape, plan.resolution_m)
    return plan
