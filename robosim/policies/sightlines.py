"""Rays over a partly known map: cells in sight of a place, origins of waves that interacted once, walls between places.

Cells of the map are unknown, free or obstacles; beyond its edge all is unknown. Results are on a coarser grid. Loops
are compiled at their first use.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from robosim.support.compiled import compiled
from slam.grid import GridFrame, MapEstimate

UNKNOWN, FREE, OBSTACLE = 0, 1, 2
#: Bit of free cells next to an obstacle, where a wave may bend or be reflected.
NEXT_TO = 4
#: Directions of departure that are tried where none is known.
_ALL_ROUND = 72


class Knowledge(NamedTuple):
    """A map for rays."""

    frame: GridFrame
    kind: UInt8[np.ndarray, "ny nx"]


def knowledge(estimate: MapEstimate, next_to_m: float) -> Knowledge:
    """The map for rays; free cells within a distance [m] of an obstacle are marked `NEXT_TO`."""
    probability = np.asarray(estimate.obstacle_probability)
    obstacle, kind = probability > 0.5, (probability < 0.5) * np.uint8(FREE)
    kind[obstacle] = OBSTACLE
    n = 2 * round(next_to_m / estimate.frame.resolution_m) + 1
    near = cv2.dilate(obstacle.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (n, n)))
    kind |= NEXT_TO * (near & (kind == FREE))
    return Knowledge(estimate.frame, kind)


def in_sight(
    known: Knowledge,
    place: Float[np.ndarray, "2"],
    onto: GridFrame,
    reach_m: float,
    *,
    through_unknown: bool,
    within: Bool[np.ndarray, "ny nx"] | None = None,
) -> Bool[np.ndarray, "ny nx"]:
    """Cells of a coarser grid within reach [m] in sight of a place [m]: surely, or possibly, through unknown cells.

    Rays end where they leave the cells `within`, if given.
    """
    seen = np.zeros(onto.shape, bool)
    within = np.ones(onto.shape, bool) if within is None else within
    n_rays = math.ceil(2 * math.pi * reach_m / onto.resolution_m)
    lattices = _lattice(known.frame), _lattice(onto)
    _sweep(known.kind, *lattices, place[0], place[1], reach_m, n_rays, through_unknown, within, seen)
    return seen


def bent_origins(
    known: Knowledge,
    place: Float[np.ndarray, "2"],
    aoa_rad: float,
    aod_rad: float | None,
    spread_rad: float,
    friis_m: float,
    onto: GridFrame,
) -> Float32[np.ndarray, "ny nx"]:
    """Weights of cells from which a wave with one interaction may have departed to a place [m].

    The interaction is at a point along the arrival, next to an obstacle or in an unknown cell. It loses up to 45 dB, so
    the path is at most as long as that of a free wave of the same power (`friis_m`). The departure has a standard
    deviation `spread_rad`, or is unknown (None).
    """
    weight = np.zeros(onto.shape, np.float32)
    spread = np.arange(-4, 5) / 2  # in standard deviations
    leaving = np.linspace(0, 2 * math.pi, _ALL_ROUND, endpoint=False)
    share = np.ones(_ALL_ROUND)
    if aod_rad is not None:
        leaving, share = aod_rad + spread * spread_rad, np.exp(-0.5 * spread**2)
    lattices = _lattice(known.frame), _lattice(onto)
    _bend(known.kind, *lattices, place[0], place[1], aoa_rad, leaving, share, friis_m, weight)
    return weight


def count_walls(
    obstacle: Bool[np.ndarray, "ny nx"], starts: Float[np.ndarray, "n 2"], ends: Float[np.ndarray, "m 2"]
) -> UInt8[np.ndarray, "n m"]:
    """Number of obstacles, however thick, on the straight lines from each start to each end, at most 255.

    Points are continuous cell coordinates (column, row), and may lie outside the grid, where there are no obstacles.
    """
    number = np.zeros((len(starts), len(ends)), np.uint8)
    _count(np.ascontiguousarray(obstacle), np.asarray(starts, float), np.asarray(ends, float), number)
    return number


def _lattice(frame: GridFrame) -> tuple[float, float, float]:
    """Corner and cell of a grid, for compiled loops."""
    return float(frame.origin_xy[0]), float(frame.origin_xy[1]), frame.resolution_m


@compiled
def _cell(lattice: tuple[float, float, float], x: float, y: float) -> tuple[int, int]:
    """Row and column of a point's cell, perhaps outside the grid.

    Compiled loops that pass arrays to functions take six times as long.
    """
    return math.floor((y - lattice[1]) / lattice[2]), math.floor((x - lattice[0]) / lattice[2])


@compiled
def _sweep(
    kind: np.ndarray,
    fine: tuple[float, float, float],
    coarse: tuple[float, float, float],
    x: float,
    y: float,
    reach_m: float,
    rays: int,
    through_unknown: bool,
    within: np.ndarray,
    seen: np.ndarray,
) -> None:
    cell = fine[2]
    steps = int(reach_m / cell)
    (ny, nx), (nv, nu) = kind.shape, seen.shape
    for r in range(rays):
        dx, dy = math.cos(2 * math.pi * r / rays), math.sin(2 * math.pi * r / rays)
        for i in range(steps):
            px, py = x + i * cell * dx, y + i * cell * dy
            iy, ix = _cell(fine, px, py)
            here = kind[iy, ix] if 0 <= iy < ny and 0 <= ix < nx else UNKNOWN
            if here == OBSTACLE or (here == UNKNOWN and not through_unknown):
                break
            iv, iu = _cell(coarse, px, py)
            if not (0 <= iv < nv and 0 <= iu < nu and within[iv, iu]):
                break
            seen[iv, iu] = True


@compiled
def _bend(
    kind: np.ndarray,
    fine: tuple[float, float, float],
    coarse: tuple[float, float, float],
    x: float,
    y: float,
    aoa: float,
    leaving: np.ndarray,
    shares: np.ndarray,
    friis_m: float,
    weight: np.ndarray,
) -> None:
    step = 2 * fine[2]
    (ny, nx), (nv, nu) = kind.shape, weight.shape
    into = 0  # samples inside the obstacle that ends the ray
    for i in range(2, int(min(friis_m, 20.0) / step)):
        t = i * step
        cx, cy = x + t * math.cos(aoa), y + t * math.sin(aoa)
        iy, ix = _cell(fine, cx, cy)
        here = kind[iy, ix] if 0 <= iy < ny and 0 <= ix < nx else UNKNOWN
        if here == FREE:
            continue
        if here == OBSTACLE:
            into += 1
            if into > 2:
                break
        share = 0.3 if here == UNKNOWN else 1.0
        last = int((friis_m - t) / step)
        # The loss at the point decreases along the path from it.
        first = 1
        while first < last and 20 * math.log10(friis_m / (t + first * step)) > 45:
            first += 1
        for k in range(len(leaving)):
            dx, dy = -math.cos(leaving[k]), -math.sin(leaving[k])
            w = share * shares[k]
            for j in range(1, last):
                s = j * step
                px, py = cx + s * dx, cy + s * dy
                # The first steps leave the surface.
                if s > 0.3:
                    iy, ix = _cell(fine, px, py)
                    if 0 <= iy < ny and 0 <= ix < nx and kind[iy, ix] == OBSTACLE:
                        break
                if j < first:
                    continue
                iv, iu = _cell(coarse, px, py)
                if not (0 <= iv < nv and 0 <= iu < nu):
                    break
                weight[iv, iu] += w


@compiled
def _count(obstacle: np.ndarray, starts: np.ndarray, ends: np.ndarray, number: np.ndarray) -> None:
    ny, nx = obstacle.shape
    for i in range(len(starts)):
        for j in range(len(ends)):
            dx, dy = ends[j, 0] - starts[i, 0], ends[j, 1] - starts[i, 1]
            steps = max(math.ceil(math.hypot(dx, dy)), 1)
            inside = False
            for k in range(steps + 1):
                ix = math.floor(starts[i, 0] + k / steps * dx)
                iy = math.floor(starts[i, 1] + k / steps * dy)
                here = 0 <= iy < ny and 0 <= ix < nx and obstacle[iy, ix]
                if here and not inside and number[i, j] < 255:
                    number[i, j] += 1
                inside = here
