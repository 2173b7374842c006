"""How far the nearest obstacle is from any point, to better than a cell.

Distances are taken to the surface inside each obstacle cell, where a mapper knows it, or else to its centre: in a
doorway 5 cm wider than the hull this is the difference between passing and not. A k-d tree answers exactly for
points; for whole maps a distance transform is near enough but where the hull just fits or just does not.
Beyond `LIMIT_M` space is open and distances are not told apart.
Reference: Borgefors, Distance transformations in digital images, CVGIP 34, 1986; Bentley, CACM 18(9), 1975.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.spatial import KDTree

from slam.grid import GridFrame, MapEstimate

#: Largest distance reported [m]; more than any hull needs.
LIMIT_M = 0.4


class Clearance:
    """Distance to the nearest obstacle within a window of the map."""

    def __init__(
        self,
        frame: GridFrame,
        obstacle: Bool[np.ndarray, "ny nx"],
        offset_m: Float32[np.ndarray, "ny nx 2"] | None = None,
    ):
        """Prepare a window.

        Args:
            frame: Where the cells of the window lie.
            obstacle: Obstacle cells.
            offset_m: Surface inside each obstacle cell, from its centre (x, y) [m]; the centre if None.
        """
        self.frame = frame
        self._obstacle = obstacle
        iy, ix = np.nonzero(obstacle)
        points = frame.to_points(np.column_stack([ix, iy]) + 0.5)
        if offset_m is not None:
            points = points + offset_m[iy, ix]
        self._points = points
        self._tree = KDTree(points, balanced_tree=False, compact_nodes=False) if len(points) else None

    @classmethod
    def around(cls, estimate: MapEstimate, half_side_m: float, bumps: bool = True) -> "Clearance":
        """Clearance in a square window of a map estimate around the robot.

        Args:
            estimate: Map and pose.
            half_side_m: Half the side of the window [m].
            bumps: Whether blocked cells count as obstacles.
        """
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
        if self._tree is None:
            return np.full(np.shape(points)[:-1], LIMIT_M)
        gap = self._tree.query(points, distance_upper_bound=LIMIT_M)[0]
        return np.asarray(np.minimum(gap, LIMIT_M))

    def cells(self, sharp_m: float) -> Float32[np.ndarray, "ny nx"]:
        """Distance [m] from each cell to the nearest obstacle, at most `LIMIT_M`.

        From the centre of the cell, to about half a cell. Where that leaves it open whether the distance
        reaches `sharp_m`, the exact distance from the best of five points of the cell: a passage is as wide as its best
        line, not as its cell centres.

        Args:
            sharp_m: Distance that decides something, the radius of the hull [m].
        """
        cell = self.frame.resolution_m
        if self._tree is None:
            return np.full(self.frame.shape, LIMIT_M, np.float32)
        free = (~self._obstacle).astype(np.uint8)
        gap = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * np.float32(cell)
        iy, ix = np.nonzero(np.abs(gap - sharp_m) < 0.8 * cell)
        centre = self.frame.to_points(np.column_stack([ix, iy]) + 0.5)
        best = self.at(centre)
        unsure = np.flatnonzero((best < sharp_m) & (best > sharp_m - 0.36 * cell))
        for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            shifted = self.at(centre[unsure] + np.array([sx, sy]) * 0.25 * cell)
            best[unsure] = np.maximum(best[unsure], shifted)
        gap[iy, ix] = best
        return np.minimum(gap, np.float32(LIMIT_M))
