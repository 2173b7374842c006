"""The physical limit of a search: a robot that knows target, building and its own pose, and drives the shortest way.

The oracle knows the target alone. What it loses by not knowing the building and by not knowing quite where it is, it
may lose more of than another policy, so that times relative to it are no efficiencies: those relative to this are.
Planner, controller, physics and noise of actuation are everybody's.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Float32

from robosim.building.building import Building
from robosim.plans.formats.scanline import winding_numbers
from robosim.policies.goals import Oracle, PolicyContext
from robosim.robot.collision import wall_segments
from slam.actions import Action
from slam.grid import GridFrame, MapEstimate

#: Side of the cells [m], that of mappers.
_CELL_M = 0.05
#: Room around the building [cells].
_RIM = 20
#: Walls are sampled at such steps, so far behind their faces [m].
_STEP_M, _BEHIND_M = 0.01, 0.001


class Shortest(Oracle):
    """Knows where the target is; an episode gives its robot a `TrueMapper`."""


def shortest(context: PolicyContext) -> Shortest:
    """Knows target, building and pose."""
    if context.target is None:
        raise ValueError("target is None, but shortest has to be told where it is.")
    return Shortest(context.target)


class TrueMapper:
    """Stands for a mapper and tells the truth."""

    collided = False

    def __init__(
        self, building: Building, pose: Callable[[], Float[np.ndarray, "3"]], height_m: float | None = None
    ) -> None:
        """Raster the building.

        Args:
            building: Its `floor` is what the robot drives on.
            pose: Tells the true pose: x [m], y [m], yaw [rad] in `map`.
            height_m: Height of the robot [m]; None for as high as the ceiling.
        """
        self._pose = pose
        frame = _frame(building)
        obstacle, offset_m = _raster(
            building.floor(building.height_m if height_m is None else height_m), frame
        )
        nothing = np.zeros(frame.shape, bool)
        self._truth = MapEstimate(
            frame=frame,
            obstacle_probability=obstacle.astype(np.float32),
            explored=~nothing,
            blocked=nothing,
            pose=np.zeros(3),
            surface_offset_m=offset_m,
        )

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """There is nothing to forget."""

    def update(
        self, depth: object, action: Action | None = None, odometry: object = None, laser: object = None
    ) -> MapEstimate:
        """The truth, whatever was sensed."""
        return self.estimate()

    def estimate(self) -> MapEstimate:
        """The truth."""
        return replace(self._truth, pose=np.array(self._pose(), float))


def _frame(building: Building) -> GridFrame:
    """Cells around a building, on the lattice of its plan where that is not turned."""
    xmin, ymin, xmax, ymax = building.free.bounds
    x0, y0, _ = building.plan.origin
    left, below = (math.floor((low - at) / _CELL_M) - _RIM for low, at in ((xmin, x0), (ymin, y0)))
    right, above = (math.ceil((high - at) / _CELL_M) + _RIM for high, at in ((xmax, x0), (ymax, y0)))
    return GridFrame(
        origin_xy=(x0 + left * _CELL_M, y0 + below * _CELL_M),
        resolution_m=_CELL_M,
        shape=(above - below, right - left),
    )


def _raster(
    floor: shapely.MultiPolygon, frame: GridFrame
) -> tuple[Bool[np.ndarray, "ny nx"], Float32[np.ndarray, "ny nx 2"]]:
    """Cells that are solid at their centres or have a wall in them, and where the nearest wall is, from the centre."""
    walls = wall_segments(floor)
    local = (walls - frame.origin_xy) / frame.resolution_m
    obstacle = winding_numbers(local[:, 0], local[:, 1], frame.shape) == 0
    iy, ix = frame.index(_behind(walls))
    obstacle[iy, ix] = True
    beside = cv2.dilate((~obstacle).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    iy, ix = np.nonzero(obstacle & beside)
    centre = frame.to_points(np.column_stack([ix, iy]) + 0.5)
    nearest = shapely.STRtree(shapely.linestrings(walls)).nearest(shapely.points(centre))
    a, along = walls[nearest, 0], walls[nearest, 1] - walls[nearest, 0]
    share = ((centre - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
    offset_m = np.zeros((*frame.shape, 2), np.float32)
    offset_m[iy, ix] = a + np.clip(share, 0, 1)[:, None] * along - centre
    return obstacle, offset_m


def _behind(walls: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "m 2"]:
    """Points just behind the faces of walls, which have free floor on their left."""
    along = walls[:, 1] - walls[:, 0]
    length = np.hypot(*along.T)
    count = np.ceil(length / _STEP_M).astype(int) + 1
    wall = np.repeat(np.arange(len(walls)), count)
    number = np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count)
    share = (number + 0.5) / count[wall]
    right = np.column_stack([along[:, 1], -along[:, 0]]) / np.maximum(length, 1e-12)[:, None]
    return walls[wall, 0] + share[:, None] * along[wall] + _BEHIND_M * right[wall]
