"""The nearest wall of a floor plan along a level ray, for each column of a picture.

Walls are segments seen from above. They are sorted into square tiles, and a ray goes from tile to tile until it has met
the nearest wall (Amanatides and Woo, A fast voxel traversal algorithm for ray tracing, Eurographics 1987).
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled

#: Side of the tiles [m].
TILE_M = 0.5
#: Walls extend beyond their ends [parts of their length] and tiles [m], so that no ray slips through a corner.
_BEYOND, _NEAR_M = 1e-9, 1e-6


class WallTiles(NamedTuple):
    """Walls, sorted by place."""

    segments: Float[np.ndarray, "n 4"]
    """x, y of the first end, and from there to the second [m]."""
    corner: Float[np.ndarray, "2"]
    """Lower left corner of the tiles [m]."""
    first: Int[np.ndarray, "nx1 ny"]
    """Start of the list of a tile's walls in `members`; it ends at the start of the next tile's list."""
    members: Int[np.ndarray, " m"]
    """Numbers of walls, tile after tile."""


def wall_tiles(walls: Float[np.ndarray, "n 2 2"]) -> WallTiles:
    """Sort walls, given by both ends [m], into tiles."""
    low, high = walls.min(axis=(0, 1)) - TILE_M, walls.max(axis=(0, 1)) + TILE_M
    nx, ny = (int(count) for count in np.ceil((high - low) / TILE_M))
    segments = np.column_stack([walls[:, 0], walls[:, 1] - walls[:, 0]]).astype(float)
    # A column more than there are tiles, for the end of the last list.
    first = np.zeros((nx + 1, ny), np.int64)
    _sort_in(segments, low, first, np.zeros(0, np.int64))
    flat = first.ravel()
    flat[:] = np.concatenate([[0], np.cumsum(flat)[:-1]])
    members = np.empty(int(flat[-1]), np.int64)
    _sort_in(segments, low, first.copy(), members)
    return WallTiles(segments, low, first, members)


@compiled
def _sort_in(
    segments: Float[np.ndarray, "n 4"],
    low: Float[np.ndarray, "2"],
    first: Int[np.ndarray, "nx1 ny"],
    members: Int[np.ndarray, " m"],
) -> None:
    """Count the walls of each tile into `first`; if `members` has room, put their numbers there from `first` on."""
    counting = len(members) == 0
    for number in range(len(segments)):
        ax, ay, ux, uy = segments[number]
        length = max(math.hypot(ux, uy), 1e-12)
        half = TILE_M * (abs(ux) + abs(uy)) / length / 2 + _NEAR_M
        x0 = int((min(ax, ax + ux) - _NEAR_M - low[0]) // TILE_M)
        x1 = int((max(ax, ax + ux) + _NEAR_M - low[0]) // TILE_M)
        y0 = int((min(ay, ay + uy) - _NEAR_M - low[1]) // TILE_M)
        y1 = int((max(ay, ay + uy) + _NEAR_M - low[1]) // TILE_M)
        for ix in range(x0, x1 + 1):
            for iy in range(y0, y1 + 1):
                mx, my = low[0] + (ix + 0.5) * TILE_M, low[1] + (iy + 0.5) * TILE_M
                if abs((mx - ax) * uy - (my - ay) * ux) / length > half:
                    continue
                if not counting:
                    members[first[ix, iy]] = number
                first[ix, iy] += 1


@compiled
def nearest_wall(
    walls: WallTiles, x: float, y: float, dx: float, dy: float, reach: float
) -> tuple[float, int]:
    """Where a ray from (x, y) [m] first meets a wall, looking `reach` lengths of its direction far.

    Returned are the distance in lengths of the direction, inf for none, and the number of the wall, -1 for none.
    """
    segments, corner, members = walls.segments, walls.corner, walls.members
    nx, ny = walls.first.shape[0] - 1, walls.first.shape[1]
    px, py = (x - corner[0]) / TILE_M, (y - corner[1]) / TILE_M
    ix, iy = math.floor(px), math.floor(py)
    sx, sy = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    step_x = TILE_M / abs(dx) if dx != 0 else math.inf
    step_y = TILE_M / abs(dy) if dy != 0 else math.inf
    next_x = ((ix + 1 - px) if dx > 0 else (px - ix)) * step_x if dx != 0 else math.inf
    next_y = ((iy + 1 - py) if dy > 0 else (py - iy)) * step_y if dy != 0 else math.inf
    best, nearest = math.inf, -1
    flat = walls.first.ravel()
    while 0 <= ix < nx and 0 <= iy < ny:
        tile = ix * ny + iy
        for m in range(flat[tile], flat[tile + 1]):
            wall = members[m]
            ax, ay, ux, uy = segments[wall, 0], segments[wall, 1], segments[wall, 2], segments[wall, 3]
            cross = dx * uy - dy * ux
            if cross == 0.0:
                continue
            wx, wy = ax - x, ay - y
            t = (wx * uy - wy * ux) / cross
            s = (wx * dy - wy * dx) / cross
            if 0.0 <= t < best and -_BEYOND <= s <= 1.0 + _BEYOND:
                best, nearest = t, wall
        leave = min(next_x, next_y)
        if best <= leave or leave > reach:
            break
        if next_x < next_y:
            ix += sx
            next_x += step_x
        else:
            iy += sy
            next_y += step_y
    if best > reach:
        return math.inf, -1
    return best, nearest
