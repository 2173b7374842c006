"""The physical limit of a search: a robot that knows target, building and pose, and drives the shortest path.

The oracle knows only the target. It may lose more by not knowing building and pose than another policy, so that times
relative to it are no efficiencies; times relative to `shortest` are. Planner, controller, physics and actuation noise
are the same for all policies.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Float32

from robosim.building.building import Building
from robosim.building.extrusion import wall_segments
from robosim.plans.formats.raster import winding_numbers
from robosim.policies.goals import Oracle
from slam.actions import Command
from slam.grid import GridFrame, MapEstimate
from slam.mapping.classical import Mapper

#: Side of the cells [m], as in mappers.
_CELL_M = 0.05
#: Margin around the building [cells].
_MARGIN = 20
#: Distance between samples of walls, and their distance behind the faces [m].
_STEP_M, _BEHIND_M = 0.01, 0.001


class Shortest(Oracle):
    """Knows the target; its robot has a `TrueMapper`."""

    uses_true_map = True


class TrueMapper(Mapper):
    """A mapper that returns the true map and pose."""

    collided = False

    def __init__(
        self, building: Building, pose: Callable[[], Float[np.ndarray, "3"]], height_m: float | None = None
    ) -> None:
        """Raster the floor of a building for a robot of a height (None: up to the ceiling); `pose` returns its pose."""
        self._pose = pose
        frame = _frame(building)
        obstacle, offset_m = _raster(
            building.floor(building.height_m if height_m is None else height_m), frame
        )
        empty = np.zeros(frame.shape, bool)
        self._truth = MapEstimate(
            frame=frame,
            obstacle_probability=obstacle.astype(np.float32),
            explored=~empty,
            blocked=empty,
            pose=np.zeros(3),
            surface_offset_m=offset_m,
        )

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """Nothing to do."""

    def update(self, depth: object, action: Command | None = None, odometry: object = None) -> MapEstimate:
        """The true map and pose, whatever the sensors measure."""
        return self.estimate()

    def estimate(self) -> MapEstimate:
        """The true map and pose."""
        return replace(self._truth, pose=np.array(self._pose(), float))


def _frame(building: Building) -> GridFrame:
    """Cells around a building, aligned with an unrotated plan."""
    xmin, ymin, xmax, ymax = building.free.bounds
    x0, y0, _ = building.plan.origin
    left, below = (math.floor((low - at) / _CELL_M) - _MARGIN for low, at in ((xmin, x0), (ymin, y0)))
    right, above = (math.ceil((high - at) / _CELL_M) + _MARGIN for high, at in ((xmax, x0), (ymax, y0)))
    return GridFrame(
        origin_xy=(x0 + left * _CELL_M, y0 + below * _CELL_M),
        resolution_m=_CELL_M,
        shape=(above - below, right - left),
    )


def _raster(
    floor: shapely.MultiPolygon, frame: GridFrame
) -> tuple[Bool[np.ndarray, "ny nx"], Float32[np.ndarray, "ny nx 2"]]:
    """Cells with a solid centre or a wall, and offsets of their nearest wall from the centre."""
    walls = wall_segments(floor)
    local = (walls - frame.origin_xy) / frame.resolution_m
    obstacle = winding_numbers(local[:, 0], local[:, 1], frame.shape) == 0
    iy, ix = frame.index(_behind(walls))
    obstacle[iy, ix] = True
    near_free = cv2.dilate((~obstacle).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    iy, ix = np.nonzero(obstacle & near_free)
    centre = frame.to_points(np.column_stack([ix, iy]) + 0.5)
    nearest = shapely.STRtree(shapely.linestrings(walls)).nearest(shapely.points(centre))
    a, along = walls[nearest, 0], walls[nearest, 1] - walls[nearest, 0]
    share = ((centre - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
    offset_m = np.zeros((*frame.shape, 2), np.float32)
    offset_m[iy, ix] = a + np.clip(share, 0, 1)[:, None] * along - centre
    return obstacle, offset_m


def _behind(walls: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "m 2"]:
    """Points just behind the faces of walls; the floor is on their left."""
    along = walls[:, 1] - walls[:, 0]
    length = np.hypot(*along.T)
    count = np.ceil(length / _STEP_M).astype(int) + 1
    wall = np.repeat(np.arange(len(walls)), count)
    number = np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count)
    share = (number + 0.5) / count[wall]
    right = np.column_stack([along[:, 1], -along[:, 0]]) / np.maximum(length, 1e-12)[:, None]
    return walls[wall, 0] + share[:, None] * along[wall] + _BEHIND_M * right[wall]
