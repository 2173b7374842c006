"""Walls along a line of sight, whose reflections a receiver cannot separate from the direct path.

A wall parallel to a straight path of length r, at a distance h, adds a path that is sqrt(r^2 + 4 h^2) - r longer and
comes from the mirror image, arctan(2 h / r) aside. In a corridor both differences are below the receiver's resolution:
it measures one path, from a direction in between, or from the image if that is as strong. The path estimate does not
show this; the walls on the map do.
"""

import math

import numpy as np
from jaxtyping import Float

from slam.sensing.bearings import Bearing

#: Walls are searched for up to this distance along the line [m], in parts of this length [m].
_AHEAD_M, _PART_M = 10.0, 0.25
#: Largest deviation of their normals from the perpendicular of the line (sine).
_ALONG = math.sin(math.radians(15.0))
#: Least part of the line with surfaces alongside.
_FILLED = 0.3


def mirror_image_angle_rad(
    bearing: Bearing,
    pose: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "n 2"],
    normals: Float[np.ndarray, "n 2"],
) -> float:
    """Angle to mirror images that a receiver cannot separate from a path [rad]; 0 without such images."""
    azimuth, range_m = pose[2] + bearing.bearing_rad, bearing.range_m
    along = np.array([math.cos(azimuth), math.sin(azimuth)])
    away = points - pose[:2]
    ahead_m, aside_m = away @ along, away @ np.array([-along[1], along[0]])
    reach_m = min(range_m, _AHEAD_M)
    images = np.arctan2(2 * np.abs(aside_m), range_m)
    longer_m = np.hypot(range_m, 2 * aside_m) - range_m
    alongside = (ahead_m > 0) & (ahead_m < reach_m) & (np.abs(normals @ along) < _ALONG)
    alongside &= (images < bearing.apart_rad) & (longer_m < bearing.apart_m)
    widest = 0.0
    for side in (aside_m > 0, aside_m < 0):
        wall = alongside & side
        filled_m = _PART_M * len(np.unique(ahead_m[wall] // _PART_M))
        if filled_m > _FILLED * reach_m:
            widest = max(widest, float(np.median(images[wall])))
    return widest
