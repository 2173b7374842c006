"""Frontiers: where what the camera has seen borders on what it has not, and from where to look beyond.

A frontier is a piece, two metres across at most, of the seen and free cells beside unseen ones. A robot need not go
there: it is enough to stand where the unseen side is in sight. Rays cast back from there over free cells find
the cheapest such place on a travel-time field from the robot. What could be seen from the frontier is counted along
rays as well; unknown space counts less the deeper it lies, because a wall will come.
Reference: Yamauchi, CIRA 1997; gain of a view after Gonzalez-Banos and Latombe, IJRR 21(10-11), 2002.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from slam.cost_map import Box
from slam.travel_time import TravelTime

#: Size of the tiles that cut long frontiers into pieces [m].
PIECE_M = 1.6
RAYS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class Frontier:
    """A piece of the border of what was seen."""

    look: tuple[int, int]
    """Row and column in the box of an unseen cell beside the middle of the piece."""
    cells: int
    """Length of the piece [cells]."""
    near_cost_m: float
    """Cost of the way to somewhere within a metre of it [m]: a guess that needs no rays."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A place from which a frontier can be looked at."""

    stand_xy: Float[np.ndarray, "2"]
    """Where to stand [m]."""
    look_xy: Float[np.ndarray, "2"]
    """Where to look [m]."""
    cost_m: float
    """Cost of the way there [m]."""


