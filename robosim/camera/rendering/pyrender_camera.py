"""An RGB-D camera by pyrender, on OSMesa or EGL.

pyrender brings the mesh to the GPU; `robosim.camera.rendering.flat_pass` draws it. Made by
`robosim.camera.cameras.make_camera`, which binds PyOpenGL before this module imports pyrender.

Things are drawn as far as infinity, and left out afterwards if they are beyond the far plane. With 0 at infinity
and C = 2^24 - 1 at the near plane, the depth buffer's code c stands for the depth near C / c.
"""

import weakref
from collections.abc import Sequence

import numpy as np
import pyrender
import trimesh
from jaxtyping import Float, Float32
from OpenGL import contextdata

from robosim.camera.model import RGBD, CameraConfig, ClosingCamera
from robosim.camera.rendering.flat_pass import FlatPass
from robosim.camera.rendering.gl_platforms import MAX_DEPTH_CODE, GLPlatform, make_platform
from robosim.camera.rendering.gl_systems import GLSystem
from robosim.camera.rendering.merged_meshes import merge
from robosim.camera.rendering.visibility import Parts, Visibility


class PyrenderCamera(ClosingCamera):
    """Draws pictures with OpenGL.

    Each camera has a context of its own, which is this thread's current one only while a picture is drawn.
    Cameras work in forked and in spawned processes; one that was made before a fork serves both.
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig, system: GLSystem) -> None:
        """Make a context and bring the meshes there; see `robosim.camera.cameras.make_camera`."""
        self.config = config
        self._scenery = merge(meshes)
        triangles = self._scenery.triangles
        parts = Parts.of(triangles)
        self._visibility = Visibility(triangles, parts, config)
        self._unit = np.float32(config.near_m * MAX_DEPTH_CODE)
        self._least = np.float32(config.near_m * MAX_DEPTH_CODE / config.far_m)
        opaque = np.full((len(self._scenery.colours), 1), 255, np.uint8)
        primitive = pyrender.Primitive(
            positions=self._scenery.vertices,
            indices=self._scenery.faces[parts.order],
            color_0=np.concatenate([self._scenery.colours, opaque], axis=1),
        )
        self.platform = make_platform(system, config.width, config.height)
        # Runs at the end of the process too, while the modules that it needs are still there.
        self._free = weakref.finalize(self, _free, self.platform, primitive)
        self._pass = FlatPass(primitive, parts.counts, self.platform)
        self.platform.make_uncurrent()

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose; RuntimeError if the camera is closed."""
        self._draw(T_map_camera, colour=True)
        rgb = self.platform.read_rgb()
        depth, whole = self._metres(self.platform.read_depth_code())
        self.platform.make_uncurrent()
        if not whole:
            rgb[depth == 0] = 0
        return RGBD(rgb, depth)

    def render_depth(self, T_map_camera: Float[np.ndarray, "4 4"]) -> Float32[np.ndarray, "h w"]:
        """Take the depth of a picture only, which is faster; raises as `render` does."""
        self._draw(T_map_camera, colour=False)
        depth, _ = self._metres(self.platform.read_depth_code())
        self.platform.make_uncurrent()
        return depth

    def close(self) -> None:
        """Free the context and what is in it; nothing happens the second time."""
        self._free()

    def _draw(self, T_map_camera: Float[np.ndarray, "4 4"], *, colour: bool) -> None:
        if not self._free.alive:
            raise RuntimeError("The camera is closed. Make a new one with make_camera.")
        R, t = self._scenery.to_local(T_map_camera)
        seen = self._visibility.parts(R, t)
        self.platform.make_current()
        self._pass.draw(self._projection_view(R, t), seen, colour=colour)

    def _projection_view(self, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> list[float]:
        """Clip coordinates of points in the scene's frame: a matrix row by row, the far plane at infinity.

        Formed in double precision, since rounding projection and view one by one would cost accuracy; and by hand,
        since calls of NumPy take longer for so few numbers.
        """
        config, (x, y, z) = self.config, t.tolist()
        across, down, ahead = ([u, v, w, -u * x - v * y - w * z] for u, v, w in R.T.tolist())
        column, row = 2 * config.focal_px / config.width, -2 * config.focal_px / config.height
        return [
            *(column * value for value in across),
            *(row * value for value in down),
            *ahead[:3],
            ahead[3] - 2 * config.near_m,
            *ahead,
        ]

    def _metres(self, code: np.ndarray) -> tuple[Float32[np.ndarray, "h w"], bool]:
        """Depth of a frame [m], and whether something is seen in all of its pixels."""
        nearness = code.astype(np.float32)  # exact, as it has 24 bits
        if nearness.min() >= self._least:
            return np.divide(self._unit, nearness, out=nearness), True
        seen = nearness >= self._least
        return np.divide(self._unit, nearness, out=np.zeros_like(nearness), where=seen), False


def _free(platform: GLPlatform, primitive: pyrender.Primitive) -> None:
    platform.make_current()
    primitive.delete()
    contextdata.cleanupContext()  # PyOpenGL would keep what it stores about this context
    platform.make_uncurrent()
    platform.delete_context()
