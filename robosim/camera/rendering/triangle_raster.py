"""Triangles drawn over a picture where they are nearer than what it shows.

The edge functions of homogeneous coordinates need no clipping (Olano and Greer, Triangle scan conversion using 2D
homogeneous coordinates, Graphics Hardware 1997). Each triangle has one colour; left out is light.
"""

from typing import NamedTuple

import numpy as np

from robosim.support.compiled import compiled


class Lens(NamedTuple):
    """Focal length [pixels], near and far plane [m]."""

    focal_px: float
    near_m: float
    far_m: float


@compiled
def draw_triangles(
    triangles: np.ndarray,
    colours: np.ndarray,
    place: np.ndarray,
    R_camera: np.ndarray,
    lens: Lens,
    depth: np.ndarray,
    rgb: np.ndarray,
) -> None:
    """Triangles over what is drawn already, where they are nearer."""
    height, width = depth.shape
    seen, weight = np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(triangles)):
        for corner in range(3):
            for axis in range(3):
                seen[corner, axis] = 0.0
                for other in range(3):
                    seen[corner, axis] += R_camera[axis, other] * (triangles[k, corner, other] - place[other])
        if _is_outside(seen, lens, 0.5 * width / lens.focal_px, 0.5 * height / lens.focal_px):
            continue
        a, b, c = seen[0], seen[1], seen[2]
        # Columns of the inverse of (a, b, c) as rows: weight of a corner over z, linear in (x / z, y / z, 1).
        _cross(b, c, weight[0])
        _cross(c, a, weight[1])
        _cross(a, b, weight[2])
        volume = a[0] * weight[0, 0] + a[1] * weight[0, 1] + a[2] * weight[0, 2]
        if volume == 0.0:
            continue
        low_i, high_i, low_j, high_j = 0, height, 0, width
        if min(a[2], b[2], c[2]) > lens.near_m:
            f = lens.focal_px
            u = (f * a[0] / a[2], f * b[0] / b[2], f * c[0] / c[2])
            v = (f * a[1] / a[2], f * b[1] / b[2], f * c[1] / c[2])
            low_j, high_j = max(int(min(u) + 0.5 * width), 0), min(int(max(u) + 0.5 * width) + 1, width)
            low_i, high_i = max(int(min(v) + 0.5 * height), 0), min(int(max(v) + 0.5 * height) + 1, height)
        for i in range(low_i, high_i):
            y = (i + 0.5 - 0.5 * height) / lens.focal_px
            for j in range(low_j, high_j):
                x = (j + 0.5 - 0.5 * width) / lens.focal_px
                wa = (weight[0, 0] * x + weight[0, 1] * y + weight[0, 2]) / volume
                wb = (weight[1, 0] * x + weight[1, 1] * y + weight[1, 2]) / volume
                wc = (weight[2, 0] * x + weight[2, 1] * y + weight[2, 2]) / volume
                if wa < 0 or wb < 0 or wc < 0 or wa + wb + wc <= 0:
                    continue
                z = 1.0 / (wa + wb + wc)
                if lens.near_m <= z <= lens.far_m and (depth[i, j] == 0 or z < depth[i, j]):
                    depth[i, j] = z
                    rgb[i, j, :] = colours[k]


@compiled
def _is_outside(seen: np.ndarray, lens: Lens, wide: float, high: float) -> bool:
    """Whether all of a triangle, in the camera's frame, is beyond one side of what the camera sees."""
    outside = np.zeros(6, np.int64)
    for corner in range(3):
        x, y, z = seen[corner]
        outside[0] += z <= lens.near_m
        outside[1] += z >= lens.far_m
        outside[2] += x < -wide * z
        outside[3] += x > wide * z
        outside[4] += y < -high * z
        outside[5] += y > high * z
    return outside.max() == 3


@compiled
def _cross(a: np.ndarray, b: np.ndarray, product: np.ndarray) -> None:
    """The cross product of two vectors, into `product`."""
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]
