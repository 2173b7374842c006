"""An RGB-D camera by pyrender, on OSMesa or EGL.

pyrender holds the scene, the shaders and the meshes; `robosim.flat_pass` draws them. Made by
`robosim.camera.make_camera`, which binds PyOpenGL before this module imports pyrender.

Code c of a depth buffer with C = 2^24 - 1 stands for the depth z with

    1 / z = 1 / far + (C - c) / C * (1 / near - 1 / far).

C - c is formed of whole numbers: 1 - c / C in single precision would lose what is far away.
"""

import weakref
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np
import pyrender
import trimesh
from jaxtyping import Float, Float32

from robosim.camera import RGBD, CameraConfig
from robosim.flat_pass import FlatPass
from robosim.gl_binding import GLSystem
from robosim.gl_platform import MAX_DEPTH_CODE, OSMesaPlatform
from robosim.scenery import Scenery, merge

#: Turns coordinates in the camera frame (y down, z forward) to OpenGL's (y up, z backward).
CAMERA_TO_GL = np.diag([1.0, -1.0, -1.0, 1.0])


class PyrenderCamera:
    """Draws pictures with OpenGL.

    Each camera has a context of its own, which is this thread's current one only while a picture is drawn.
    Cameras work in forked and in spawned processes; one that was made before a fork serves both.
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig, system: GLSystem) -> None:
        """Make a context and bring the meshes there; see `robosim.camera.make_camera`."""
        self.config = config
        self._scenery = merge(meshes)
        self.scene, self._node = _make_scene(self._scenery, config)
        self._P = self._node.camera.get_projection_matrix(config.width, config.height) @ CAMERA_TO_GL
        self._inverse_far = np.float32(1 / config.far_m)
        self._inverse_step = np.float32((1 / config.near_m - 1 / config.far_m) / MAX_DEPTH_CODE)
        self.platform = _make_platform(system, config)
        self.platform.init_context()
        self.renderer = pyrender.Renderer(config.width, config.height)
        # Runs at the end of the process too, while the modules that it needs are still there.
        self._free = weakref.finalize(self, _free, self.platform, self.renderer)
        self._pass = FlatPass(self.scene, self.renderer, self.platform.calls)
        self.platform.make_uncurrent()

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose.

        Raises:
            ValueError: If the pose is not a 4 by 4 matrix of finite numbers.
            RuntimeError: If the camera is closed.
        """
        self._draw(T_map_camera, colour=True)
        frame = RGBD(self.platform.read_rgb(), self._metres(self.platform.read_depth_code()))
        self.platform.make_uncurrent()
        return frame

    def render_depth(self, T_map_camera: Float[np.ndarray, "4 4"]) -> Float32[np.ndarray, "h w"]:
        """Take the depth of a picture only, which is faster; raises as `render` does."""
        self._draw(T_map_camera, colour=False)
        depth = self._metres(self.platform.read_depth_code())
        self.platform.make_uncurrent()
        return depth

    def close(self) -> None:
        """Free the context and what is in it; nothing happens the second time."""
        self._free()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _draw(self, T_map_camera: Float[np.ndarray, "4 4"], *, colour: bool) -> None:
        if not self._free.alive:
            raise RuntimeError("The camera is closed. Make a new one with make_camera.")
        R, t = self._scenery.to_local(T_map_camera)
        P_V = np.empty((4, 4))
        P_V[:, :3] = self._P[:, :3] @ R.T
        P_V[:, 3] = self._P[:, 3] - P_V[:, :3] @ t
        self.platform.make_current()
        self._pass.draw(P_V, colour=colour)

    def _metres(self, code: np.ndarray) -> Float32[np.ndarray, "h w"]:
        nearness = MAX_DEPTH_CODE ^ code  # MAX_DEPTH_CODE - code, as all its bits are ones
        depth = nearness.astype(np.float32)
        depth *= self._inverse_step
        depth += self._inverse_far
        np.reciprocal(depth, out=depth)
        if not nearness.min():
            depth[nearness == 0] = 0.0
        return depth


def _make_scene(scenery: Scenery, config: CameraConfig) -> tuple[pyrender.Scene, pyrender.Node]:
    """A pyrender scene with all meshes as one, and its camera."""
    opaque = np.full((len(scenery.colours), 1), 255, np.uint8)
    primitive = pyrender.Primitive(
        positions=scenery.vertices,
        indices=scenery.faces,
        color_0=np.concatenate([scenery.colours, opaque], axis=1),
        material=pyrender.MetallicRoughnessMaterial(baseColorFactor=(1.0, 1.0, 1.0, 1.0)),
    )
    camera = pyrender.IntrinsicsCamera(
        fx=config.focal_px,
        fy=config.focal_px,
        cx=0.5 * config.width,
        cy=0.5 * config.height,
        znear=config.near_m,
        zfar=config.far_m,
    )
    scene = pyrender.Scene(bg_color=(0.0, 0.0, 0.0, 1.0))
    scene.add(pyrender.Mesh([primitive]))
    return scene, scene.add(camera)


def _free(platform: Any, renderer: pyrender.Renderer) -> None:
    platform.make_current()
    renderer.delete()
    platform.make_uncurrent()
    platform.delete_context()


def _make_platform(system: GLSystem, config: CameraConfig) -> Any:
    if system == "osmesa":
        return OSMesaPlatform(config.width, config.height)
    from robosim.egl_platform import EGLPlatform

    return EGLPlatform(config.width, config.height)
