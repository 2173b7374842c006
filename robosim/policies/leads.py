"""The ways between the robot and all places around: in which directions they begin and end.

A wave that comes round corners comes through the same doors as a robot would: the direction in which it arrives is
near to that in which the shortest way to its source begins, and the direction in which it left near to that in which
the way from there begins. Both are told for all cells of a grid at once, by fast marching through what is known to be
free and what is not known, round what is known, or surely anticipated, to be an obstacle.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from slam.grid import GridFrame, MapEstimate
from slam.planning.marching import march
from wireless.support.compiled import compiled

#: Obstacles that are only anticipated count from this probability on: at less, doors that nobody saw would be shut.
_SURE = 0.9
#: Part of a cell that obstacles have to fill for ways to go round it.
_FILLED = 0.4
#: Part of a cell that must have been seen for it to count as such.
_SEEN = 0.5
#: Ways are taken to begin straight for so many cells.
_BEGIN_CELLS = 4.0
#: A way this much longer than the straight line is as good as straight.
_STRAIGHT = 1.02


class Leads(NamedTuple):
    """Directions of the shortest ways between a place and the cells of a part of a grid."""

    rows: slice
    """Rows of the grid that are told of."""
    columns: slice
    """Columns that are told of."""
    out: Float32[np.ndarray, "ny nx 2"]
    """Unit vector (x, y) in which the way from the place to each cell begins; 0 where there is no way."""
    back: Float32[np.ndarray, "ny nx 2"]
    """Unit vector (x, y) in which the way from each cell to the place begins; 0 where there is no way."""
    way_m: Float32[np.ndarray, "ny nx"]
    """Length of the way [m]; inf where there is none."""
    entry: Int32[np.ndarray, "ny nx"]
    """Flat index, in the part, of the first cell on the way that was not seen yet; -1 if there is none."""


def leads(
    estimate: MapEstimate, place: Float[np.ndarray, "2"], onto: GridFrame, beyond_m: float = 5.0
) -> Leads:
    """Directions of the ways between a place and the cells of a coarser grid.

    Args:
        estimate: The map.
        place: x, y [m].
        onto: The coarser grid.
        beyond_m: How far beyond the map's edge cells are looked at [m].
    """
    frame = estimate.frame
    low = np.array(frame.origin_xy) - beyond_m
    high = frame.to_points(np.array([frame.shape[1], frame.shape[0]])) + beyond_m
    rows, columns, part = onto.window((float(low[0]), float(low[1])), (float(high[0]), float(high[1])))
    shut = filled(estimate, part) >= _FILLED
    iy, ix = (int(i) for i in part.index(place))
    # The robot stands where it stands, whatever the map says.
    shut[max(iy - 1, 0) : iy + 2, max(ix - 1, 0) : ix + 2] = False
    time = march(np.where(shut, 0.0, 1.0), (iy, ix), part.resolution_m)
    out, back = (np.zeros((*part.shape, 2), np.float32) for _ in range(2))
    entry = np.where(share_of(estimate.explored, estimate, part) < _SEEN, np.int32(0), np.int32(-1))
    reached = np.flatnonzero(np.isfinite(time))
    reached = reached[np.argsort(time.ravel()[reached], kind="stable")]
    _hand_on(time, reached, iy, ix, part.resolution_m, out, back, entry)
    _fill_beside(time, reached, out, back)
    entry[~np.isfinite(time)] = -1
    return Leads(rows, columns, out, back, time.astype(np.float32), entry)


def filled(estimate: MapEstimate, part: GridFrame) -> Float32[np.ndarray, "ny nx"]:
    """Part of each cell of a coarser grid that obstacles fill, as known or surely anticipated."""
    stands: Bool[np.ndarray, "ny nx"] = estimate.obstacle
    if estimate.anticipated_probability is not None:
        stands = stands | (~estimate.known_free & (estimate.anticipated_probability > _SURE))
    return share_of(stands, estimate, part)


def share_of(
    holds: Bool[np.ndarray, "my mx"], estimate: MapEstimate, part: GridFrame
) -> Float32[np.ndarray, "ny nx"]:
    """Part of each cell of a coarser grid in which something holds of the map's cells."""
    ny, nx = estimate.frame.shape
    # Both grids have the same axes: rows fall into rows, columns into columns.
    along = np.arange(max(ny, nx)) + 0.5
    of_row, of_column = part.index(estimate.frame.to_points(np.column_stack([along, along])))
    rows, columns = _inside(of_row[:ny], part.shape[0]), _inside(of_column[:nx], part.shape[1])
    shares = np.zeros(part.shape, np.float32)
    if rows.stop > rows.start and columns.stop > columns.start:
        (row, below), (column, left) = _groups(of_row[rows]), _groups(of_column[columns])
        inside = np.ascontiguousarray(holds[rows, columns]).view(np.uint8)
        # Counts of all cells below and to the left: their differences are those of the cells between.
        corners = cv2.integral(inside, sdepth=cv2.CV_32S)[below[:, None], left]
        strips = corners[1:] - corners[:-1]
        share = (estimate.frame.resolution_m / part.resolution_m) ** 2
        shares[row[:, None], column] = share * (strips[:, 1:] - strips[:, :-1])
    return shares


