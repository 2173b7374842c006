"""Depths that a depth camera would measure without the tracked things: depths of the map behind them."""

import numpy as np
from jaxtyping import Float

from slam.grid import MapEstimate
from slam.poses import to_map

#: Points within this distance of the centre of a thing are of it [m].
_THING_M = 0.35
#: Distances behind a thing at which the map is looked up [m].
_BEYOND_M = np.arange(1, 201) * 0.05


def background(
    depth_m: Float[np.ndarray, " n"], left: Float[np.ndarray, " n"], estimate: MapEstimate
) -> Float[np.ndarray, " n"]:
    """Depths of pixels, those of tracked things replaced by depths of the first cell behind them that is not free.

    Args:
        depth_m: Depth of each pixel [m], 0 where nothing was measured.
        left: Its offset to the left per depth.
        estimate: Map, pose and tracked things.
    """
    points = to_map(estimate.pose, np.column_stack([depth_m, depth_m * left]))
    is_thing = np.zeros(len(depth_m), bool)
    for thing in estimate.moving:
        is_thing |= (np.hypot(*(points - thing.xy).T) < _THING_M) & (depth_m > 0)
    depth_m = depth_m.copy()
    beyond_m = depth_m[is_thing, None] + _BEYOND_M
    behind = np.stack([beyond_m, beyond_m * left[is_thing, None]], axis=-1)
    iy, ix = estimate.frame.index(to_map(estimate.pose, behind.reshape(-1, 2)))
    is_free = estimate.frame.inside(iy, ix)
    is_free[is_free] = estimate.known_free[iy[is_free], ix[is_free]]
    free = np.logical_and.accumulate(is_free.reshape(beyond_m.shape), axis=1).sum(axis=1)
    depth_m[is_thing] += free * _BEYOND_M[0]
    return depth_m
