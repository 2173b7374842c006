"""Routes between the robot and all places around: the directions in which they begin and end.

A wave around corners comes through the same doors as a robot: it arrives from about where the shortest route to its
source begins, and departs to about where the route from there begins. Fast marching finds both for all cells of a grid,
through known free and unknown cells, around obstacles that are known or anticipated with confidence.
"""

import math
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32
from scipy.special import expit

from robosim.policies.sightlines import FREE, OBSTACLE, Knowledge, knowledge
from robosim.support.compiled import compiled
from slam.grid import GridFrame, MapEstimate
from slam.planning.marching import ONE, ZERO, march

#: Free cells this near to an obstacle may bend or reflect a wave [m].
_NEXT_TO_M = 0.2
#: Anticipated obstacles count from this probability on: with less, unseen doors would be closed.
_SURE = 0.9
#: Share of a cell that obstacles must fill to block it: less than a wall of one cell of the map, anywhere in it, fills.
BLOCKING = 0.12
#: Share of a cell that must be explored for the cell to count as explored.
_SEEN = 0.5
#: Speed in explored cells of routes that are measured in unexplored ones only.
_NEARLY_FREE = 1e3
#: Logarithm of the odds of reception out of sight, and its slopes over the logarithms of the route's length, of its
#: excess over the straight line, and of its unexplored part, each with so many metres more or at least: fitted to
#: 16,700 places of targets in nine generated buildings of 100 to 5,000 m2 (decision record 41).
_RECEIVED, _AT_LEAST_M, _LEAST_BEND_M, _LEAST_UNEXPLORED_M = (3.54, -3.11, -1.5, -0.81), 0.1, 0.05, 0.3
#: Routes begin straight for so many cells.
_BEGIN_CELLS = 4.0
#: A route at most this much longer than the straight line counts as straight.
_STRAIGHT = 1.02


class RouteDirections(NamedTuple):
    """Directions of the shortest routes between a place and the cells of a part of a grid."""

    rows: slice
    """Rows of the part."""
    columns: slice
    """Columns of the part."""
    out: Float32[np.ndarray, "ny nx 2"]
    """Unit vector (x, y) in which the route from the place to each cell begins; 0 without a route."""
    back: Float32[np.ndarray, "ny nx 2"]
    """Unit vector (x, y) in which the route from each cell to the place begins; 0 without a route."""
    length_m: Float32[np.ndarray, "ny nx"]
    """Length of the route [m]; inf without one."""
    entry: Int32[np.ndarray, "ny nx"]
    """Flat index, in the part, of the first unexplored cell on the route; -1 if there is none."""

    def unexplored_m(self) -> Float32[np.ndarray, "ny nx"]:
        """Length of the route from its first unexplored cell on [m]; 0 if there is none."""
        is_reached = self.entry >= 0
        unexplored_m = np.zeros_like(self.length_m)
        unexplored_m[is_reached] = self.length_m[is_reached] - self.length_m.ravel()[self.entry[is_reached]]
        return unexplored_m

    def received(self, straight_m: Float[np.ndarray, "ny nx"]) -> Float32[np.ndarray, "ny nx"]:
        """Probability that a transmitter out of sight, in each cell at a distance [m], is received at 28 GHz."""
        length_m = np.maximum(self.length_m, _AT_LEAST_M)
        bend = np.log10(np.maximum(length_m - straight_m, 0) + _LEAST_BEND_M)
        unexplored = np.log10(self.unexplored_m() + _LEAST_UNEXPLORED_M)
        constant, *slopes = _RECEIVED
        odds = constant + slopes[0] * np.log10(length_m) + slopes[1] * bend + slopes[2] * unexplored
        return expit(odds).astype(np.float32)


