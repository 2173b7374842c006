"""An RGB-D camera for buildings that are an extruded plan: one level ray per column, and no OpenGL.

Where walls stand upright from floor to ceiling, all that a column of a level picture shows follows from the distance of
the nearest wall: rows between its foot and its top show it, rows below the floor, rows above the ceiling. Other
surfaces, furniture and the target, are drawn over it triangle by triangle (`triangle_raster`).

Depth is that of the other cameras. Colours are schematic: walls are grey by the direction that they face, without
light. Left out: cameras that look up or down.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Bool, Float, UInt8

from robosim.camera.model import RGBD, CameraConfig, ClosingCamera
from robosim.camera.rendering.merged_meshes import merge
from robosim.camera.rendering.triangle_raster import Lens, draw_triangles
from robosim.camera.rendering.wall_rays import WallTiles, nearest_wall, wall_tiles
from robosim.support.compiled import compiled

#: Grey of floor and ceiling, and of walls: least and most, by the direction that they face.
_FLOOR, _CEILING, _WALL = 150, 235, (165, 215)
#: Heights and directions that differ by less are the same [m].
_SAME = 1e-6


class _Storey(NamedTuple):
    """Upright walls and level faces of a scene."""

    walls: WallTiles
    shade: UInt8[np.ndarray, " n"]
    """Grey of each wall."""
    floor_m: float
    ceiling_m: float
    has_floor: bool
    has_ceiling: bool


class PlanCamera(ClosingCamera):
    """Casts a ray for each column. Needs no OpenGL; works in any process and thread."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig) -> None:
        """Separate walls, floor and ceiling from the rest; see `robosim.camera.cameras.make_camera`."""
        self.config = config
        self._lens = Lens(float(config.focal_px), config.near_m, config.far_m)
        self._scenery = merge(meshes)
        triangles = (
            np.concatenate([np.asarray(mesh.triangles, float) for mesh in meshes]) - self._scenery.centre
        )
        z = triangles[:, :, 2]
        low, high = float(z.min()), float(z.max())
        is_wall, is_level = _are_walls(triangles, low, high), np.ptp(z, axis=1) < _SAME
        is_floor = is_level & (z[:, 0] < low + _SAME)
        is_ceiling = is_level & (z[:, 0] > high - _SAME)
        self._storey: _Storey | None = None
        if is_wall.any():
            walls = wall_tiles(_segments(triangles[is_wall]))
            along = walls.segments[:, 2:]
            facing = np.abs(along[:, 0]) / np.maximum(np.hypot(*along.T), 1e-12)
            shade = np.rint(_WALL[0] + (_WALL[1] - _WALL[0]) * facing).astype(np.uint8)
            self._storey = _Storey(walls, shade, low, high, bool(is_floor.any()), bool(is_ceiling.any()))
        other = ~(is_wall | is_floor | is_ceiling)
        self._others = triangles[other]
        self._colours = self._scenery.colours[self._scenery.faces[other, 0]]
        self._closed = False

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose; ValueError if it does not look level, RuntimeError if the camera is closed."""
        if self._closed:
            raise RuntimeError("The camera is closed. Make a new one with make_camera.")
        R, t = self._scenery.to_local(T_map_camera)
        if abs(R[2, 1] + 1) > _SAME:
            raise ValueError(
                f"T_map_camera turns the picture's y axis to {R[:, 1]}, expected straight down, as of a level camera. "
                "Take pyrender or embree for one that looks up or down."
            )
        R_camera = np.ascontiguousarray(R.T)
        shape = self.config.height, self.config.width
        rgb, depth = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)
        if self._storey is not None:
            _draw_storey(self._storey, t, R_camera, self._lens, depth, rgb)
        if len(self._others):
            draw_triangles(self._others, self._colours, t, R_camera, self._lens, depth, rgb)
        return RGBD(rgb, depth)

    def close(self) -> None:
        """A closed camera takes no more pictures."""
        self._closed = True


def _are_walls(triangles: Float[np.ndarray, "n 3 3"], low: float, high: float) -> Bool[np.ndarray, " n"]:
    """Mask of triangles that are half of a wall from floor to ceiling."""
    z = triangles[:, :, 2]
    ends = (np.abs(z - low) < _SAME) | (np.abs(z - high) < _SAME)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normal, axis=1)
    upright = np.abs(normal[:, 2]) <= _SAME * np.maximum(size, 1e-12)
    return ends.all(axis=1) & (np.ptp(z, axis=1) > high - low - 2 * _SAME) & upright & (size > 0)


def _segments(triangles: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "m 2 2"]:
    """Walls from above: each once, though it is made of two triangles."""
    plan = triangles[:, :, :2]
    gap = np.linalg.norm(plan[:, [1, 2, 0]] - plan, axis=2)
    widest = gap.argmax(axis=1)
    row = np.arange(len(plan))
    ends = np.stack([plan[row, widest], plan[row, (widest + 1) % 3]], axis=1)
    order = np.lexsort((ends[:, :, 1], ends[:, :, 0]), axis=1)
    ends = np.take_along_axis(ends, order[:, :, None], axis=1)
    return np.unique(ends.reshape(-1, 4), axis=0).reshape(-1, 2, 2)


@compiled
def _draw_storey(
    storey: _Storey, place: np.ndarray, R_camera: np.ndarray, lens: Lens, depth: np.ndarray, rgb: np.ndarray
) -> None:
    """Walls, floor and ceiling by column; rows of `R_camera` are right, down, ahead."""
    height, width = depth.shape
    right, ahead = R_camera[0], R_camera[2]
    for j in range(width):
        x = (j + 0.5 - 0.5 * width) / lens.focal_px
        dx, dy = ahead[0] + x * right[0], ahead[1] + x * right[1]
        wall_m, wall = nearest_wall(storey.walls, place[0], place[1], dx, dy, lens.far_m)
        for i in range(height):
            y = (i + 0.5 - 0.5 * height) / lens.focal_px
            z, grey = wall_m, 0
            if wall >= 0:
                grey = storey.shade[wall]
            if y > 0 and (storey.floor_m - place[2]) / -y < z:
                z, grey = (place[2] - storey.floor_m) / y if storey.has_floor else np.inf, _FLOOR
            elif y < 0 and (storey.ceiling_m - place[2]) / -y < z:
                z, grey = (place[2] - storey.ceiling_m) / y if storey.has_ceiling else np.inf, _CEILING
            if lens.near_m <= z <= lens.far_m:
                depth[i, j] = z
                rgb[i, j, :] = grey
