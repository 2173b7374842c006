"""A mapper that begins with a known map: it locates the robot there, and enters what has changed.

Scans are fitted to the known surfaces alone, so that poses neither drift nor change later; the graph is not needed.
"""

import math
from dataclasses import replace

import numpy as np

from slam.graph.submaps import View
from slam.grid import GridFrame
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.mapping.known_map import KnownMap
from slam.mapping.localization import LocalizationConfig
from slam.matching.scan_matching import Match, ScanPoints
from slam.poses import Covariance, Pose
from slam.robot import Robot
from slam.sensing.projection import Scan

#: Height of what a map shows [m]: walls hide what is behind them from every camera.
_TOP_M = 9.0
#: Evidence of a known cell relative to the most that scans give: some scans overrule it.
_CERTAINTY = 0.5


class KnownMapMapper(ClassicalMapper):
    """Locates the robot on a known map; see `ClassicalMapper` for the rest."""

    def __init__(
        self,
        known: KnownMap,
        robot: Robot = Robot(),
        config: MapperConfig = MapperConfig(),
        localization: LocalizationConfig = LocalizationConfig(),
    ) -> None:
        """Make a mapper; `reset` sets the pose on the map at which the robot begins.

        Raises:
            ValueError: If the map is larger than `MapperConfig.max_area_m2`.
        """
        area_m2 = known.frame.resolution_m**2 * math.prod(known.frame.shape)
        if area_m2 > config.max_area_m2:
            raise ValueError(
                f"the known map covers {area_m2:.0f} m2, more than max_area_m2 = {config.max_area_m2:g}. Cut it."
            )
        self.known, self._fitting = known, localization.match
        super().__init__(robot, replace(config, tracking=replace(config.tracking, loops=False, radio=False)))

    def reset(self, pose: Pose) -> None:
        """Forget everything but the known map, and begin at a pose: x [m], y [m], yaw [rad] in `map`."""
        super().reset(pose)
        known = self.known.frame
        low = np.array(known.origin_xy)
        high = low + known.resolution_m * np.array(known.shape[::-1])
        over = np.concatenate(
            [self.frame.to_cells(low) * -1, self.frame.to_cells(high) - self.frame.shape[::-1]]
        )
        left, below, right, above = (max(0, math.ceil(cells)) for cells in over)
        frame: GridFrame = self.frame.padded(left, right, below, above)
        for layer in (self.occupancy, self.surfaces, self.marks):
            layer.grow(frame, left, below)
        self.frame = frame
        x, y = frame.axes()
        occupied, free = self.known.cells_at(np.stack(np.meshgrid(x, y), axis=-1))
        grid = self.occupancy
        grid.log_odds += _CERTAINTY * grid.config.limit * (occupied.astype(np.float32) - free)
        grid.update_probability(slice(None), slice(None))
        grid.explored |= occupied | free
        grid.top_m[occupied] = _TOP_M
        self.surfaces.add(*self.known.levels.fine.planes())

    def _match(self, scan: Scan, points: ScanPoints, view: View, predicted: Pose, prior: Covariance) -> Match:
        """Fit a scan to the known map near the predicted pose."""
        return self.known.fit(points, predicted, prior, self._fitting)[0]
