"""Occupancy by log-odds: what a scan makes more, and less, likely to stand in each cell.

A cell in front of the surface that its image column sees is free, the cells where surfaces are seen are occupied, and
what lies behind stays as it was. Evidence adds up as log-odds within bounds, so a wall entered in error
clears again after some looks. Cells are looked up in the scan (not rays drawn on the map): cells in view cost a
handful of array operations, whatever their number.

A level camera looks over low things when it is near them. A cell is therefore cleared only from where the
obstacle would have been seen, which needs the height of the obstacle's top to be remembered.
Reference: Elfes, Using occupancy grids for mobile robot perception and navigation, Computer 22(6), 1989.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from slam.grid import GridFrame
from slam.poses import to_map
from slam.sensing.laser import LaserScan
from slam.sensing.projection import Scan, dense_points
from slam.support.checks import check_numbers


@dataclass(frozen=True, kw_only=True)
class OccupancyConfig:
    """Weight and reach of the evidence."""

    hit: float = 1.2
    """Log-odds added where a surface is seen."""
    miss: float = 0.4
    """Log-odds taken off where nothing stands before the surface."""
    limit: float = 4.0
    """Bound of the log-odds: how firmly a cell can be believed."""
    free_range_m: float = 5.0
    """Free space and surfaces farther than this are not entered [m]."""
    explored_range_m: float = 3.2
    """Cells nearer than this count as seen [m]."""

    def __post_init__(self) -> None:
        check_numbers(
            self,
            hit=(1e-6, 1000),
            miss=(1e-6, 1000),
            limit=(0.01, 1000),
            free_range_m=(0.01, 1000, "m"),
            explored_range_m=(0.01, self.free_range_m, "m, at most free_range_m"),
        )


class OccupancyGrid:
    """Log-odds, explored cells and tops of obstacles of a grid that may grow."""

    def __init__(self, frame: GridFrame, config: OccupancyConfig = OccupancyConfig()):
        self.frame = frame
        self.config = config
        self.log_odds = np.zeros(frame.shape, np.float32)
        self.probability = np.full(frame.shape, 0.5, np.float32)
        self.explored = np.zeros(frame.shape, bool)
        self.top_m = np.zeros(frame.shape, np.float32)

    def grow(self, frame: GridFrame, left: int, below: int) -> None:
        """Move to a larger frame of the same lattice, with `left` columns and `below` rows added before the old."""
        ny, nx = self.frame.shape
        for name, empty in (("log_odds", 0), ("probability", 0.5), ("explored", False), ("top_m", 0)):
            old = getattr(self, name)
            new = np.full(frame.shape, empty, old.dtype)
            new[below : below + ny, left : left + nx] = old
            setattr(self, name, new)
        self.frame = frame

    def view_box(
        self, scan: Scan, pose: Float[np.ndarray, "3"]
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lower-left and upper-right corner (x, y) [m] of what a scan can change at a pose."""
        deepest = (
            min(float(scan.clear_m.max(initial=0.0)), self.config.free_range_m) + self.frame.resolution_m
        )
        sides = deepest * np.array([scan.left[0], scan.left[-1]], float)
        corners = to_map(pose, np.array([[0.0, 0.0], [deepest, sides[0]], [deepest, sides[1]]]))
        low, high = corners.min(axis=0) - 0.15, corners.max(axis=0) + 0.15
        return (low[0], low[1]), (high[0], high[1])

    def integrate(
        self, scan: Scan, pose: Float[np.ndarray, "3"], camera_height_m: float, down: float
    ) -> tuple[slice, slice, Bool[np.ndarray, "ny nx"]]:
        """Enter a scan.

        Args:
            scan: The scan.
            pose: Where it was taken: x [m], y [m], yaw [rad].
            camera_height_m: Height of the camera [m].
            down: Fall of the lowest image row per metre of depth.

        Returns:
            Rows and columns of the window that changed, and the cells in it that stopped being obstacles.
        """
        rows, columns, frame = self.frame.window(*self.view_box(scan, pose))
        ahead, bearing = _robot_coordinates(frame, pose)
        log_odds = self.log_odds[rows, columns]
        hit = self._hits(scan, pose, frame, self.top_m[rows, columns])
        free, in_view = self._free(scan, ahead, bearing)
        free &= ~hit
        # Over what is lower than the lowest row at that depth the camera looks away.
        held = free & (log_odds > 0)
        held &= self.top_m[rows, columns] < camera_height_m - down * ahead + 0.05
        away = ahead * np.sqrt(1 + bearing * bearing)
        return rows, columns, self._weigh(rows, columns, hit, free & ~held, in_view | hit, away)

    def integrate_laser(
        self, scan: LaserScan, pose: Float[np.ndarray, "3"]
    ) -> tuple[slice, slice, Bool[np.ndarray, "ny nx"]]:
        """Enter a laser's scan as far as it reaches; arguments and results as of `integrate`.

        Below its beams it sees nothing: what is lower than they are stays as it was.
        """
        rows, columns, frame = self.frame.window(*self.laser_box(scan, pose))
        away, beam = _beams(frame, pose, scan)
        seen = beam >= 0
        clear, half = scan.clear_m, 0.5 * self.frame.resolution_m
        inner = np.where(scan.hit, clear - half, clear)
        beside = [np.roll(inner, 1), np.roll(inner, -1)]
        if not scan.all_around:
            beside[0][0], beside[1][-1] = inner[0], inner[-1]
        # A beam that says nothing does not make its neighbours say less.
        inner = np.minimum(inner, np.minimum(*(np.where(other > 0, other, np.inf) for other in beside)))
        iy, ix = frame.index(to_map(pose, scan.dense(scan.max_range_m)))
        inside = frame.inside(iy, ix)
        hit = np.zeros(frame.shape, bool)
        hit[iy[inside], ix[inside]] = True
        top_m = self.top_m[rows, columns]
        top_m[hit] = np.maximum(top_m[hit], scan.height_m)
        free = seen & (away < inner.astype(np.float32)[beam]) & ~hit
        log_odds = self.log_odds[rows, columns]
        held = free & (log_odds > 0) & (top_m < scan.height_m)
        in_view = seen & (away < (clear + half).astype(np.float32)[beam])
        return rows, columns, self._weigh(rows, columns, hit, free & ~held, (in_view | hit), away)

    def laser_box(
        self, scan: LaserScan, pose: Float[np.ndarray, "3"]
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lower-left and upper-right corner (x, y) [m] of what a laser's scan can change at a pose."""
        angle = scan.bearing_rad + pose[2]
        ends = scan.clear_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + pose[:2]
        low, high = ends.min(axis=0) - 0.15, ends.max(axis=0) + 0.15
        return (low[0], low[1]), (high[0], high[1])

    def stand(self, pose: Float[np.ndarray, "3"], radius_m: float) -> None:
        """Clear the cells whose centres the hull covers: the robot stands there, so nothing else does."""
        x, y, _ = pose
        box = ((x - radius_m, y - radius_m), (x + radius_m, y + radius_m))
        rows, columns, frame = self.frame.window(*box)
        cx, cy = _axes(frame)
        under = (cx - x) ** 2 + (cy - y)[:, None] ** 2 < radius_m**2
        log_odds = self.log_odds[rows, columns]
        log_odds[under & (log_odds > -self.config.miss)] = -self.config.miss
        self.probability[rows, columns] = 1 / (1 + np.exp(-log_odds))

    def _weigh(
        self,
        rows: slice,
        columns: slice,
        hit: Bool[np.ndarray, "ny nx"],
        free: Bool[np.ndarray, "ny nx"],
        in_view: Bool[np.ndarray, "ny nx"],
        away_m: Float32[np.ndarray, "ny nx"],
    ) -> Bool[np.ndarray, "ny nx"]:
        """Add the evidence of a look to a window; returns the cells that stopped being obstacles."""
        log_odds = self.log_odds[rows, columns]
        was_obstacle = log_odds > 0
        log_odds += np.where(hit, np.float32(self.config.hit), np.float32(0))
        log_odds -= np.where(free, np.float32(self.config.miss), np.float32(0))
        np.clip(log_odds, -self.config.limit, self.config.limit, out=log_odds)
        cleared = was_obstacle & (log_odds <= 0)
        self.top_m[rows, columns][cleared] = 0
        self.probability[rows, columns] = 1 / (1 + np.exp(-log_odds))
        self.explored[rows, columns] |= in_view & (away_m <= self.config.explored_range_m)
        return np.asarray(cleared)

    def _free(
        self, scan: Scan, ahead: Float32[np.ndarray, "ny nx"], bearing: Float32[np.ndarray, "ny nx"]
    ) -> tuple[Bool[np.ndarray, "ny nx"], Bool[np.ndarray, "ny nx"]]:
        """Cells wholly before the surface of their column and its neighbours; cells not behind it."""
        n = len(scan.left)
        per_column = (scan.left[0] - scan.left[-1]) / (n - 1)
        column = np.rint((scan.left[0] - bearing) / per_column)
        seen = (ahead > 0) & (column >= 0) & (column < n)
        column = np.where(seen, column, 0).astype(np.intp)
        clear = np.minimum(scan.clear_m, self.config.free_range_m)
        half = 0.5 * self.frame.resolution_m
        # A column without a surface is clear up to its last measured point, with no wall to keep off from.
        inner = np.where(scan.hit & (scan.depth_m <= self.config.free_range_m), clear - half, clear)
        inner[1:-1] = np.minimum(inner[1:-1], np.minimum(inner[:-2], inner[2:]))
        free = seen & (ahead < inner.astype(np.float32)[column])
        in_view = seen & (ahead < (clear + half).astype(np.float32)[column])
        return free, in_view

    def _hits(
        self,
        scan: Scan,
        pose: Float[np.ndarray, "3"],
        frame: GridFrame,
        top_m: Float32[np.ndarray, "ny nx"],
    ) -> Bool[np.ndarray, "ny nx"]:
        """Cells in which the scan sees a surface; raises `top_m` there to the height seen."""
        hit = np.zeros(frame.shape, bool)
        for depth_m, top in ((scan.depth_m, scan.top_m), (scan.far_m, np.full_like(scan.top_m, 9.0))):
            points, heights = dense_points(scan.left, depth_m, top, self.config.free_range_m)
            iy, ix = frame.index(to_map(pose, points))
            inside = frame.inside(iy, ix)
            iy, ix = iy[inside], ix[inside]
            hit[iy, ix] = True
            np.maximum.at(top_m, (iy, ix), heights[inside])
        return hit


def _axes(frame: GridFrame) -> tuple[Float[np.ndarray, " nx"], Float[np.ndarray, " ny"]]:
    """Centres of columns (x) and rows (y) [m]."""
    ny, nx = frame.shape
    x = frame.origin_xy[0] + (np.arange(nx) + 0.5) * frame.resolution_m
    y = frame.origin_xy[1] + (np.arange(ny) + 0.5) * frame.resolution_m
    return x, y


def _beams(
    frame: GridFrame, pose: Float[np.ndarray, "3"], scan: LaserScan
) -> tuple[Float32[np.ndarray, "ny nx"], Int[np.ndarray, "ny nx"]]:
    """Distance of the cell centres [m], and the number of the beam nearest to each."""
    x, y = _axes(frame)
    x, y = (x - pose[0]).astype(np.float32), (y - pose[1]).astype(np.float32)[:, None]
    return np.hypot(x, y), scan.nearest(np.arctan2(y, x) - np.float32(pose[2]))


def _robot_coordinates(
    frame: GridFrame, pose: Float[np.ndarray, "3"]
) -> tuple[Float32[np.ndarray, "ny nx"], Float32[np.ndarray, "ny nx"]]:
    """Distance ahead of the robot [m], and leftward offset per metre ahead, of the cell centres."""
    x, y = _axes(frame)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = x - pose[0], y - pose[1]
    ahead = (c * x).astype(np.float32) + (s * y).astype(np.float32)[:, None]
    left = (-s * x).astype(np.float32) + (c * y).astype(np.float32)[:, None]
    return ahead, left / np.where(np.abs(ahead) < 1e-6, np.float32(1e-6), ahead)