def _groups(numbers: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k1"]]:
    """Which numbers there are among rising ones, and where each of them begins, and an end."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(numbers)) + 1])
    return numbers[begins], np.append(begins, len(numbers))


def _inside(index: Int[np.ndarray, " n"], size: int) -> slice:
    """Which of rising numbers are 0 or more and less than a size."""
    return slice(*np.searchsorted(index, [0, size]).tolist())


@compiled
def _hand_on(
    time: np.ndarray,
    reached: np.ndarray,
    row: int,
    column: int,
    cell_m: float,
    out: np.ndarray,
    back: np.ndarray,
    entry: np.ndarray,
) -> None:
    """Hand the directions in which ways begin on from cell to cell, in the order in which the front came."""
    ny, nx = time.shape
    for i in reached:
        iy, ix = i // nx, i % nx
        dx, dy = (ix - column) * cell_m, (iy - row) * cell_m
        away = math.hypot(dx, dy)
        if away == 0.0:
            entry[iy, ix] = -1
            continue
        least, parent = time[iy, ix], i
        for jy, jx in ((iy, ix - 1), (iy, ix + 1), (iy - 1, ix), (iy + 1, ix)):
            if 0 <= jy < ny and 0 <= jx < nx and time[jy, jx] < least:
                least, parent = time[jy, jx], jy * nx + jx
        before = entry[parent // nx, parent % nx]
        entry[iy, ix] = before if before >= 0 else (i if entry[iy, ix] >= 0 else -1)
        if time[iy, ix] <= max(_BEGIN_CELLS * cell_m, _STRAIGHT * away):
            out[iy, ix, 0], out[iy, ix, 1] = dx / away, dy / away
            back[iy, ix, 0], back[iy, ix, 1] = -dx / away, -dy / away
            continue
        fall_x = fall_y = out_x = out_y = 0.0
        for across in (True, False):
            best, side = np.inf, 0
            for step in (-1, 1):
                jy, jx = (iy, ix + step) if across else (iy + step, ix)
                if 0 <= jy < ny and 0 <= jx < nx and time[jy, jx] < best:
                    best, side = time[jy, jx], step
            fall = time[iy, ix] - best
            if fall > 0:
                jy, jx = (iy, ix + side) if across else (iy + side, ix)
                if across:
                    fall_x = side * fall
                else:
                    fall_y = side * fall
                out_x += fall * out[jy, jx, 0]
                out_y += fall * out[jy, jx, 1]
        size = math.hypot(fall_x, fall_y)
        if size > 0:
            back[iy, ix, 0], back[iy, ix, 1] = fall_x / size, fall_y / size
        size = math.hypot(out_x, out_y)
        if size > 0:
            out[iy, ix, 0], out[iy, ix, 1] = out_x / size, out_y / size


@compiled
def _fill_beside(time: np.ndarray, reached: np.ndarray, out: np.ndarray, back: np.ndarray) -> None:
    """Tell cells that ways go round as the nearest beside them: what hangs at a wall may stand in one."""
    ny, nx = time.shape
    for i in reached:
        iy, ix = i // nx, i % nx
        for jy in range(max(iy - 1, 0), min(iy + 2, ny)):
            for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
                if time[jy, jx] == np.inf and back[jy, jx, 0] == 0.0 and back[jy, jx, 1] == 0.0:
                    out[jy, jx, 0], out[jy, jx, 1] = out[iy, ix, 0], out[iy, ix, 1]
                    back[jy, jx, 0], back[jy, jx, 1] = back[iy, ix, 0], back[iy, ix, 1]
