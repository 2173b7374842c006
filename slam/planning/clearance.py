"""Distance from any point to the nearest obstacle, to better than a cell.

Distances are measured to the surface inside each obstacle cell, where a mapper knows it, or else to its centre: in a
doorway 5 cm wider than the hull this decides whether the robot passes. For points, the obstacle cells within the
largest possible distance are searched, as they are around a polygon. For whole maps a distance transform suffices,
except where the hull just fits or just does not: there the obstacles around are searched too. Distances are clipped to
`LIMIT_M`.
Reference: Borgefors, Distance transformations in digital images, CVGIP 34, 1986.
"""

from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from robosim.support.compiled import compiled
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull

#: Largest distance reported [m]; more than any hull needs.
LIMIT_M = 0.4


#: Obstacle cells, steps of a king to the nearest one, surfaces in them, and corner x, y and side of cells [m].
Surfaces = tuple[np.ndarray, np.ndarray, np.ndarray, tuple[float, float, float]]


class Clearance:
    """Distance to the nearest obstacle within a window of the map."""

    def __init__(
        self,
        frame: GridFrame,
        obstacle: Bool[np.ndarray, "ny nx"],
        offset_m: Float32[np.ndarray, "ny nx 2"] | None = None,
    ):
        """Prepare a window; `offset_m` is from the centre of each obstacle cell to its surface, 0 if None."""
        self.frame = frame
        self._obstacle = obstacle
        self._offset_m = np.zeros((*frame.shape, 2), np.float32) if offset_m is None else offset_m

    @cached_property
    def _steps(self) -> UInt8[np.ndarray, "ny nx"]:
        """Steps of a king from each cell to the nearest obstacle."""
        return _steps(self._obstacle)

    @cached_property
    def surfaces(self) -> Surfaces:
        """Surfaces as arguments of the compiled loops."""
        (x, y), cell_m = self.frame.origin_xy, self.frame.resolution_m
        return self._obstacle, self._steps, self._offset_m, (float(x), float(y), float(cell_m))

    @classmethod
    def around(cls, estimate: MapEstimate, half_side_m: float, bumps: bool = True) -> "Clearance":
        """Clearance in a square window of a map estimate around the robot."""
        x, y, _ = estimate.pose
        r = half_side_m
        rows, columns, frame = estimate.frame.window((x - r, y - r), (x + r, y + r))
        obstacle = estimate.obstacle_probability[rows, columns] > 0.5
        if bumps:
            obstacle |= estimate.blocked[rows, columns]
        offset = None if estimate.surface_offset_m is None else estimate.surface_offset_m[rows, columns]
        return cls(frame, obstacle, offset)

    def at(self, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch"]:
        """Distance [m] from points (x, y) [m] to the nearest obstacle of the window, at most `LIMIT_M`."""
        every = np.asarray(points, float).reshape(-1, 2)
        gap = np.empty(len(every))
        _gaps(every, *self.surfaces, LIMIT_M, gap)
        return gap.reshape(np.shape(points)[:-1])

    def space(
        self,
        hull: Hull,
        points: Float[np.ndarray, "*batch 2"],
        yaw: float | Float[np.ndarray, "*batch"],
    ) -> Float[np.ndarray, "*batch"]:
        """Distance [m] of a hull at points (x, y) [m] and headings [rad] from the nearest obstacle.

        At most `LIMIT_M`, of a disk less its radius. Negative where an obstacle lies inside: of a polygon, minus the
        shortest move of one side that would let it out.
        """
        if not hull.outline_m:
            return np.asarray(self.at(points) - hull.radius_m)
        points = np.asarray(points, float)
        poses = np.concatenate([points, np.broadcast_to(yaw, points.shape[:-1])[..., None]], axis=-1)
        every = poses.reshape(-1, 3)
        gap = np.empty(len(every))
        _gaps_of_outline(every, hull.corners, self.surfaces, LIMIT_M, gap)
        return gap.reshape(points.shape[:-1])

    def free_run_m(
        self,
        start: Float[np.ndarray, "2"],
        headings: Float[np.ndarray, " k"],
        hull: Hull,
        space_m: float = 0.0,
    ) -> Float[np.ndarray, " k"]:
        """Distance that a hull drives ahead from a point until it has less than some space [m], at most 1.5 m.

        A hull that has less space from the beginning may still move away from the obstacle.
        """
        distance = np.arange(1, 31) * 0.05
        directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
        points = start + directions[:, None, :] * distance[None, :, None]
        yaw = np.broadcast_to(headings[:, None], points.shape[:2])
        here = self.space(hull, np.broadcast_to(start, (len(headings), 2)), headings)
        need = np.minimum(space_m, here[:, None] + 0.3 * distance - 1e-3)
        enough = self.space(hull, points, yaw) >= need
        return 0.05 * np.logical_and.accumulate(enough, axis=1).sum(axis=1)

    def cells(self, sharp_m: float) -> Float32[np.ndarray, "ny nx"]:
        """Distance [m] from each cell to the nearest obstacle, at most `LIMIT_M`.

        From the centre of the cell, to about half a cell. Where this does not decide whether the distance reaches
        `sharp_m`, the exact distance from the best of five points of the cell: a passage is as wide as its best line,
        not as its cell centres.

        Args:
            sharp_m: Distance that decides something, the radius of the hull [m].
        """
        cell = self.frame.resolution_m
        if not self._obstacle.any():
            return np.full(self.frame.shape, LIMIT_M, np.float32)
        free = (~self._obstacle).astype(np.uint8)
        gap = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        _sharpen(gap, self._obstacle, self._offset_m / np.float32(cell), sharp_m / cell, LIMIT_M / cell)
        return np.minimum(gap * np.float32(cell), np.float32(LIMIT_M))


#: Error of a distance between cell centres, and how much farther a surface may be [cells]: it lies up to half a cell
#: from its centre on both axes, as does the point in its own cell.
_UNSURE, _FARTHER = 0.8, 1.1


@compiled
def _sharpen(gap: np.ndarray, obstacle: np.ndarray, offset: np.ndarray, sharp: float, limit: float) -> None:
    """Make distances near `sharp` exact, to the best of five points of a cell; all lengths in cells."""
    for y in range(gap.shape[0]):
        for x in range(gap.shape[1]):
            if not abs(gap[y, x] - sharp) < _UNSURE:
                continue
            reach = min(gap[y, x], limit) + _FARTHER
            best = _nearest(obstacle, offset, float(y), float(x), reach)
            if sharp - 0.36 < best < sharp:
                for sy in (-0.25, 0.25):
                    for sx in (-0.25, 0.25):
                        best = max(best, _nearest(obstacle, offset, y + sy, x + sx, reach))
            gap[y, x] = min(best, limit)


@compiled
def _nearest(obstacle: np.ndarray, offset: np.ndarray, y: float, x: float, reach: float) -> float:
    """Distance of a point, from centres of cells, to the nearest surface, at most `reach`."""
    ny, nx = obstacle.shape
    least = reach * reach
    for row in range(max(int(y - reach - 0.5), 0), min(int(y + reach + 1.5), ny)):
        row_gap = max(abs(row - y) - 0.5, 0.0)
        if row_gap * row_gap >= least:
            continue
        half = np.sqrt(least - row_gap * row_gap) + 0.5
        for column in range(max(int(x - half), 0), min(int(x + half) + 1, nx)):
            if obstacle[row, column]:
                dy, dx = row + offset[row, column, 1] - y, column + offset[row, column, 0] - x
                least = min(least, dy * dy + dx * dx)
    return np.sqrt(least)


#: How far a surface may lie from the centre of its cell on either axis [cells], with a margin for rounding.
_OFF = 0.51


@compiled
def _steps(obstacle: np.ndarray) -> np.ndarray:
    """Steps of a king on a chessboard from each cell to the nearest obstacle, at most 255: a sweep there, one back."""
    ny, nx = obstacle.shape
    steps = np.full((ny + 1, nx + 2), 255, np.uint8)
    for y in range(ny):
        for x in range(nx):
            least = min(min(steps[y, x], steps[y, x + 1]), min(steps[y, x + 2], steps[y + 1, x]))
            steps[y + 1, x + 1] = 0 if obstacle[y, x] else min(least, 254) + 1
    for y in range(ny - 1, -1, -1):
        for x in range(nx - 1, -1, -1):
            least = steps[y + 1, x + 2]
            if y + 1 < ny:
                least = min(min(least, steps[y + 2, x]), min(steps[y + 2, x + 1], steps[y + 2, x + 2]))
            steps[y + 1, x + 1] = min(steps[y + 1, x + 1], min(least, 254) + 1)
    return steps[1:, 1:-1]


@compiled
def _gaps(
    points: np.ndarray,
    obstacle: np.ndarray,
    steps: np.ndarray,
    offset: np.ndarray,
    grid: tuple[float, float, float],
    limit: float,
    gap: np.ndarray,
) -> None:
    """Distance of points (x, y) to the nearest surface, at most `limit`; all lengths in metres."""
    x0, y0, cell = grid
    ny, nx = obstacle.shape
    reach = limit / cell + _OFF + 1
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        column, row = (x - x0) / cell, (y - y0) / cell
        gap[k] = limit
        # NaN fails both comparisons.
        if not (-reach < column < nx + reach and -reach < row < ny + reach):
            continue
        least = limit * limit
        own_y, own_x = int(np.floor(row)), int(np.floor(column))
        if 0 <= own_y < ny and 0 <= own_x < nx:
            near = float(steps[own_y, own_x])
            # From any point in the cell to any point in a cell that many steps away.
            bound = (near + 1.02) * cell
            least = min(least, 2 * bound * bound)
            if max((near - 1.02) * cell, 0.0) >= limit:
                continue
        square = limit * limit
        half = np.sqrt(least) / cell + _OFF
        for iy in range(max(int(np.floor(row - half - 0.5)), 0), min(int(row + half + 0.5), ny - 1) + 1):
            for ix in range(
                max(int(np.floor(column - half - 0.5)), 0), min(int(column + half + 0.5), nx - 1) + 1
            ):
                if obstacle[iy, ix]:
                    dx = x - ((ix + 0.5) * cell + x0 + offset[iy, ix, 0])
                    dy = y - ((iy + 0.5) * cell + y0 + offset[iy, ix, 1])
                    square = min(square, dx * dx + dy * dy)
        gap[k] = min(np.sqrt(square), limit)


@compiled
def _gaps_of_outline(
    poses: np.ndarray, corners: np.ndarray, surfaces: Surfaces, limit: float, gap: np.ndarray
) -> None:
    """Distance of a convex polygon at poses from the nearest surface, at most `limit`."""
    for k in range(len(poses)):
        gap[k] = gap_of_outline(poses[k, 0], poses[k, 1], poses[k, 2], corners, surfaces, limit)


@compiled
def gap_of_outline(
    x: float, y: float, yaw: float, corners: np.ndarray, surfaces: Surfaces, limit: float
) -> float:
    """Distance of a convex polygon at a pose from the nearest surface, at most `limit`; all lengths in metres."""
    obstacle, steps, offset, (x0, y0, cell) = surfaces
    ny, nx = obstacle.shape
    reach = 0.0
    for i in range(len(corners)):
        reach = max(reach, np.hypot(corners[i, 0], corners[i, 1]))
    c, s = np.cos(yaw), np.sin(yaw)
    column, row = (x - x0) / cell, (y - y0) / cell
    half = (reach + limit) / cell + _OFF
    # NaN fails the comparisons.
    if not (-half < column < nx + half and -half < row < ny + half):
        return limit
    own_y, own_x = int(np.floor(row)), int(np.floor(column))
    inside = 0 <= own_y < ny and 0 <= own_x < nx
    if inside and (float(steps[own_y, own_x]) - 1.02) * cell > reach + limit:
        return limit
    gap = limit
    for iy in range(max(int(np.floor(row - half)), 0), min(int(row + half), ny - 1) + 1):
        for ix in range(max(int(np.floor(column - half)), 0), min(int(column + half), nx - 1) + 1):
            if obstacle[iy, ix]:
                dx = (ix + 0.5) * cell + x0 + offset[iy, ix, 0] - x
                dy = (iy + 0.5) * cell + y0 + offset[iy, ix, 1] - y
                gap = min(gap, _from_polygon(c * dx + s * dy, c * dy - s * dx, corners))
    return gap


@compiled
def _from_polygon(x: float, y: float, corners: np.ndarray) -> float:
    """Distance of a point from a convex polygon with counter-clockwise corners; negative inside."""
    outer, square = -np.inf, np.inf
    n = len(corners)
    for i in range(n):
        ax, ay = corners[i]
        bx, by = corners[(i + 1) % n]
        ex, ey = bx - ax, by - ay
        px, py = x - ax, y - ay
        length = np.hypot(ex, ey)
        outer = max(outer, (ey * px - ex * py) / length)
        along = min(max((px * ex + py * ey) / (length * length), 0.0), 1.0)
        square = min(square, (px - along * ex) ** 2 + (py - along * ey) ** 2)
    return np.sqrt(square) if outer > 0 else outer