class MapSurvey:
    """Results of one decision's map over a grid, computed when they are first needed."""

    def __init__(self, estimate: MapEstimate, frame: GridFrame, beyond_m: float = 5.0) -> None:
        """To be used before the map changes; routes lead so far beyond its edge."""
        self.estimate, self.frame, self.beyond_m = estimate, frame, beyond_m
        self._routes: tuple[bytes, RouteDirections] | None = None
        self._shares: tuple[GridFrame, Float32[np.ndarray, "2 ny nx"]] | None = None

    @cached_property
    def known(self) -> Knowledge:
        """The map for rays."""
        return knowledge(self.estimate, next_to_m=_NEXT_TO_M)

    def routes(self, place: Float[np.ndarray, "2"]) -> RouteDirections:
        """Routes between a place [m] and the cells; routes of the last place are cached."""
        key = np.asarray(place, float).tobytes()
        if self._routes is None or self._routes[0] != key:
            self._routes = key, route_directions(self, place)
        return self._routes[1]

    def routes_past_frontiers(
        self, place: Float[np.ndarray, "2"], blocking: float = BLOCKING
    ) -> RouteDirections:
        """Routes that are nearly free through explored cells: they enter others at the frontier next to their end."""
        return route_directions(self, place, explored_speed=_NEARLY_FREE, blocking=blocking)

    def shares(self, frame: GridFrame) -> Float32[np.ndarray, "2 ny nx"]:
        """Explored share and filled share of each cell of a part of the grid; those of the last part are cached."""
        if self._shares is None or self._shares[0] != frame:
            kind, anticipated = self.known.kind, self.estimate.anticipated_probability
            filled = kind == OBSTACLE
            if anticipated is not None:
                filled |= ((kind & FREE) == 0) & (anticipated > _SURE)
            masks = self.estimate.explored, filled
            self._shares = frame, np.stack([cell_shares(mask, self.estimate, frame) for mask in masks])
        return self._shares[1]


def route_directions(
    survey: MapSurvey,
    place: Float[np.ndarray, "2"],
    explored_speed: float = 1.0,
    blocking: float = BLOCKING,
) -> RouteDirections:
    """Routes between a place [m] and the cells of the survey's grid, on the map and some metres beyond its edge.

    Explored cells count as so many times shorter than others; obstacles block a cell if they fill this share of it.
    """
    frame = survey.estimate.frame
    low = np.array(frame.origin_xy) - survey.beyond_m
    high = frame.to_points(np.array([frame.shape[1], frame.shape[0]])) + survey.beyond_m
    rows, columns, frame = survey.frame.window((low[0], low[1]), (high[0], high[1]))
    explored, filled = survey.shares(frame)
    blocked = filled >= blocking
    # A robot beyond the largest grid of a belief counts as at its edge.
    iy, ix = (min(max(int(i), 0), n - 1) for i, n in zip(frame.index(place), frame.shape, strict=True))
    # The robot's own cells are free, whatever the map contains.
    blocked[max(iy - 1, 0) : iy + 2, max(ix - 1, 0) : ix + 2] = False
    order = np.empty(blocked.size, np.uint32)
    speed = ~blocked
    if explored_speed != 1.0:
        speed = np.where(explored >= _SEEN, explored_speed, 1.0) * speed
    time = march(speed, (iy, ix), frame.resolution_m, order)
    reached = order[: np.count_nonzero(np.isfinite(time))]
    out, back = (np.zeros((*frame.shape, 2), np.float32) for _ in range(2))
    entry = np.where(explored < _SEEN, np.int32(0), np.int32(-1))
    flat = (out.reshape(-1, 2), back.reshape(-1, 2), entry.ravel())
    shape = np.uint64(frame.shape[0]), np.uint64(frame.shape[1])
    _propagate(time.ravel(), reached, shape, (iy, ix), frame.resolution_m, *flat)
    is_closed = ~np.isfinite(time)
    is_adjacent = cv2.dilate(is_closed.astype(np.uint8), np.ones((3, 3), np.uint8)).ravel() > 0
    _fill_neighbours(time, reached[is_adjacent[reached]].astype(int), out, back)
    entry[is_closed] = -1
    return RouteDirections(rows, columns, out, back, time.astype(np.float32), entry)


def cell_shares(
    mask: Bool[np.ndarray, "my mx"], estimate: MapEstimate, frame: GridFrame
) -> Float32[np.ndarray, "ny nx"]:
    """Share of each cell of a coarser grid in which a mask of the map's cells is true."""
    ny, nx = estimate.frame.shape
    # The two grids have the same axes.
    along = np.arange(max(ny, nx)) + 0.5
    of_row, of_column = frame.index(estimate.frame.to_points(np.column_stack([along, along])))
    rows, columns = _inside(of_row[:ny], frame.shape[0]), _inside(of_column[:nx], frame.shape[1])
    shares = np.zeros(frame.shape, np.float32)
    if rows.stop > rows.start and columns.stop > columns.start:
        (row, below), (column, left) = _groups(of_row[rows]), _groups(of_column[columns])
        inside = np.ascontiguousarray(mask[rows, columns]).view(np.uint8)
        # Counts of all cells below and to the left: their differences are those of the cells between.
        corners = cv2.integral(inside, sdepth=cv2.CV_32S)[below[:, None], left]
        strips = corners[1:] - corners[:-1]
        share = (estimate.frame.resolution_m / frame.resolution_m) ** 2
        shares[row[:, None], column] = share * (strips[:, 1:] - strips[:, :-1])
    return shares


