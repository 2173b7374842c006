"""Ground truth of the cells ahead of a robot: obstacles, and the cells that the camera can see.

The patch is that of `slam.sensing.egocentric`, to train and score mappers. The building's horizontal section is
rastered once, finely; a cell of the patch is an obstacle if any part of it is solid, since that stops a robot. A cell
is seen if a ray in the section reaches it: within the camera's field of view and range, and up to the first wall. The
rest is hidden and can only be anticipated.

Most solid cells can never be seen: the inside of thick walls, the ground around the building. Cells "matter" if they
are floor, or solid within 10 cm of floor; scores count only these.
Left out: views over low obstacles and under others; the section is the same at all heights of the robot, as in
buildings with furniture up to the ceiling.
"""

import math

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from robosim.building.building import Building
from robosim.building.extrusion import wall_segments
from robosim.plans.formats.raster import winding_numbers
from robosim.support.compiled import compiled
from slam.sensing.egocentric import AHEAD

#: Index of each channel of a true patch.
OBSTACLE, SEEN, MATTERS = 0, 1, 2

#: Side of the cells of the raster [m]; a quarter of the patch's.
FINE_M = 0.0125
#: Solid this near to floor counts as the face of a wall [m].
FACE_M = 0.10
#: Range of the camera [m].
RANGE_M = 3.2
#: Angle between rays [rad]: 13 mm at 3.2 m.
RAY_RAD = 0.004

_FREE, _FACE, _INSIDE = 0, 1, 2


class TruePatches:
    """The true patch at any pose in one building."""

    def __init__(
        self,
        building: Building,
        *,
        hfov_deg: float = 90.0,
        height_m: float | None = None,
    ) -> None:
        """Raster the section of a building for a robot of a height [m]; None for as high as the ceiling."""
        floor = building.floor(building.height_m if height_m is None else height_m)
        self._half_fov = math.radians(hfov_deg) / 2
        xmin, ymin, xmax, ymax = building.free.bounds
        margin = FACE_M + 2 * FINE_M
        self._origin = (xmin - margin, ymin - margin)
        shape = tuple(
            math.ceil((high - low + 2 * margin) / FINE_M) for low, high in ((ymin, ymax), (xmin, xmax))
        )
        walls = (wall_segments(floor) - self._origin) / FINE_M
        free = winding_numbers(walls[:, 0], walls[:, 1], shape) != 0
        gap_m = cv2.distanceTransform((~free).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * FINE_M
        self._section = np.where(free, _FREE, np.where(gap_m <= FACE_M, _FACE, _INSIDE)).astype(np.uint8)

    def at(self, pose: Float[np.ndarray, "3"]) -> Bool[np.ndarray, "3 ny nx"]:
        """The patch at a true pose: obstacle, seen, and matters, true for hidden cells, which are not seen."""
        place = np.array([pose[0] - self._origin[0], pose[1] - self._origin[1], pose[2]])
        out = np.zeros((3, *AHEAD.shape), np.bool_)
        corner = np.array([*AHEAD.origin_xy, AHEAD.resolution_m])
        _fill(self._section, place, corner, self._half_fov, RANGE_M, out)
        return out


@compiled
def _kind(section: UInt8[np.ndarray, "h w"], x: float, y: float) -> int:
    """Kind of a point [m] from the corner of the raster."""
    column, row = math.floor(x / FINE_M), math.floor(y / FINE_M)
    if row < 0 or column < 0 or row >= section.shape[0] or column >= section.shape[1]:
        return _INSIDE
    return section[row, column]


@compiled
def _fill(
    section: UInt8[np.ndarray, "h w"],
    pose: Float[np.ndarray, "3"],
    corner: Float[np.ndarray, "3"],
    half_fov: float,
    range_m: float,
    out: Bool[np.ndarray, "3 ny nx"],
) -> None:
    """Classify the cells, then follow the rays."""
    _, ny, nx = out.shape
    x0, y0, cell = corner
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for iy in range(ny):
        for ix in range(nx):
            for k in range(16):
                ahead = x0 + (ix + (k % 4 + 0.5) / 4) * cell
                left = y0 + (iy + (k // 4 + 0.5) / 4) * cell
                kind = _kind(section, pose[0] + c * ahead - s * left, pose[1] + s * ahead + c * left)
                if kind != _FREE:
                    out[OBSTACLE, iy, ix] = True
                if kind != _INSIDE:
                    out[MATTERS, iy, ix] = True
    rays = math.ceil(2 * half_fov / RAY_RAD)
    step = 0.8 * FINE_M
    for ray in range(rays):
        bearing = -half_fov + (ray + 0.5) * 2 * half_fov / rays
        ux, uy = math.cos(bearing), math.sin(bearing)
        for k in range(1, math.floor(range_m / step) + 1):
            ahead, left = k * step * ux, k * step * uy
            solid = _kind(section, pose[0] + c * ahead - s * left, pose[1] + s * ahead + c * left) != _FREE
            ix, iy = math.floor((ahead - x0) / cell), math.floor((left - y0) / cell)
            if 0 <= ix < nx and 0 <= iy < ny:
                out[SEEN, iy, ix] = True
                if solid:
                    out[OBSTACLE, iy, ix] = True
                    out[MATTERS, iy, ix] = True
            if solid:
                break
