"""How much of the floor the robot has seen, judged on the true pose.

A cell of the plan has been seen once its centre lay within the camera's horizontal field of view and within
the vision range, with no wall before it: the depth in the image's horizon row, at the column of the cell's
bearing, reaches at least as far. This is the line of sight of a planar sensor; that floor just before the
robot lies under the picture's lower edge does not matter, nor do obstacles lower than the camera. What a lidar sees
counts likewise, on the beam nearest to the cell's bearing.

The range of 3.2 m is the one of Active Neural SLAM (Chaplot et al., ICLR 2020), so that coverage can be
compared with published figures.
"""

import numpy as np
from jaxtyping import Bool, Float

from robosim.plans.floorplan import FloorPlan
from slam.poses import Pose
from slam.sensing.laser import LaserScan

VISION_RANGE_M = 3.2


class Coverage:
    """Counts the cells of a region of a plan that a camera has seen."""

    def __init__(
        self, plan: FloorPlan, region: Bool[np.ndarray, "ny nx"], hfov_rad: float, ahead_m: float = 0.0
    ):
        """Begin with nothing seen of a region of a plan.

        The camera's field of view is horizontal [rad]; it is as far ahead of the robot's centre [m].
        """
        self.plan = plan
        self.region = np.array(region)
        self._unseen = self.region.copy()
        self._n_region, self._n_seen = int(self.region.sum()), 0
        self._tan_half, self._ahead_m = float(np.tan(hfov_rad / 2)), ahead_m
        # Half a cell: the wall that a border cell touches may lie before that cell's centre.
        self._slack_m = plan.resolution_m / 2

    def update(
        self, pose: Pose, depth: Float[np.ndarray, "h w"] | None, laser: LaserScan | None = None
    ) -> None:
        """Add what one frame shows from a true pose of the robot in `map`.

        Depth is along the camera's axis [m], 0 where nothing was hit; `laser` is without error. None if there is none.
        """
        # Only around the robot, so that a look costs the same in a building of any size.
        column, row = self.plan.to_cells(pose[:2])
        reach = VISION_RANGE_M / self.plan.resolution_m + 1
        corner = np.maximum(np.floor([row - reach, column - reach]), 0).astype(int)
        end = np.maximum(np.ceil([row + reach, column + reach]), 0).astype(int)
        cells = np.argwhere(self._unseen[corner[0] : end[0], corner[1] : end[1]]) + corner
        offset = self.plan.to_map(cells[:, ::-1] + 0.5) - pose[:2]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        ahead = offset @ (c, s)
        left = offset @ (-s, c)
        near = ahead**2 + left**2 <= VISION_RANGE_M**2
        cells, ahead, left = cells[near], ahead[near], left[near]
        seen = np.zeros(len(cells), bool)
        if depth is not None:
            seen |= self._before(ahead - self._ahead_m, left, depth)
        if laser is not None:
            ahead = ahead - laser.ahead_m
            beam = laser.nearest(np.arctan2(left, ahead))
            seen |= (beam >= 0) & (laser.range_m[beam] + self._slack_m >= np.hypot(ahead, left))
        cells = cells[seen]
        self._unseen[cells[:, 0], cells[:, 1]] = False
        self._n_seen += len(cells)

    def _before(
        self,
        ahead: Float[np.ndarray, " n"],
        left: Float[np.ndarray, " n"],
        depth: Float[np.ndarray, "h w"],
    ) -> Bool[np.ndarray, " n"]:
        """Which places lie before what the camera sees."""
        inside = (ahead > 0) & (np.abs(left) < ahead * self._tan_half)
        horizon = depth[depth.shape[0] // 2]
        reaches = np.where(horizon > 0, horizon, np.inf)
        width = len(horizon)
        slope = np.where(inside, left / np.where(inside, ahead, 1.0), 0.0)
        pixel = ((1 - slope / self._tan_half) * width / 2).astype(int)
        return inside & (reaches[np.clip(pixel, 0, width - 1)] + self._slack_m >= ahead)

    @property
    def area_m2(self) -> float:
        """Area seen [m2]."""
        return self._n_seen * self.plan.resolution_m**2

    @property
    def fraction(self) -> float:
        """Part of the region that was seen, 0 to 1; 1 for an empty region."""
        return self._n_seen / self._n_region if self._n_region else 1.0

    @property
    def seen(self) -> Bool[np.ndarray, "ny nx"]:
        """Which cells of the plan were seen."""
        return self.region & ~self._unseen