def find_frontiers(
    box: Box, way: TravelTime, min_cells: int, given_up: Float[np.ndarray, "n 2"]
) -> list[Frontier]:
    """Frontiers that the robot can get near to, the cheapest first.

    Args:
        box: What is known.
        way: Cost of ways from the robot, on cells twice as large as those of the box.
        min_cells: Borders shorter than this are ignored [cells].
        given_up: Places (x, y) [m] whose surroundings are ignored.
    """
    unseen = ~box.explored & (box.probability <= 0.5)
    beside = cv2.dilate(unseen.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    edge = box.explored & (box.probability < 0.5) & beside
    for x, y in given_up:
        rows, columns, _ = box.frame.window((x - 0.25, y - 0.25), (x + 0.25, y + 0.25))
        edge[rows, columns] = False
    label = cv2.connectedComponents(edge.astype(np.uint8), connectivity=8)[1]
    iy, ix = np.nonzero(edge)
    if not len(iy):
        return []
    size = np.bincount(label[iy, ix])
    big = size[label[iy, ix]] >= min_cells
    iy, ix = iy[big], ix[big]
    tile = max(1, round(PIECE_M / box.frame.resolution_m))
    key = (label[iy, ix] * 4096 + iy // tile) * 4096 + ix // tile
    order = np.argsort(key, kind="stable")
    pieces = np.split(np.column_stack([iy, ix])[order], np.flatnonzero(np.diff(key[order])) + 1)
    cost = _cost_nearby(way)
    found = [_frontier(piece, unseen, cost) for piece in pieces if len(piece)]
    return sorted((f for f in found if math.isfinite(f.near_cost_m)), key=lambda f: f.near_cost_m)


def _cost_nearby(way: TravelTime) -> Float[np.ndarray, "ny nx"]:
    """Least cost within a metre of each large cell; inf where there is no way."""
    cells = round(1.0 / way.frame.resolution_m)
    cost = np.where(np.isfinite(way.cost_m), way.cost_m, 1e6).astype(np.float32)
    cost = cv2.erode(cost, np.ones((2 * cells + 1, 2 * cells + 1), np.uint8))
    return np.where(cost < 1e6, cost, np.inf)


def _frontier(
    piece: Int[np.ndarray, "n 2"],
    unseen: Bool[np.ndarray, "ny nx"],
    cost: Float[np.ndarray, "my mx"],
) -> Frontier:
    middle = piece[int(np.argmin(((piece - piece.mean(axis=0)) ** 2).sum(axis=1)))]
    y0, x0 = max(int(middle[0]) - 1, 0), max(int(middle[1]) - 1, 0)
    ys, xs = np.nonzero(unseen[y0 : middle[0] + 2, x0 : middle[1] + 2])
    look = (int(ys[0]) + y0, int(xs[0]) + x0)
    return Frontier(look=look, cells=len(piece), near_cost_m=float(cost[look[0] // 2, look[1] // 2]))


def _rays(
    box: Box, start: tuple[int, int], range_m: float, step: int
) -> tuple[Int[np.ndarray, "k n"], Int[np.ndarray, "k n"], Bool[np.ndarray, "k n"]]:
    """Rows and columns of cells along rays from a cell, and which of them lie in the box."""
    angle = np.arange(RAYS) * (2 * math.pi / RAYS)
    reach = np.arange(step, range_m / box.frame.resolution_m, step)
    iy = np.rint(start[0] + np.sin(angle)[:, None] * reach).astype(np.intp)
    ix = np.rint(start[1] + np.cos(angle)[:, None] * reach).astype(np.intp)
    inside = box.frame.inside(iy, ix)
    return np.where(inside, iy, 0), np.where(inside, ix, 0), inside


def best_view(box: Box, way: TravelTime, frontier: Frontier, range_m: float) -> View | None:
    """The cheapest place from which the unseen side of a frontier is in sight.

    Args:
        box: What is known.
        way: Cost of ways from the robot, on cells twice as large as those of the box.
        frontier: The frontier.
        range_m: Largest distance to look from [m].

    Returns:
        The place, or None if the robot cannot get to one.
    """
    iy, ix, inside = _rays(box, frontier.look, range_m, 2)
    free = inside & (box.probability[iy, ix] < 0.5)
    # Beside the frontier itself little is known yet.
    free[:, :1] |= inside[:, :1] & (box.probability[iy[:, :1], ix[:, :1]] <= 0.5)
    in_sight = np.logical_and.accumulate(free, axis=1)
    cost = np.where(in_sight, way.cost_m[iy // 2, ix // 2], np.inf)
    k = int(np.argmin(cost))
    least = float(cost.flat[k])
    if not math.isfinite(least):
        return None
    spots = np.array([[ix.flat[k], iy.flat[k]], frontier.look[::-1]])
    stand, look = box.frame.to_points(spots + 0.5)
    return View(stand_xy=stand, look_xy=look, cost_m=least)


def unseen_by_bearing(
    box: Box, start: Float[np.ndarray, "2"], range_m: float, depth_m: float
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Unseen area in sight from a place, bearing by bearing.

    Args:
        box: What is known.
        start: The place (x, y) [m].
        range_m: How far the camera sees [m].
        depth_m: Depth of unknown space at which the chance that no wall has come falls to 1/e [m].

    Returns:
        Area [m^2] in each of `RAYS` sectors, the first around bearing 0, and the distance [m] at which the unseen begins;
        inf where all is seen.
    """
    step = 2
    y, x = (int(v) for v in box.frame.index(start))
    iy, ix, inside = _rays(box, (y, x), range_m, step)
    probability = np.where(inside, box.probability[iy, ix], 0.5)
    open_ = np.logical_and.accumulate(probability <= 0.5, axis=1)
    cell = box.frame.resolution_m
    unknown_m = np.cumsum(probability == 0.5, axis=1) * step * cell
    new = open_ & ~(inside & box.explored[iy, ix])
    distance = np.arange(1, iy.shape[1] + 1) * step * cell
    # Each sample stands for a piece of its ring.
    piece = distance * (2 * math.pi / RAYS) * step * cell
    area = (np.exp(-unknown_m / depth_m) * new * piece).sum(axis=1)
    return area, np.where(new, distance, np.inf).min(axis=1)


def in_sight(box: Box, start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"]) -> bool:
    """Whether nothing known stands between two points (x, y) [m]."""
    n = max(2, math.ceil(math.hypot(*(end - start)) / box.frame.resolution_m))
    iy, ix = box.frame.index(start + (end - start) * (np.arange(n) / n)[:, None])
    inside = box.frame.inside(iy, ix)
    return bool((box.probability[iy[inside], ix[inside]] <= 0.5).all())
