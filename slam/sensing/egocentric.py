"""Egocentric patch: a square of cells ahead of the robot, in its own frame, cut from a map.

64 x 64 cells of 0.05 m with the robot at the middle of the near edge. As everywhere, `patch[iy, ix]` has x to the right
and y up, here of the robot's frame: ahead is +ix, left is +iy, and the robot is at the middle of the left edge, between
rows 31 and 32.
Reference: Chaplot et al., Learning to Explore using Active Neural SLAM, ICLR 2020, section 4.
"""

import math

import cv2
import numpy as np
from jaxtyping import Float, Float32

from slam.grid import ComputedGrid, Grid, GridFrame, MapEstimate
from slam.poses import to_map

#: The published patch: 3.2 m ahead, 1.6 m to each side.
AHEAD = GridFrame(origin_xy=(0.0, -1.6), resolution_m=0.05, shape=(64, 64))


def belief_ahead(
    estimate: MapEstimate, patch: GridFrame = AHEAD, *, anticipated: bool = False
) -> Float32[np.ndarray, "ny nx"]:
    """Obstacle probability, or the anticipated one if there is one, ahead of the robot; 0.5 beyond the map."""
    guess = estimate.anticipated_probability if anticipated else None
    values = estimate.obstacle_probability if guess is None else guess
    return cut_ahead(values, estimate.frame, estimate.pose, patch)


def cut_ahead(
    values: Float32[Grid, "ny nx"],
    frame: GridFrame,
    pose: Float[np.ndarray, "3"],
    patch: GridFrame = AHEAD,
) -> Float32[np.ndarray, "my mx"]:
    """Values of a map at the centres of a patch's cells, linear between centres of map cells; 0.5 beyond the map."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    if isinstance(values, ComputedGrid):
        (x, y), (rows, columns) = patch.origin_xy, np.multiply(patch.shape, patch.resolution_m)
        corners = to_map(pose, np.array([(x + i * columns, y + j * rows) for i in (0, 1) for j in (0, 1)]))
        low, high = corners.min(axis=0) - 2 * frame.resolution_m, corners.max(axis=0) + 2 * frame.resolution_m
        window = frame.window((low[0], low[1]), (high[0], high[1]))
        return cut_ahead(values[window[:2]], window[2], pose, patch)
    step = patch.resolution_m / frame.resolution_m
    first = np.array(patch.origin_xy) + 0.5 * patch.resolution_m
    at = frame.to_cells(
        np.array([pose[0] + c * first[0] - s * first[1], pose[1] + s * first[0] + c * first[1]])
    )
    place = np.array([[c * step, -s * step, at[0] - 0.5], [s * step, c * step, at[1] - 0.5]])
    ny, nx = patch.shape
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    border = cv2.BORDER_CONSTANT
    return cv2.warpAffine(values, place, (nx, ny), flags=flags, borderMode=border, borderValue=0.5)
