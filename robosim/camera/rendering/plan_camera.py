"""An RGB-D camera for buildings that are an extruded plan: one level ray a column, and no OpenGL.

Where walls stand upright from floor to ceiling, all that a column of a level picture shows follows from one number, the
distance of the nearest wall: rows between its foot and its top show it, rows below the floor, rows above the ceiling.
What else there is, furniture and the target, is drawn over it triangle by triangle, by the edge functions of
homogeneous coordinates, which need no clipping (Olano and Greer, Triangle scan conversion using 2D homogeneous
coordinates, Graphics Hardware 1997).

Depth is that of the other cameras. Colours are schematic: walls are grey by the way they face, without light.
Left out: cameras that look up or down.
"""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float32, UInt8

from robosim.camera.model import RGBD, CameraConfig
from robosim.camera.rendering.scenery import merge
from robosim.camera.rendering.wall_rays import WallTiles, nearest_wall, wall_tiles
from wireless.support.compiled import compiled

#: Grey of floor and ceiling, and of walls: least and most, by the direction that they face.
_FLOOR, _CEILING, _WALL = 150, 235, (165, 215)
#: Heights and directions that differ by less are the same [m].
_SAME = 1e-6


class PlanCamera:
    """Casts a ray for each column. Needs no OpenGL; works in any process and thread."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig) -> None:
        """Sort out walls, floor and ceiling; see `robosim.camera.cameras.make_camera`."""
        self.config = config
        scenery = merge(meshes)
        self._centre = scenery.centre
        triangles = np.concatenate([np.asarray(mesh.triangles, float) for mesh in meshes]) - self._centre
        z = triangles[:, :, 2]
        self._floor, self._top = float(z.min()), float(z.max())
        whole, level = _upright(triangles, self._floor, self._top), np.ptp(z, axis=1) < _SAME
        flat_floor = level & (z[:, 0] < self._floor + _SAME)
        flat_top = level & (z[:, 0] > self._top - _SAME)
        self._has = bool(flat_floor.any()), bool(flat_top.any())
        self._walls: WallTiles | None = None
        if whole.any():
            self._walls = wall_tiles(_segments(triangles[whole]))
            along = self._walls.segments[:, 2:]
            facing = np.abs(along[:, 0]) / np.maximum(np.hypot(*along.T), 1e-12)
            self._shade = np.rint(_WALL[0] + (_WALL[1] - _WALL[0]) * facing).astype(np.uint8)
        other = ~(whole | flat_floor | flat_top)
        self._others = triangles[other]
        self._colours = scenery.colours[scenery.faces[other, 0]]
        self._closed = False

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose.

        Raises:
            ValueError: If the pose is not a 4 by 4 matrix of finite numbers, or does not look level.
            RuntimeError: If the camera is closed.
        """
        shape = self.config.height, self.config.width
        rgb, depth = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)
        self._draw(T_map_camera, depth, rgb)
        return RGBD(rgb, depth)

    def render_depth(self, T_map_camera: Float[np.ndarray, "4 4"]) -> Float32[np.ndarray, "h w"]:
        """Take the depth of a picture only, which is faster; raises as `render` does."""
        depth = np.zeros((self.config.height, self.config.width), np.float32)
        self._draw(T_map_camera, depth, np.zeros((0, 0, 3), np.uint8))
        return depth

    def close(self) -> None:
        """There is nothing to free, but a closed camera takes no more pictures."""
        self._closed = True

    def _draw(
        self, T_map_camera: Float[np.ndarray, "4 4"], depth: Float32[np.ndarray, "h w"], rgb: np.ndarray
    ) -> None:
        if self._closed:
            raise RuntimeError("The camera is closed. Make a new one with make_camera.")
        T = np.asarray(T_map_camera, float)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise ValueError(f"T_map_camera is\n{T}\nexpected a 4 by 4 matrix of finite numbers.")
        if abs(T[2, 1] + 1) > _SAME:
            raise ValueError(
                f"T_map_camera turns the picture's y axis to {T[:3, 1]}, expected straight down, as of a level camera. "
                "Take pyrender or embree for one that looks up or down."
            )
        place = T[:3, 3] - self._centre
        c = self.config
        if self._walls is not None:
            _draw_plan(
                *self._walls, self._shade, place, T[:2, 2].copy(), T[:2, 0].copy(), self._floor, self._top,
                *self._has, float(c.focal_px), c.near_m, c.far_m, depth, rgb,
            )  # fmt: skip
        if len(self._others):
            _draw_triangles(
                self._others, place, np.ascontiguousarray(T[:3, :3].T), self._colours, float(c.focal_px),
                c.near_m, c.far_m, depth, rgb,
            )  # fmt: skip


