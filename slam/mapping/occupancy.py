"""Occupancy grid: log-odds of obstacles, updated by scans.

Cells before the surface of their image column are free, cells with surfaces are occupied, and cells behind do not
change. Log-odds are bounded, so an erroneous wall clears after some scans. Cells are looked up in the scan in one
compiled pass (no rays are drawn on the map).

A level camera looks over low obstacles when it is near them. A cell is therefore cleared only from a place where the
obstacle would be visible, which requires the stored height of its top.
Reference: Elfes, Using occupancy grids for mobile robot perception and navigation, Computer 22(6), 1989.
"""

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int

from robosim.support.checks import Range, checked
from robosim.support.compiled import compiled
from slam.grid import LARGE_CELLS, ComputedGrid, Grid, GridFrame, enlarged, filled_blocks, zeros
from slam.hull import Hull
from slam.poses import Pose, moved_ahead, to_map
from slam.sensing.laser import LaserScan
from slam.sensing.projection import BETWEEN, ONE_SURFACE_M, Scan

#: Cells of the grid, or of a window of it.
Cells = Bool[np.ndarray, "ny nx"]


@dataclass(frozen=True, kw_only=True)
@checked
class OccupancyConfig:
    """Weight and reach of the evidence."""

    hit: Annotated[float, Range(1e-6, 1000)] = 1.2
    """Log-odds added where a surface is seen."""
    miss: Annotated[float, Range(1e-6, 1000)] = 0.4
    """Log-odds subtracted before the surface."""
    limit: Annotated[float, Range(0.01, 1000)] = 4.0
    """Bound of the log-odds."""
    free_range_m: Annotated[float, Range(0.01, 1000, "m")] = 5.0
    """Free space and surfaces farther than this are not entered [m]."""
    explored_range_m: Annotated[float, Range(0.01, 1000, "m")] = 3.2
    """Cells nearer than this count as seen [m]; at most free_range_m."""

    def __post_init__(self) -> None:
        if self.explored_range_m > self.free_range_m:
            raise ValueError(
                f"explored_range_m is {self.explored_range_m}, expected at most free_range_m = {self.free_range_m} m."
            )


