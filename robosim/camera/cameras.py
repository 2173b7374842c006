"""Cameras by the engine that takes their pictures.

Two engines see the same: pyrender draws triangles with OpenGL, Embree casts a ray for each pixel. A third, plan, sees
the same depth in schematic colours, by one ray a column. All work about a centre of their own, so that a building may
lie kilometres from the origin of `map`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, Float32

from robosim.camera.model import RGBD, Camera, CameraConfig
from robosim.camera.rendering.gl_binding import bind_opengl
from robosim.camera.rendering.gl_libraries import GLSystem
from robosim.parts import CAMERA
from robosim.support.parts import Part


def make_camera(
    meshes: Sequence[trimesh.Trimesh],
    config: CameraConfig = CameraConfig(),
    *,
    backend: Part = "pyrender",
    platform: GLSystem | None = None,
) -> Camera:
    """A camera that sees some meshes in the colours of their vertices.

    Args:
        meshes: What there is to see, in `map`; it stays as it is. Colours are taken as they are, without
            further light. pyrender shows faces from the side only that their normals point to.
        config: Size and optics.
        backend: "pyrender" draws with OpenGL; "embree" casts rays, is slower, and needs no OpenGL; "plan" is for
            depth, several times faster, its colours schematic; "none" sees nothing. Or another of
            `robosim.parts.CAMERA`.
        platform: What OpenGL runs on, "osmesa" or "egl"; by default OSMesa if it is installed, else EGL.
            A process can use one of them only.

    Raises:
        ValueError: If there is nothing to see, a vertex is not finite, or the backend is unknown.
        OpenGLError: If neither OSMesa nor EGL is installed, or its driver cannot draw; an OSError.
        RuntimeError: If OpenGL serves another platform in this process already.
    """
    options: dict[str, Any] = {} if platform is None else {"platform": platform}
    camera: Camera = CAMERA.make(backend, meshes, config, field="backend", **options)
    return camera


def pyrender_camera(
    meshes: Sequence[trimesh.Trimesh], config: CameraConfig, platform: GLSystem | None = None
) -> Camera:
    """Draws with OpenGL."""
    system = bind_opengl(platform)  # has to come before pyrender is imported
    from robosim.camera.rendering.pyrender_camera import PyrenderCamera

    return PyrenderCamera(meshes, config, system)


def embree_camera(
    meshes: Sequence[trimesh.Trimesh], config: CameraConfig, platform: GLSystem | None = None
) -> Camera:
    """Casts rays, whatever platform is asked for."""
    from robosim.camera.rendering.embree_camera import EmbreeCamera

    return EmbreeCamera(meshes, config)


def plan_camera(
    meshes: Sequence[trimesh.Trimesh], config: CameraConfig, platform: GLSystem | None = None
) -> Camera:
    """Casts a ray for each column, whatever platform is asked for."""
    from robosim.camera.rendering.plan_camera import PlanCamera

    return PlanCamera(meshes, config)


class NoCamera:
    """The camera of a robot that has none: its pictures are black, and nothing is measured in them."""

    def __init__(
        self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig, platform: GLSystem | None = None
    ) -> None:
        shape = config.height, config.width
        self._frame = RGBD(np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32))

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """A black picture."""
        return self._frame

    def render_depth(self, T_map_camera: Float[np.ndarray, "4 4"]) -> Float32[np.ndarray, "h w"]:
        """No depth."""
        return self._frame.depth

    def close(self) -> None:
        """There is nothing to free."""