def _upright(triangles: Float[np.ndarray, "n 3 3"], low: float, high: float) -> Bool[np.ndarray, " n"]:
    """Which triangles are half of a wall from floor to ceiling."""
    z = triangles[:, :, 2]
    ends = (np.abs(z - low) < _SAME) | (np.abs(z - high) < _SAME)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normal, axis=1)
    upright = np.abs(normal[:, 2]) <= _SAME * np.maximum(size, 1e-12)
    found: Bool[np.ndarray, " n"] = (
        ends.all(axis=1) & (np.ptp(z, axis=1) > high - low - 2 * _SAME) & upright & (size > 0)
    )
    return found


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
def _draw_plan(
    segments: np.ndarray, corner: np.ndarray, first: np.ndarray, members: np.ndarray,
    shade: UInt8[np.ndarray, " n"], place: np.ndarray, ahead: np.ndarray, right: np.ndarray,
    floor: float, top: float, has_floor: bool, has_top: bool,
    focal: float, near: float, far: float, depth: np.ndarray, rgb: np.ndarray,
) -> None:  # fmt: skip
    """Walls, floor and ceiling, column by column; `rgb` of no rows for none."""
    height, width = depth.shape
    coloured = len(rgb) > 0
    for j in range(width):
        x = (j + 0.5 - 0.5 * width) / focal
        wall, who = nearest_wall(
            segments, corner, first, members, place[0], place[1],
            ahead[0] + x * right[0], ahead[1] + x * right[1], far,
        )  # fmt: skip
        for i in range(height):
            y = (i + 0.5 - 0.5 * height) / focal
            z, grey = wall, 0
            if who >= 0:
                grey = shade[who]
            if y > 0 and (floor - place[2]) / -y < z:
                z, grey = (place[2] - floor) / y if has_floor else np.inf, _FLOOR
            elif y < 0 and (top - place[2]) / -y < z:
                z, grey = (place[2] - top) / y if has_top else np.inf, _CEILING
            if near <= z <= far:
                depth[i, j] = z
                if coloured:
                    rgb[i, j, :] = grey


@compiled
def _draw_triangles(
    triangles: np.ndarray, place: np.ndarray, turn: np.ndarray, colours: np.ndarray,
    focal: float, near: float, far: float, depth: np.ndarray, rgb: np.ndarray,
) -> None:  # fmt: skip
    """Triangles over what is drawn already, where they are nearer; `turn` goes into the camera's frame."""
    height, width = depth.shape
    coloured = len(rgb) > 0
    seen, e = np.empty((3, 3)), np.empty((3, 3))
    wide, high = 0.5 * width / focal, 0.5 * height / focal
    for k in range(len(triangles)):
        outside = np.zeros(6, np.int64)
        for corner in range(3):
            for axis in range(3):
                seen[corner, axis] = 0.0
                for other in range(3):
                    seen[corner, axis] += turn[axis, other] * (triangles[k, corner, other] - place[other])
            x, y, z = seen[corner]
            outside[0] += z <= near
            outside[1] += z >= far
            outside[2] += x < -wide * z
            outside[3] += x > wide * z
            outside[4] += y < -high * z
            outside[5] += y > high * z
        if outside.max() == 3:  # all of it beyond one side of what the camera sees
            continue
        a, b, c = seen[0], seen[1], seen[2]
        # Columns of the inverse of (a, b, c) as rows: weight of a corner over z, linear in (x / z, y / z, 1).
        e[0, 0], e[0, 1], e[0, 2] = (
            b[1] * c[2] - b[2] * c[1],
            b[2] * c[0] - b[0] * c[2],
            b[0] * c[1] - b[1] * c[0],
        )
        e[1, 0], e[1, 1], e[1, 2] = (
            c[1] * a[2] - c[2] * a[1],
            c[2] * a[0] - c[0] * a[2],
            c[0] * a[1] - c[1] * a[0],
        )
        e[2, 0], e[2, 1], e[2, 2] = (
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        )
        volume = a[0] * e[0, 0] + a[1] * e[0, 1] + a[2] * e[0, 2]
        if volume == 0.0:
            continue
        low_i, high_i, low_j, high_j = 0, height, 0, width
        if min(a[2], b[2], c[2]) > near:
            u = (focal * a[0] / a[2], focal * b[0] / b[2], focal * c[0] / c[2])
            v = (focal * a[1] / a[2], focal * b[1] / b[2], focal * c[1] / c[2])
            low_j, high_j = max(int(min(u) + 0.5 * width), 0), min(int(max(u) + 0.5 * width) + 1, width)
            low_i, high_i = max(int(min(v) + 0.5 * height), 0), min(int(max(v) + 0.5 * height) + 1, height)
        for i in range(low_i, high_i):
            y = (i + 0.5 - 0.5 * height) / focal
            for j in range(low_j, high_j):
                x = (j + 0.5 - 0.5 * width) / focal
                wa = (e[0, 0] * x + e[0, 1] * y + e[0, 2]) / volume
                wb = (e[1, 0] * x + e[1, 1] * y + e[1, 2]) / volume
                wc = (e[2, 0] * x + e[2, 1] * y + e[2, 2]) / volume
                if wa < 0 or wb < 0 or wc < 0 or wa + wb + wc <= 0:
                    continue
                z = 1.0 / (wa + wb + wc)
                if near <= z <= far and (depth[i, j] == 0 or z < depth[i, j]):
                    depth[i, j] = z
                    if coloured:
                        rgb[i, j, :] = colours[k]