class OccupancyGrid:
    """Log-odds, explored cells and tops of obstacles of a grid that may grow."""

    def __init__(self, frame: GridFrame, config: OccupancyConfig = OccupancyConfig()):
        self.frame = frame
        self.config = config
        self.log_odds = zeros(frame.shape, np.float32)
        self.explored = zeros(frame.shape, bool)
        self.top_m = zeros(frame.shape, np.float32)
        self._make_probability()

    def grow(self, frame: GridFrame, left: int, below: int) -> None:
        """Move to a larger frame of the same lattice, with `left` columns and `below` rows added before the old."""
        # A cell with a top has log-odds.
        blocks = filled_blocks(self.log_odds)
        self.top_m = enlarged(self.top_m, frame.shape, left, below, blocks)
        self.log_odds = enlarged(self.log_odds, frame.shape, left, below, blocks)
        self.explored = enlarged(self.explored, frame.shape, left, below)
        self.frame = frame
        self._make_probability()

    def paste(self, rows: slice, columns: slice, window: "OccupancyGrid") -> None:
        """Replace a window by the cells of a grid over it."""
        for name in ("log_odds", "explored", "top_m"):
            getattr(self, name)[rows, columns] = getattr(window, name)
        self.update_probability(rows, columns)

    def _make_probability(self) -> None:
        """Probability of each cell; on a large map, log-odds alone take memory."""
        large = self.log_odds.size > LARGE_CELLS
        self.probability: Grid = (
            ComputedGrid(probability_of, self.log_odds) if large else probability_of(self.log_odds)
        )

    def update_probability(self, rows: slice, columns: slice) -> None:
        """Make the probability follow the log-odds of a window."""
        if isinstance(self.probability, np.ndarray):
            self.probability[rows, columns] = probability_of(self.log_odds[rows, columns])

    def view_box(self, scan: Scan, pose: Pose) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lower-left and upper-right corner (x, y) [m] of what a scan can change at a pose."""
        pose = moved_ahead(pose, scan.ahead_m)
        deepest = (
            min(float(scan.clear_m.max(initial=0.0)), self.config.free_range_m) + self.frame.resolution_m
        )
        sides = deepest * np.array([scan.left[0], scan.left[-1]], float)
        corners = to_map(pose, np.array([[0.0, 0.0], [deepest, sides[0]], [deepest, sides[1]]]))
        low, high = corners.min(axis=0) - 0.15, corners.max(axis=0) + 0.15
        return (low[0], low[1]), (high[0], high[1])

    def integrate(
        self, scan: Scan, pose: Pose, camera_height_m: float, down: float
    ) -> tuple[slice, slice, Cells]:
        """Enter a scan; returns rows and columns of the changed window, and its cells that stopped being obstacles."""
        rows, columns, frame = self.frame.window(*self.view_box(scan, pose))
        top_m, cleared = self.top_m[rows, columns], np.zeros(frame.shape, bool)
        hit = np.zeros(frame.shape, bool)
        x, y, yaw = (float(value) for value in moved_ahead(pose, scan.ahead_m))
        place, range_m = _Place(x, y, yaw, *frame.origin_xy, frame.resolution_m), self.config.free_range_m
        _mark(scan.left, scan.depth_m, scan.top_m, range_m, place, hit, top_m)
        # A surface seen behind a low one is at least as high as the camera.
        _mark(scan.left, scan.far_m, np.full_like(scan.top_m, 9.0), range_m, place, hit, top_m)
        inner, outer = self._clear(scan)
        _look(
            scan.left,
            inner,
            outer,
            place,
            (self.config.hit, self.config.miss, self.config.limit, self.config.explored_range_m),
            (camera_height_m + 0.05, down),
            hit,
            self.log_odds[rows, columns],
            top_m,
            self.explored[rows, columns],
            cleared,
        )
        self.update_probability(rows, columns)
        return rows, columns, cleared

    def integrate_laser(self, scan: LaserScan, pose: Pose) -> tuple[slice, slice, Cells]:
        """Enter a laser's scan as far as it reaches; arguments and results as of `integrate`.

        Below its beams it sees nothing: lower obstacles stay unchanged.
        """
        rows, columns, frame = self.frame.window(*self.laser_box(scan, pose))
        pose = moved_ahead(pose, scan.ahead_m)
        away, beam = _beams(frame, pose, scan)
        seen = beam >= 0
        clear, half = scan.clear_m, 0.5 * self.frame.resolution_m
        inner = np.where(scan.hit, clear - half, clear)
        neighbours = [np.roll(inner, 1), np.roll(inner, -1)]
        if not scan.all_around:
            neighbours[0][0], neighbours[1][-1] = inner[0], inner[-1]
        # A beam without a return does not shorten its neighbours.
        inner = np.minimum(inner, np.minimum(*(np.where(other > 0, other, np.inf) for other in neighbours)))
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

    def laser_box(self, scan: LaserScan, pose: Pose) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lower-left and upper-right corner (x, y) [m] of what a laser's scan can change at a pose."""
        pose = moved_ahead(pose, scan.ahead_m)
        angle = scan.bearing_rad + pose[2]
        ends = scan.clear_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + pose[:2]
        low, high = ends.min(axis=0) - 0.15, ends.max(axis=0) + 0.15
        return (low[0], low[1]), (high[0], high[1])

    def stand(self, pose: Pose, hull: Hull, margin_m: float = 0.0) -> None:
        """Clear the cells that the hull covers but for a margin: the robot stands there, so nothing else does."""
        rows, columns, under = self.frame.under(pose, hull, margin_m)
        log_odds = self.log_odds[rows, columns]
        log_odds[under & (log_odds > -self.config.miss)] = -self.config.miss
        self.update_probability(rows, columns)

    def _weigh(
        self,
        rows: slice,
        columns: slice,
        hit: Cells,
        free: Cells,
        in_view: Cells,
        away_m: Float32[np.ndarray, "ny nx"],
    ) -> Cells:
        """Add the evidence of a look to a window; returns the cells that stopped being obstacles."""
        log_odds = self.log_odds[rows, columns]
        changed = log_odds + np.where(hit, np.float32(self.config.hit), np.float32(0))
        changed -= np.where(free, np.float32(self.config.miss), np.float32(0))
        np.clip(changed, -self.config.limit, self.config.limit, out=changed)
        cleared = (log_odds > 0) & (changed <= 0)
        # Only cells that are written to take memory.
        np.copyto(log_odds, changed, where=hit | free)
        self.top_m[rows, columns][cleared] = 0
        self.update_probability(rows, columns)
        seen = in_view & (away_m <= self.config.explored_range_m)
        np.copyto(self.explored[rows, columns], True, where=seen)
        return np.asarray(cleared)

    def _clear(self, scan: Scan) -> tuple[Float32[np.ndarray, " w"], Float32[np.ndarray, " w"]]:
        """Depth up to which each column and its neighbours say that all is free, and up to which it sees at all [m]."""
        clear = np.minimum(scan.clear_m, self.config.free_range_m)
        half = 0.5 * self.frame.resolution_m
        # A column without a surface is clear up to its last measured point, with no wall to keep off from.
        inner = np.where(scan.hit & (scan.depth_m <= self.config.free_range_m), clear - half, clear)
        inner[1:-1] = np.minimum(inner[1:-1], np.minimum(inner[:-2], inner[2:]))
        return inner.astype(np.float32), (clear + half).astype(np.float32)


