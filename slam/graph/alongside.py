"""Walls along a line of sight, whose reflections a receiver takes for the path itself.

A wall at a distance h beside a straight path of length r adds one that is sqrt(r^2 + 4 h^2) - r longer and comes from
its mirror image, arctan(2 h / r) aside. In a corridor both are less than a receiver tells apart: it hears one path,
from somewhere between, or from the image where that is as strong. Estimates tell nothing of it; the walls do.
"""

import math

import numpy as np
from jaxtyping import Float

from slam.sensing.bearings import Bearing

#: Walls are looked for so far along the line [m], in parts of so much [m].
_AHEAD_M, _PART_M = 10.0, 0.25
#: Their normals may depart by so much from square to the line (sine).
_ALONG = math.sin(math.radians(15.0))
#: They are walls alongside if surfaces fill so much of the line.
_FILLED = 0.3


def image_beside_rad(
    bearing: Bearing,
    pose: Float[np.ndarray, "3"],
    points: Float[np.ndarray, "n 2"],
    normals: Float[np.ndarray, "n 2"],
) -> float:
    """How far aside mirror images appear that a receiver cannot tell from what it hears [rad]; 0 where none does.

    Args:
        bearing: What it hears.
        pose: From where: x [m], y [m], yaw [rad].
        points: Surfaces that are known [m], axes of the pose.
        normals: Their unit normals.
    """
    azimuth, range_m = pose[2] + bearing.bearing_rad, bearing.range_m
    along = np.array([math.cos(azimuth), math.sin(azimuth)])
    away = points - pose[:2]
    ahead_m, aside_m = away @ along, away @ np.array([-along[1], along[0]])
    reach_m = min(range_m, _AHEAD_M)
    images = np.arctan2(2 * np.abs(aside_m), range_m)
    longer_m = np.hypot(range_m, 2 * aside_m) - range_m
    beside = (ahead_m > 0) & (ahead_m < reach_m) & (np.abs(normals @ along) < _ALONG)
    beside &= (images < bearing.apart_rad) & (longer_m < bearing.apart_m)
    widest = 0.0
    for side in (aside_m > 0, aside_m < 0):
        wall = beside & side
        filled_m = _PART_M * len(np.unique(ahead_m[wall] // _PART_M))
        if filled_m > _FILLED * reach_m:
            widest = max(widest, float(np.median(images[wall])))
    return widest
