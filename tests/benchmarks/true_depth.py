"""Depth as it should be: the judge of cameras.

Embree finds which triangle is behind the centre of a pixel; where its plane is met, is worked out in double
precision, so that no rounding of coordinates is left. Pixels where a thousandth of a pixel decides what is seen
are marked: engines may differ there, and both be right.
"""

from typing import NamedTuple

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float

from robosim.camera.model import CameraConfig

#: How far off the centre of a pixel one looks to find silhouettes [pixels]: the step of OpenGL's sub-pixel grid
#: is 1/256, and its corners may each be off by half of that.
SHAKE_PX = 1 / 64


class TrueDepth(NamedTuple):
    """Depth of one view."""

    depth: Float[np.ndarray, "h w"]
    """Metres along the view at the pixels' centres; 0 where nothing is hit."""
    sure: Bool[np.ndarray, "h w"]
    """Not at a silhouette: next to the centre the same plane is seen, within 0.5 mm + 0.05 %."""


class DepthJudge:
    """Works out the depth of views of one mesh."""

    def __init__(self, mesh: trimesh.Trimesh, config: CameraConfig) -> None:
        self._config = config
        self._centre = mesh.bounds.mean(axis=0)
        corners = mesh.triangles - self._centre
        self._normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._offsets = (self._normals * corners[:, 0]).sum(axis=1)
        self._scene = EmbreeScene(robust=True)
        self._triangles = TriangleMesh(self._scene, corners.astype(np.float32))

    def look(self, T_map_camera: Float[np.ndarray, "4 4"]) -> TrueDepth:
        """Depth of the view from a pose."""
        face, depth, _ = self._cast(T_map_camera, 0.0, 0.0)
        sure = np.ones(depth.shape, bool)
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            _, shifted, rays = self._cast(T_map_camera, dx * SHAKE_PX, dy * SHAKE_PX)
            same_plane = self._to_plane(face, T_map_camera, rays)
            sure &= np.abs(shifted - same_plane) < 5e-4 + 5e-4 * depth
        shape = self._config.height, self._config.width
        return TrueDepth(depth.reshape(shape), sure.reshape(shape))

    def _cast(self, T_map_camera: np.ndarray, dx_px: float, dy_px: float) -> tuple[np.ndarray, ...]:
        """Faces hit next to the centres of pixels, their depths [m], and the rays."""
        rays = self._config.directions()
        rays[..., :2] += np.array([dx_px, dy_px]) / self._config.focal_px
        rays = rays.reshape(-1, 3) @ T_map_camera[:3, :3].T
        start = T_map_camera[:3, 3] - self._centre + self._config.near_m * rays
        face = self._scene.run(start.astype(np.float32), rays.astype(np.float32), output=True)["primID"]
        return face, self._to_plane(face, T_map_camera, rays), rays

    def _to_plane(self, face: np.ndarray, T_map_camera: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Depth [m] at which rays meet the planes of faces; 0 for no face and beyond the far plane."""
        normal = self._normals[face]
        with np.errstate(divide="ignore", invalid="ignore"):
            to_plane = self._offsets[face] - normal @ (T_map_camera[:3, 3] - self._centre)
            depth = to_plane / (normal * rays).sum(axis=1)
        return np.where((face < 0) | ~(depth <= self._config.far_m), 0.0, depth)


def plain_depth(
    mesh: trimesh.Trimesh, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Distance to the first triangle in units of the directions, by trying them all; `inf` for none.

    Slow, short, and without Embree: what the judge itself is judged by. Rays closer than 1e-9 to an edge count
    as hits of both sides.

    Reference: Möller, Trumbore, "Fast, minimum storage ray-triangle intersection" (1997).
    """
    corner, side, other = mesh.triangles[:, 0], *(mesh.triangles[:, i] - mesh.triangles[:, 0] for i in (1, 2))
    s = origin - corner
    q = np.cross(s, side)
    distance = np.empty(len(directions))
    for i, direction in enumerate(directions):
        p = np.cross(direction, other)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / (side * p).sum(axis=1)
            u, v, t = scale * (s * p).sum(axis=1), scale * (q @ direction), scale * (q * other).sum(axis=1)
            hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 0)
        distance[i] = t[hit].min(initial=np.inf)
    return distance
