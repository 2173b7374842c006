"""An RGB-D camera by pyrender, on OSMesa or EGL.

pyrender holds the scene, the shaders and the meshes; `robosim.camera.rendering.flat_pass` draws them. Made by
`robosim.camera.cameras.make_camera`, which binds PyOpenGL before this module imports pyrender.

Things are drawn as far as infinity, and left out afterwards if they are beyond the far plane. With 0 at infinity
and C = 2^24 - 1 at the near plane, the depth buffer's code c stands for the depth near C / c.
"""

import weakref
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
import pyrender
import trimesh
from jaxtyping import Float, Float32, Int32, UInt8
from OpenGL import contextdata

from robosim.camera.model import RGBD, CameraConfig
from robosim.camera.rendering import gl_calls as gl
from robosim.camera.rendering.flat_pass import FlatPass
from robosim.camera.rendering.gl_libraries import GLSystem
from robosim.camera.rendering.gl_platform import MAX_DEPTH_CODE, OSMesaPlatform
from robosim.camera.rendering.scenery import Scenery, merge
from robosim.camera.rendering.visibility import Parts, Visibility


class PyrenderCamera:
    """Draws pictures with OpenGL.

    Each camera has a context of its own, which is this thread's current one only while a picture is drawn.
    Cameras work in forked and in spawned processes; one that was made before a fork serves both.
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig, system: GLSystem) -> None:
        """Make a context and bring the meshes there; see `robosim.camera.cameras.make_camera`."""
        self.config = config
        self._scenery = merge(meshes)
        triangles = self._scenery.vertices[self._scenery.faces]
        parts = Parts.of(triangles)
        self._visibility = Visibility(triangles, parts, config)
        self.scene = _make_scene(self._scenery, self._scenery.faces[parts.order], config)
        self._unit = np.float32(config.near_m * MAX_DEPTH_CODE)
        self._least = np.float32(config.near_m * MAX_DEPTH_CODE / config.far_m)
        self.platform = _make_platform(system, config)
        self.platform.init_context()
        self.renderer = _SceneRenderer(self.platform)
        # Runs at the end of the process too, while the modules that it needs are still there.
        self._free = weakref.finalize(self, _free, self.platform, self.renderer)
        self._pass = FlatPass(self.scene, parts.counts, self.renderer, self.platform.calls)
        self.platform.make_uncurrent()

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose.

        Raises:
            ValueError: If the pose is not a 4 by 4 matrix of finite numbers.
            RuntimeError: If the camera is closed.
        """
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

    def render_scene(
        self, T_map_camera: Float[np.ndarray, "4 4"], flags: int = pyrender.RenderFlags.NONE
    ) -> UInt8[np.ndarray, "h w 3"]:
        """The picture that pyrender itself draws of `scene`, with the lights and meshes that were added to it.

        Args:
            T_map_camera: The camera's pose; everything in `scene` is relative to `origin`.
            flags: What pyrender shall draw, and how.

        Raises:
            ValueError: If the pose is not a 4 by 4 matrix of finite numbers.
            RuntimeError: If the camera is closed.
        """
        self._check_open()
        R, t = self._scenery.to_local(T_map_camera)
        T_scene_gl = np.eye(4)
        T_scene_gl[:3, :3], T_scene_gl[:3, 3] = R * (1.0, -1.0, -1.0), t
        self.scene.set_pose(self.scene.main_camera_node, T_scene_gl)
        self.platform.make_current()
        self._pass.reset_state()
        self.renderer.render(self.scene, flags)
        self.platform.calls.finish()
        rgb = self.platform.read_rgb()
        self.platform.make_uncurrent()
        return rgb

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        """Origin of `scene` in `map` [m]."""
        return self._scenery.centre

    def close(self) -> None:
        """Free the context and what is in it; nothing happens the second time."""
        self._free()

    def __enter__(self) -> "PyrenderCamera":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _draw(self, T_map_camera: Float[np.ndarray, "4 4"], *, colour: bool) -> None:
        self._check_open()
        R, t = self._scenery.to_local(T_map_camera)
        seen = self._visibility.parts(R, t)
        self.platform.make_current()
        self._pass.draw(self._projection_view(R, t), seen, colour=colour)

    def _check_open(self) -> None:
        if not self._free.alive:
            raise RuntimeError("The camera is closed. Make a new one with make_camera.")

    def _projection_view(self, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> list[float]:
        """Clip coordinates of points in the scene's frame: a matrix row by row, the far plane at infinity.

        Formed in double precision, since rounding projection and view one by one would cost accuracy; and by hand,
        since calls of NumPy cost more than so few numbers.
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


class _SceneRenderer(pyrender.Renderer):
    """pyrender's renderer, drawing into the platform's frame buffer wherever pyrender means the screen's, number 0.

    On EGL there is no screen, and what is drawn to number 0 ends in an error.
    """

    def __init__(self, platform: Any) -> None:
        super().__init__(platform.viewport_width, platform.viewport_height)
        self._platform = platform

    def _configure_forward_pass_viewport(self, flags: int) -> None:
        super()._configure_forward_pass_viewport(flags)
        if not flags & pyrender.RenderFlags.OFFSCREEN:
            self._platform.calls.bind_framebuffer(gl.FRAMEBUFFER, self._platform.frame)


def _make_scene(scenery: Scenery, faces: Int32[np.ndarray, "n 3"], config: CameraConfig) -> pyrender.Scene:
    """A pyrender scene with all meshes as one, and a camera for what pyrender itself draws."""
    opaque = np.full((len(scenery.colours), 1), 255, np.uint8)
    primitive = pyrender.Primitive(
        positions=scenery.vertices,
        indices=faces,
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
    scene.add(camera)
    return scene


def _free(platform: Any, renderer: pyrender.Renderer) -> None:
    platform.make_current()
    renderer.delete()
    contextdata.cleanupContext()  # what PyOpenGL remembers about this context, which it would keep for ever
    platform.make_uncurrent()
    platform.delete_context()


def _make_platform(system: GLSystem, config: CameraConfig) -> Any:
    if system == "osmesa":
        return OSMesaPlatform(config.width, config.height)
    from robosim.camera.rendering.egl_platform import EGLPlatform

    return EGLPlatform(config.width, config.height)
