"""An RGB-D camera by ray casting with Embree, which the drawing camera is tested against.

One ray goes through the centre of each pixel. Its direction is one metre long along the camera's z axis, so that
the distance at which Embree finds a triangle is the depth. Colours are interpolated between the three vertices by
the barycentric coordinates of the hit, which equals OpenGL's perspective-correct interpolation.

OpenGL leaves out faces that are seen from behind; here rays are stopped by both sides of a face.
"""

from collections.abc import Sequence

import numpy as np
import trimesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float

from robosim.camera.model import RGBD, CameraConfig, ClosingCamera
from robosim.camera.rendering.merged_meshes import merge
from robosim.support.ray_casting import make_ray_scene


class EmbreeCamera(ClosingCamera):
    """Casts a ray for each pixel, on one core. Needs no OpenGL; works in any process and thread."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig) -> None:
        """Build the tree of triangles; see `robosim.camera.cameras.make_camera`."""
        self.config = config
        self._scenery = merge(meshes)
        self._scene: EmbreeScene | None = make_ray_scene(self._scenery.triangles)
        a, b, c = np.moveaxis(self._scenery.colours[self._scenery.faces].astype(np.float32), 1, 0)
        self._colour, self._along_u, self._along_v = a + np.float32(0.5), b - a, c - a
        self._x, self._y = config.directions()[0, :, :1], config.directions()[:, :1, 1:2]

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose; RuntimeError if the camera is closed."""
        if self._scene is None:
            raise RuntimeError("The camera is closed. Make a new one with make_camera.")
        R, t = self._scenery.to_local(T_map_camera)
        # Not one product of matrices: that size would start the threads of the linear algebra library.
        directions = (self._x * R[:, 0] + (self._y * R[:, 1] + R[:, 2])).astype(np.float32).reshape(-1, 3)
        near = np.float32(self.config.near_m)
        hits = self._scene.run(t.astype(np.float32) + near * directions, directions, output=True)
        depth = hits["tfar"] + near
        depth[(hits["primID"] < 0) | (depth > self.config.far_m)] = 0.0  # none between near and far plane
        face = hits["primID"]
        rgb = self._colour[face]
        rgb += self._along_u[face] * hits["u"][:, None]
        rgb += self._along_v[face] * hits["v"][:, None]
        rgb[depth == 0] = 0.0
        shape = self.config.height, self.config.width
        return RGBD(rgb.astype(np.uint8).reshape(*shape, 3), depth.reshape(shape))

    def close(self) -> None:
        """Free the tree; nothing happens the second time."""
        self._scene = None
