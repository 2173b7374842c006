"""The patch ahead of the robot from the nearest cells of a map, without interpolation."""

import numpy as np
from jaxtyping import Bool, Float

from slam.grid import GridFrame, MapEstimate
from slam.poses import to_map
from slam.sensing.egocentric import AHEAD

#: Index of each channel.
OBSTACLE, EXPLORED = 0, 1


def egocentric_map(
    estimate: MapEstimate, pose: Float[np.ndarray, "3"] | None = None, patch: GridFrame = AHEAD
) -> Bool[np.ndarray, "2 ny nx"]:
    """What a map says about the cells around a pose.

    Args:
        estimate: The map.
        pose: x [m], y [m], yaw [rad] in `map`; the estimated pose if None.
        patch: Cells of the result, in the robot's frame.

    Returns:
        Channels obstacle and explored. Cells beyond the map are neither.
    """
    pose = estimate.pose if pose is None else pose
    centres = patch.centres(np.ones(patch.shape, bool)).reshape(*patch.shape, 2)
    # A centre that falls on the border of two cells, up to rounding, always counts for the upper one: otherwise a robot
    # at the centre of a cell would see some rows twice and others not at all.
    ix, iy = np.moveaxis(np.floor(estimate.frame.to_cells(to_map(pose, centres)) + 1e-6).astype(int), -1, 0)
    inside = estimate.frame.inside(iy, ix)
    iy, ix = np.where(inside, iy, 0), np.where(inside, ix, 0)
    obstacle = estimate.obstacle_probability[iy, ix] > 0.5
    return np.stack([obstacle, estimate.explored[iy, ix]]) & inside
