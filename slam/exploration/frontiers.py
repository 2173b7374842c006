"""Frontiers: borders between seen and unseen cells.

A frontier is a connected run of seen, free cells next to unseen ones; long runs are cut into pieces. The goal is its
middle, and its cost is the least cost of a path to any of its cells. The area visible from there is counted along rays,
as if unknown cells were open; rays leak through the gaps of half-seen walls, so the length of the frontier bounds it.
Reference: Yamauchi, A frontier-based approach for autonomous exploration, CIRA 1997.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from slam.actions import TURN_RAD
from slam.planning.cost_map import Box
from slam.planning.travel_time import TravelTime
from slam.poses import wrap

#: Rays cast to count what can be seen.
RAYS = 60
#: Cells from sample to sample of a ray.
_STEP = 2
#: A line leads on across a frontier if it stays in unseen cells for so long [m].
_AHEAD_M = 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class Frontier:
    """A piece of the border of what was seen."""

    goal_xy: Float[np.ndarray, "2"]
    """Its middle cell [m]: seen itself, next to unseen cells."""
    near_xy: Float[np.ndarray, "2"]
    """Its cell with the cheapest path [m]."""
    cost_m: float
    """Cost of the path there [m]."""
    length_m: float
    """Length of the whole run it belongs to [m]."""

    def turns_from(self, pose: Float[np.ndarray, "3"]) -> float:
        """Turns of a robot at a pose x [m], y [m], yaw [rad] until it faces `near_xy`."""
        x, y = self.near_xy - pose[:2]
        return float(abs(wrap(math.atan2(y, x) - pose[2])) / TURN_RAD)


def find_frontiers(
    box: Box, travel_time: TravelTime, *, min_cells: int, piece_m: float, given_up: Float[np.ndarray, "n 2"]
) -> list[Frontier]:
    """Frontiers that the robot can get near to.

    Args:
        box: Box around the known cells.
        travel_time: Travel time from the robot, on cells of the box or of a multiple of their size.
        min_cells: Shorter runs are ignored [cells].
        piece_m: Side of the tiles that cut long runs into pieces [m].
        given_up: Places (x, y) [m] whose surroundings are ignored.
    """
    edge = _edge(box, given_up)
    label = np.asarray(cv2.connectedComponents(edge.astype(np.uint8), connectivity=8)[1], np.int32)
    cells = np.argwhere(edge)
    run = label[cells[:, 0], cells[:, 1]]
    size = np.bincount(run, minlength=1)
    cells, run = cells[size[run] >= min_cells], run[size[run] >= min_cells]
    if not len(cells):
        return []
    tile = cells // max(1, round(piece_m / box.frame.resolution_m))
    key = (run.astype(np.int64) * 4096 + tile[:, 0]) * 4096 + tile[:, 1]
    order = np.argsort(key, kind="stable")
    cells, new = cells[order], np.diff(key[order], prepend=-1) > 0
    lengths_m = size[run[order]][new] * box.frame.resolution_m
    piece, middle = np.cumsum(new) - 1, _middles(cells, new)
    times = round(travel_time.frame.resolution_m / box.frame.resolution_m)
    cost = travel_time.cost_m[cells[:, 0] // times, cells[:, 1] // times]
    near = cells[_first_least(cost, piece, new)] // times
    goals_xy = box.frame.to_points(middle[:, ::-1] + 0.5)
    frontiers = []
    for k, length_m in enumerate(lengths_m):
        least, place = float(travel_time.cost_m[tuple(near[k])]), near[k]
        if not math.isfinite(least):
            least, place = _cheapest_near(travel_time, middle[k] // times)
        if math.isfinite(least):
            near_xy = travel_time.frame.to_points(place[::-1] + 0.5)
            frontiers.append(
                Frontier(goal_xy=goals_xy[k], near_xy=near_xy, cost_m=least, length_m=float(length_m))
            )
    return frontiers


def _middles(cells: Int[np.ndarray, "n 2"], new: Bool[np.ndarray, " n"]) -> Int[np.ndarray, "k 2"]:
    """The cell (row, column) of each piece that is nearest to its mean; `new` is where a piece begins."""
    piece, starts = np.cumsum(new) - 1, np.flatnonzero(new)
    mean = np.add.reduceat(cells, starts) / np.diff(starts, append=len(cells))[:, None]
    return cells[_first_least(((cells - mean[piece]) ** 2).sum(axis=1), piece, new)]


def _first_least(
    values: Float[np.ndarray, " n"], piece: Int[np.ndarray, " n"], new: Bool[np.ndarray, " n"]
) -> Int[np.ndarray, " k"]:
    """Where each piece has its least value, the first of equals."""
    return np.asarray(np.lexsort((values, piece))[new])


def _cheapest_near(travel_time: TravelTime, cell: Int[np.ndarray, "2"]) -> tuple[float, Int[np.ndarray, "2"]]:
    """Least cost within half a metre of a cell (row, column), and the cell with that cost."""
    # The hull does not fit at walls, but may fit half a metre away.
    n = max(1, round(0.5 / travel_time.frame.resolution_m))
    y0, x0 = np.maximum(cell - n, 0)
    window = travel_time.cost_m[y0 : y0 + 2 * n + 1, x0 : x0 + 2 * n + 1]
    row, column = divmod(int(np.argmin(window)), window.shape[1])
    return float(window.min()), np.array([y0 + row, x0 + column])


def _edge(box: Box, given_up: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "ny nx"]:
    """Seen and free cells next to unseen cells that are no obstacles."""
    unseen = ~box.explored & (box.probability <= 0.5)
    next_to_unseen = cv2.dilate(unseen.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    edge = box.explored & (box.probability < 0.5) & next_to_unseen
    for x, y in given_up:
        rows, columns, _ = box.frame.window((x - 0.25, y - 0.25), (x + 0.25, y + 0.25))
        edge[rows, columns] = False
    return edge


def unseen_area(box: Box, frontier: Frontier, range_m: float, depth_m: float) -> float:
    """Unseen area in sight from a frontier, if what is unknown were open [m^2]."""
    step, cell = _STEP, box.frame.resolution_m
    y, x = (int(v) for v in box.frame.index(frontier.near_xy))
    angle = np.arange(RAYS)[:, None] * (2 * math.pi / RAYS)
    reach = np.arange(step, range_m / cell, step)
    iy = np.rint(y + np.sin(angle) * reach).astype(np.intp)
    ix = np.rint(x + np.cos(angle) * reach).astype(np.intp)
    inside = np.asarray(box.frame.inside(iy, ix))
    iy, ix = np.where(inside, iy, 0), np.where(inside, ix, 0)
    in_sight = np.logical_and.accumulate(~inside | (box.probability[iy, ix] <= 0.5), axis=1)
    new = in_sight & ~(inside & box.explored[iy, ix])
    # Each sample stands for a piece of its ring.
    area = float((new * reach).sum()) * (2 * math.pi / RAYS) * step * cell * cell
    return min(area, frontier.length_m * depth_m)


def lines_across(box: Box, frontiers_xy: Float[np.ndarray, "k 2"], range_m: float) -> Float[np.ndarray, " k"]:
    """Length of the longest straight line over seen floor that leads on across each frontier [m], up to a range."""
    cell_m = box.frame.resolution_m
    rows, columns = box.frame.index(frontiers_xy)
    is_free, is_unseen = box.explored & (box.probability < 0.5), ~box.explored & (box.probability <= 0.5)
    reach, ahead = (math.ceil(length_m / cell_m) for length_m in (range_m, _AHEAD_M))
    return np.asarray(_longest(is_free, is_unseen, rows, columns, reach, ahead) * cell_m)


@compiled
def _longest(
    free: np.ndarray, unseen: np.ndarray, rows: np.ndarray, columns: np.ndarray, reach: int, ahead: int
) -> np.ndarray:
    """Cells of the longest ray from each place through free cells, whose continuation backwards is unseen so far."""
    ny, nx = free.shape
    cells = np.zeros(len(rows))
    for k in range(len(rows)):
        for ray in range(RAYS):
            dy, dx = math.sin(2 * math.pi * ray / RAYS), math.cos(2 * math.pi * ray / RAYS)
            leads_on = True
            for i in range(_STEP, ahead + 1, _STEP):
                iy, ix = round(rows[k] - i * dy), round(columns[k] - i * dx)
                if 0 <= iy < ny and 0 <= ix < nx and not unseen[iy, ix]:
                    leads_on = False
                    break
            for i in range(_STEP, reach if leads_on else 0, _STEP):
                iy, ix = round(rows[k] + i * dy), round(columns[k] + i * dx)
                if not (0 <= iy < ny and 0 <= ix < nx) or not free[iy, ix]:
                    break
                cells[k] = max(cells[k], i)
    return cells