def probability_of(log_odds: Any) -> Any:
    """Probability of log-odds, of an array or a number: 0.5 for 0."""
    return 1 / (1 + np.exp(-log_odds))


class _Place(NamedTuple):
    """A pose, and the grid that is looked at from it."""

    x: float
    y: float
    yaw: float
    corner_x: float
    corner_y: float
    cell_m: float


@compiled
def _mark(
    left: np.ndarray,
    depth_m: np.ndarray,
    heights_m: np.ndarray,
    range_m: float,
    place: _Place,
    hit: np.ndarray,
    top_m: np.ndarray,
) -> None:
    """Mark the cells in which a scan sees a surface, and raise their tops to the height seen."""
    # Between neighbours on one surface there are points in between, so that far walls have no holes: the inverse depth
    # of a plane is linear in the column, so they lie exactly on it.
    ny, nx = hit.shape
    c, s = np.cos(place.yaw), np.sin(place.yaw)
    for k in range(len(left) - 1):
        a, b = 1 / float(depth_m[k]), 1 / float(depth_m[k + 1])
        gap = np.hypot(1 / a - 1 / b, left[k] / a - left[k + 1] / b)
        for between in range(BETWEEN if gap < ONE_SURFACE_M else 1):
            share = between / BETWEEN
            inverse = a * (1 - share) + b * share
            ahead = 1 / inverse
            if not ahead <= range_m:
                continue
            aside = ahead * (left[k] * (1 - share) + left[k + 1] * share)
            x, y = place.x + c * ahead - s * aside, place.y + s * ahead + c * aside
            ix = int(np.floor((x - place.corner_x) / place.cell_m))
            iy = int(np.floor((y - place.corner_y) / place.cell_m))
            if 0 <= ix < nx and 0 <= iy < ny:
                hit[iy, ix] = True
                top_m[iy, ix] = max(top_m[iy, ix], heights_m[k])


@compiled
def _look(
    left: np.ndarray,
    inner: np.ndarray,
    outer: np.ndarray,
    place: _Place,
    weights: tuple[float, float, float, float],
    eye: tuple[float, float],
    hit: np.ndarray,
    log_odds: np.ndarray,
    top_m: np.ndarray,
    explored: np.ndarray,
    cleared: np.ndarray,
) -> None:
    """Add the evidence of a look to a window, cell by cell; marks the cells that stopped being obstacles."""
    more, less, limit, explored_m = weights
    eye_m, down = eye
    ny, nx = hit.shape
    n = len(left)
    per_column = (left[0] - left[n - 1]) / (n - 1)
    first, last, deepest = left[0] + 0.5 * per_column, left[n - 1] - 0.5 * per_column, outer.max()
    c, s = np.cos(place.yaw), np.sin(place.yaw)
    for iy in range(ny):
        dy = place.corner_y + (iy + 0.5) * place.cell_m - place.y
        for ix in range(nx):
            dx = place.corner_x + (ix + 0.5) * place.cell_m - place.x
            ahead, aside = c * dx + s * dy, c * dy - s * dx
            free = in_view = False
            if ahead > 1e-6 and ahead < deepest and aside < first * ahead and aside > last * ahead:
                column = min(max(int((left[0] - aside / ahead) / per_column + 0.5), 0), n - 1)
                free, in_view = ahead < inner[column], ahead < outer[column]
            struck = hit[iy, ix]
            if not (in_view or struck):
                continue
            was = log_odds[iy, ix]
            # Over what is lower than the lowest row at that depth the camera looks away.
            held = was > 0 and top_m[iy, ix] < eye_m - down * ahead
            now = was
            if struck:
                now += more
            elif free and not held:
                now -= less
            now = min(max(now, -limit), limit)
            log_odds[iy, ix] = now
            if was > 0 and now <= 0:
                cleared[iy, ix] = True
                top_m[iy, ix] = 0
            if dx * dx + dy * dy <= explored_m * explored_m:
                explored[iy, ix] = True


def _beams(
    frame: GridFrame, pose: Pose, scan: LaserScan
) -> tuple[Float32[np.ndarray, "ny nx"], Int[np.ndarray, "ny nx"]]:
    """Distance of the cell centres [m], and the number of the beam nearest to each."""
    x, y = frame.axes()
    x, y = (x - pose[0]).astype(np.float32), (y - pose[1]).astype(np.float32)[:, None]
    return np.hypot(x, y), scan.nearest(np.arctan2(y, x) - np.float32(pose[2]))
