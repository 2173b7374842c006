"""Order in which frontiers are visited: the one whose gains, discounted by the time until each visit, are largest.

A visit after t decisions is worth its gain times exp(-t / horizon). A small gain nearby is collected first if coming
back for it later takes longer, and a far frontier counts for more if others are near it. Costs between frontiers come
from the one travel-time field of the robot: two paths share their first part, and a straight leg onto the other path
may be shorter. All orders of a few frontiers are compared, by dynamic programming over the sets of visited ones. The
gain is the unseen area in sight; area in sight of several frontiers is divided among them.
Left out: frontiers that appear only after a visit.
References: Held and Karp, A dynamic programming approach to sequencing problems, J. SIAM 10(1), 1962; Blum et al.,
Approximation algorithms for orienteering and discounted-reward TSP, SIAM J. Computing 37(2), 2007.
"""

import math
from itertools import combinations

import numpy as np
from jaxtyping import Float

from robosim.support.compiled import compiled
from slam.planning.cost_map import Box
from slam.planning.paths import downhill
from slam.planning.travel_time import TravelTime

#: Points of each path to which straight legs are tried.
_JUNCTIONS = 10


def values_of_orders(
    gain: Float[np.ndarray, " k"], first: Float[np.ndarray, " k"], between: Float[np.ndarray, "k k"]
) -> Float[np.ndarray, " k"]:
    """Value of the best order that begins with each of k visits.

    Args:
        gain: Gain of each visit, not negative.
        first: Factor by which a gain is discounted on the path from the robot, 0 to 1.
        between: The same from one visit (row) to the next (column).

    Returns:
        Sums of discounted gains, in the unit of the gain. The work grows as 2^k k^2.
    """
    return np.asarray(_values(gain.astype(float), first.astype(float), between.astype(float)))


@compiled
def _values(gain: np.ndarray, first: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Value of each first visit; `rest` is the best value after the visits of a set, the last of which is k."""
    n = len(gain)
    rest = np.zeros((1 << n, n))
    for visited in range((1 << n) - 2, 0, -1):
        for k in range(n):
            if visited >> k & 1:
                for j in range(n):
                    if not visited >> j & 1:
                        value = between[k, j] * (gain[j] + rest[visited | 1 << j, j])
                        rest[visited, k] = max(rest[visited, k], value)
    return np.array([first[k] * (gain[k] + rest[1 << k, k]) for k in range(n)])


def costs_between(travel_time: TravelTime, places: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k k"]:
    """Costs of paths between places (x, y) [m] from which the source is reachable [m of open floor].

    Costs along the paths to the source, or along one straight leg onto the other path; not less than the least costs.
    """
    paths, costs = [], []
    for row, column in zip(*travel_time.frame.index(places), strict=True):
        path = downhill(travel_time, (int(row), int(column)))[::-1]
        paths.append(path)
        costs.append(travel_time.cost_m[travel_time.frame.index(path)])
    samples = [np.linspace(0, len(path) - 1, _JUNCTIONS).astype(int) for path in paths]
    ends = np.concatenate([path[k] for path, k in zip(paths, samples, strict=True)])
    rest = np.concatenate([cost[-1] - cost[k] for cost, k in zip(costs, samples, strict=True)])
    legs = np.array([travel_time.of_legs(path[-1], ends) + rest for path in paths])
    between = legs.reshape(len(paths), len(paths), _JUNCTIONS).min(axis=2)
    between = np.minimum(between, between.T)
    for i, j in combinations(range(len(paths)), 2):
        n = min(len(paths[i]), len(paths[j]))
        same = (paths[i][:n] == paths[j][:n]).all(axis=1)
        shared = n - 1 if same.all() else max(int(np.argmin(same)) - 1, 0)
        along = costs[i][-1] + costs[j][-1] - 2 * costs[i][shared]
        between[i, j] = between[j, i] = min(between[i, j], along)
    np.fill_diagonal(between, 0.0)
    return between


def shared_areas(box: Box, places: Float[np.ndarray, "k 2"], range_m: float) -> Float[np.ndarray, " k"]:
    """Unseen area in sight of each place (x, y) [m], if what is unknown were open [m^2].

    A cell in sight of n places counts 1/n for each of them, so that the sum is the area of all.
    """
    reach = max(2, round(range_m / box.frame.resolution_m))
    rows, columns = box.frame.index(places)
    cells = _shared_cells(box.probability > 0.5, ~box.explored, rows, columns, reach)
    return np.asarray(cells * box.frame.resolution_m**2)


@compiled
def _shared_cells(
    opaque: np.ndarray, unseen: np.ndarray, rows: np.ndarray, columns: np.ndarray, reach: int
) -> np.ndarray:
    """Cells in sight of each place within reach: the first round counts the places of a cell, the second divides."""
    ny, nx = opaque.shape
    n, n_rays = len(rows), int(2 * math.pi * reach)
    count, stamp = np.zeros((ny, nx), np.int16), np.zeros((ny, nx), np.int16)
    cells = np.zeros(n)
    for turn in range(2 * n):
        k = turn % n
        for ray in range(n_rays):
            dx, dy = math.cos(2 * math.pi * ray / n_rays), math.sin(2 * math.pi * ray / n_rays)
            for i in range(1, reach + 1):
                iy, ix = round(rows[k] + i * dy), round(columns[k] + i * dx)
                if not (0 <= iy < ny and 0 <= ix < nx) or opaque[iy, ix]:
                    break
                if unseen[iy, ix] and stamp[iy, ix] != turn + 1:
                    stamp[iy, ix] = turn + 1
                    if turn < n:
                        count[iy, ix] += 1
                    else:
                        cells[k] += 1.0 / count[iy, ix]
    return cells
