"""A map that is known before the robot drives: its surfaces for scan matching, and how well a scan agrees with it.

Cells give surfaces to a fraction of their side: each occupied cell next to a free one is moved onto the line through
its neighbours, whose normal points to the free side. Walls of one cell that are free on both sides have no such normal
and serve to search for the robot only.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from slam.grid import GridFrame
from slam.matching.levels import SurfaceLevels, difference, matches, most_paired
from slam.matching.scan_matching import Match, MatchConfig, ScanPoints
from slam.poses import Covariance, Pose, to_map

#: Neighbours within so many cells make the line of a wall.
_NEIGHBOURS = 3
#: Largest ratio of the small to the large variance of neighbours on one line.
_STRAIGHT = 0.15
#: Smallest slope of free cells across a wall that is free on one side.
_ONE_SIDED = 0.1
#: A point of a scan agrees with the map this near to an occupied cell, and contradicts it this far off, if free [m].
_AGREES_M, _CONTRADICTS_M = 0.15, 0.3
#: Weight of the squared deviation from a prediction, in variances, against shares of a scan.
_OF_PRIOR = 0.03
#: Beams are followed in steps of this [m], so many of a scan; they graze walls at less than this angle [rad].
_STEP_M, _JUDGED, _GRAZING_RAD = 0.05, 90, 0.03


class KnownMap:
    """Occupied, free and unknown cells of a building."""

    def __init__(
        self, occupied: Bool[np.ndarray, "ny nx"], free: Bool[np.ndarray, "ny nx"], frame: GridFrame
    ) -> None:
        """Find the surfaces.

        Args:
            occupied: Cells of walls and furniture.
            free: Cells where a robot may be; cells that are neither are unknown.
            frame: Place of the cells in `map`.

        Raises:
            ValueError: If no cell is occupied, or none is free.
        """
        for name, cells in (("occupied", occupied), ("free", free)):
            if not cells.any():
                raise ValueError(f"the known map has no {name} cell: a robot cannot be located on it.")
        self.frame, self.occupied, self.free = frame, occupied, free
        away = (~occupied).astype(np.uint8)
        self._gap_m = frame.resolution_m * cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        self.levels = SurfaceLevels(frame.resolution_m)
        self.levels.enter(np.zeros(3), self._surfaces())

    def _surfaces(self) -> ScanPoints:
        """Points with normals on the edges of walls, in `map`."""
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        edge = self.occupied & (cv2.dilate(self.free.astype(np.uint8), cross) > 0)
        y, x = np.indices(edge.shape).astype(float)

        def neighbours(values: np.ndarray | float) -> np.ndarray:
            """Sum over the edges around each edge cell."""
            side = (2 * _NEIGHBOURS + 1,) * 2
            masked = edge * np.asarray(values, float)
            return np.asarray(
                cv2.boxFilter(masked, -1, side, normalize=False, borderType=cv2.BORDER_CONSTANT)[edge]
            )

        n = neighbours(1.0)
        mx, my = neighbours(x) / n, neighbours(y) / n
        xx, yy = neighbours(x * x) / n - mx * mx, neighbours(y * y) / n - my * my
        xy = neighbours(x * y) / n - mx * my
        along = 0.5 * np.arctan2(2 * xy, xx - yy)
        normals = np.column_stack([-np.sin(along), np.cos(along)])
        spread, half = np.hypot(0.5 * (xx - yy), xy), 0.5 * (xx + yy)
        is_straight = half - spread < _STRAIGHT * (half + spread)
        slope = np.column_stack(
            [
                cv2.Sobel(self.free.astype(np.float32), cv2.CV_32F, dx, 1 - dx, ksize=5, scale=1 / 128)[edge]
                for dx in (1, 0)
            ]
        )
        facing = (normals * slope).sum(axis=1)
        normals *= np.where(facing < 0, -1.0, 1.0)[:, None]
        off = (mx - x[edge]) * normals[:, 0] + (my - y[edge]) * normals[:, 1]
        points = self.frame.centres(edge) + self.frame.resolution_m * off[:, None] * normals
        good = is_straight & (np.abs(facing) > _ONE_SIDED)
        return ScanPoints(
            points=points[good], normals=normals[good], weights=np.ones(good.sum()), loose=points[~good]
        )

    def places(self, step_m: float) -> Float[np.ndarray, "n 2"]:
        """Return free places on a lattice of this step (x, y) [m]."""
        stride = max(1, round(step_m / self.frame.resolution_m))
        lattice = np.zeros_like(self.free)
        lattice[::stride, ::stride] = True
        on_lattice = lattice & self.free
        return self.frame.centres(on_lattice if on_lattice.any() else self.free)

    def agreement(self, pose: Pose, points: Float[np.ndarray, "n 2"]) -> tuple[float, float]:
        """Return the share of a scan that agrees with the map, and the share that contradicts it.

        A point contradicts the map in the middle of free cells, or behind a wall; unknown cells contradict nothing.

        Args:
            pose: Pose of the scan: x [m], y [m], yaw [rad].
            points: Ends of its beams in the robot's frame [m].
        """
        if not len(points):
            return 0.0, 0.0
        points = points[np.linspace(0, len(points) - 1, min(_JUDGED, len(points))).astype(int)]
        gap_m, free, _ = self._cells(to_map(pose, points))
        contradicts = free & (gap_m > _CONTRADICTS_M)
        range_m = np.hypot(*points.T)
        along = np.arange(_STEP_M, max(float(range_m.max()), 2 * _STEP_M), _STEP_M)
        before = along < range_m[:, None] - _CONTRADICTS_M
        through = np.ones(len(points), bool)
        # A beam along a wall meets its cells too, but not if it is turned a little to either side.
        for turn in (-_GRAZING_RAD, 0.0, _GRAZING_RAD):
            ahead = to_map(np.array([0.0, 0.0, pose[2] + turn]), points / np.maximum(range_m, 1e-9)[:, None])
            _, _, occupied = self._cells(pose[:2] + ahead[:, None] * along[:, None])
            through &= (occupied & before).any(axis=1)
        contradicts |= through
        return float(((gap_m < _AGREES_M) & ~through).mean()), float(contradicts.mean())

    def fit(
        self, scan: ScanPoints, predicted: Pose, covariance: Covariance, config: MatchConfig
    ) -> tuple[Match, float, float]:
        """Return the match near a prediction that agrees best with the map, and its `agreement`.

        Args:
            scan: Points and normals in the robot's frame.
            predicted: x [m], y [m], yaw [rad].
            covariance: Of the prediction, axes of `map` [m^2, m rad, rad^2].
            config: Settings of scan matching.
        """
        # Cells place their surfaces no better than that, however exact the sensor is.
        sigma_m = np.hypot(config.sigma_m, 0.0 if scan.sigma_m is None else scan.sigma_m)
        scan = replace(scan, sigma_m=np.broadcast_to(sigma_m, len(scan.points)))
        ends = scan.every()

        def rating(fit: tuple[Match, float, float]) -> float:
            match, agreement, contradiction = fit
            away = difference(match.pose, predicted, 1.0)
            return agreement - contradiction - _OF_PRIOR * float(away @ np.linalg.solve(covariance, away))

        fits = matches(self.levels, scan, predicted, covariance, config, most_paired)
        return max(((match, *self.agreement(match.pose, ends)) for match in fits), key=rating)

    def cells_at(self, points: Float[np.ndarray, "*batch 2"]) -> tuple[np.ndarray, np.ndarray]:
        """Return whether points (x, y) [m] lie in occupied cells, and in free ones; neither outside."""
        _, free, occupied = self._cells(points)
        return occupied, free

    def _cells(self, points: Float[np.ndarray, "*batch 2"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance from occupied cells [m], and whether points lie in free and in occupied cells; unknown outside."""
        iy, ix = self.frame.index(points)
        inside = self.frame.inside(iy, ix)
        iy, ix = np.where(inside, iy, 0), np.where(inside, ix, 0)
        gap_m = np.where(inside, self._gap_m[iy, ix], np.inf)
        return gap_m, inside & self.free[iy, ix], inside & self.occupied[iy, ix]
