"""An RGB-D camera by pyrender, on OSMesa or EGL.

pyrender holds the scene, the shaders and the meshes; `robosim.flat_pass` draws them. Made by
`robosim.camera.make_camera`, which binds PyOpenGL before this module imports pyrender.

Things are drawn as far as infinity, and what is beyond the far plane is left out afterwards. Code c of a depth
buffer with C = 2^24 - 1 then stands for the depth z = near C / (C - c). C - c is formed of whole numbers: 1 - c / C
in single precision would lose what is far away.
"""

import weakref
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
import pyrender
import trimesh
from jaxtyping import Float, Float32, Int32
from OpenGL import contextdata

from robosim.camera import RGBD, CameraConfig
from robosim.flat_pass import FlatPass
from robosim.gl_binding import GLSystem
from robosim.gl_platform import MAX_DEPTH_CODE, OSMesaPlatform
from robosim.scenery import Scenery, merge
from robosim.visibility import Parts, Visibility


class PyrenderCamera:
    """Draws pictures with OpenGL.

    Each camera has a context of its own, which is this thread's current one only while a picture is drawn.
    Cameras work in forked and in spawned processes; one that was made before a fork serves both.
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig, system: GLSystem) -> None:
        """Make a context and bring the meshes there; see `robosim.camera.make_camera`."""
        self.config = config
        self._scenery = merge(meshes)
        triangles = self._scenery.vertices[self._scenery.faces]
        parts = Parts.of(triangles)
        self._visibility = Visibility(triangles, parts, config)
        self._count = (3 * parts.counts).astype(np.int32)
        self._offset = (12 * parts.starts).astype(np.uint64)  # three indices of four bytes for each triangle
        self.scene = _make_scene(self._scenery, self._scenery.faces[parts.order], config)
        self._P = _projection(config)
        self._unit = np.float32(config.near_m * MAX_DEPTH_CODE)
        self._far = int(config.near_m * MAX_DEPTH_CODE / config.far_m)
        self._nearness = np.empty((config.height, config.width), np.uint32)
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

    def __enter__(self) -> "PyrenderCamera":
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
        seen = self._visibility.parts(R, t)
        self._pass.draw(P_V, self._count[seen], self._offset[seen], colour=colour)

    def _metres(self, code: np.ndarray) -> tuple[Float32[np.ndarray, "h w"], bool]:
        """Depth of a frame [m], and whether something is seen in all of its pixels."""
        # This is MAX_DEPTH_CODE - code, as all bits of the former are ones.
        nearness = np.bitwise_xor(code, MAX_DEPTH_CODE, out=self._nearness)
        depth = nearness.astype(np.float32)
        if nearness.min() > self._far:
            return np.divide(self._unit, depth, out=depth), True
        return np.divide(self._unit, depth, out=np.zeros_like(depth), where=nearness > self._far), False


def _projection(config: CameraConfig) -> Float[np.ndarray, "4 4"]:
    """Clip coordinates of points in the camera frame, with the far plane at infinity."""
    P = np.zeros((4, 4))
    P[0, 0] = 2 * config.focal_px / config.width
    P[1, 1] = -2 * config.focal_px / config.height
    P[2, 2:] = 1.0, -2 * config.near_m
    P[3, 2] = 1.0
    return P


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
    from robosim.egl_platform import EGLPlatform

    return EGLPlatform(config.width, config.height)