def _groups(numbers: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k1"]]:
    """The distinct values of rising numbers, and where each of them begins, and the end."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(numbers)) + 1])
    return numbers[begins], np.append(begins, len(numbers))


def _inside(index: Int[np.ndarray, " n"], size: int) -> slice:
    """The part of rising numbers from 0 to less than a size."""
    return slice(*np.searchsorted(index, [0, size]).tolist())


@compiled
def _propagate(
    time: np.ndarray,
    reached: np.ndarray,
    shape: tuple[np.uint64, np.uint64],
    source: tuple[int, int],
    cell_m: float,
    out: np.ndarray,
    back: np.ndarray,
    entry: np.ndarray,
) -> None:
    """Propagate the directions in which routes begin from cell to cell, in the order of the front; flat arrays."""
    ny, nx = shape
    for cell in reached:
        i = np.uint64(cell)
        iy = i // nx
        ix = i - iy * nx
        dx, dy = (np.int64(ix) - source[1]) * cell_m, (np.int64(iy) - source[0]) * cell_m
        distance = math.hypot(dx, dy)
        if distance == 0.0:
            entry[i] = -1
            continue
        west = time[i - ONE] if ix > ZERO else np.inf
        east = time[i + ONE] if ix + ONE < nx else np.inf
        below = time[i - nx] if iy > ZERO else np.inf
        above = time[i + nx] if iy + ONE < ny else np.inf
        # The side from which the front comes on each axis, and how much earlier it is there.
        first_x, first_y = min(west, east), min(below, above)
        side_x = i + ONE if east < west or ix == ZERO else i - ONE
        side_y = i + nx if above < below or iy == ZERO else i - nx
        fall_x, fall_y = time[i] - first_x, time[i] - first_y
        if fall_x > 0 or fall_y > 0:
            before = entry[side_x if first_x <= first_y else side_y]
            entry[i] = before if before >= 0 else (cell if entry[i] >= 0 else -1)
        if time[i] <= max(_BEGIN_CELLS * cell_m, _STRAIGHT * distance):
            x, y = dx / distance, dy / distance
            out[i, 0], out[i, 1] = x, y
            back[i, 0], back[i, 1] = -x, -y
            continue
        out_x = out_y = back_x = back_y = 0.0
        if fall_x > 0:
            back_x = fall_x if side_x > i else -fall_x
            out_x += fall_x * out[side_x, 0]
            out_y += fall_x * out[side_x, 1]
        if fall_y > 0:
            back_y = fall_y if side_y > i else -fall_y
            out_x += fall_y * out[side_y, 0]
            out_y += fall_y * out[side_y, 1]
        size = math.hypot(back_x, back_y)
        if size > 0:
            back[i, 0], back[i, 1] = back_x / size, back_y / size
        size = math.hypot(out_x, out_y)
        if size > 0:
            out[i, 0], out[i, 1] = out_x / size, out_y / size


@compiled
def _fill_neighbours(time: np.ndarray, reached: np.ndarray, out: np.ndarray, back: np.ndarray) -> None:
    """Copy directions into blocked cells next to reached ones, in their order: a thing at a wall may lie in one."""
    ny, nx = time.shape
    for i in reached:
        iy, ix = i // nx, i % nx
        for jy in range(max(iy - 1, 0), min(iy + 2, ny)):
            for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
                if time[jy, jx] == np.inf and back[jy, jx, 0] == 0.0 and back[jy, jx, 1] == 0.0:
                    out[jy, jx, 0], out[jy, jx, 1] = out[iy, ix, 0], out[iy, ix, 1]
                    back[jy, jx, 0], back[jy, jx, 1] = back[iy, ix, 0], back[iy, ix, 1]
