"""Cameras by name.

Two engines see the same: pyrender draws triangles with OpenGL, Embree casts a ray for each pixel. A third, plan, sees
the same depth in schematic colours, by one ray per column. All compute relative to a centre of their own, so that a
building may lie kilometres from the origin of `map`.
"""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float

from robosim.camera.model import RGBD, Camera, CameraConfig, ClosingCamera
from robosim.camera.rendering.gl_systems import bind_opengl
from robosim.parts import CAMERA
from robosim.support.parts import Part


def make_camera(
    meshes: Sequence[trimesh.Trimesh], config: CameraConfig = CameraConfig(), *, backend: Part = "pyrender"
) -> Camera:
    """A camera that sees some meshes in the colours of their vertices.

    Args:
        meshes: What there is to see, in `map`. Colours are taken as they are, without further light.
            pyrender shows faces from the side only that their normals point to.
        config: Size and optics.
        backend: "pyrender" draws with OpenGL; "embree" casts rays, is slower, and needs no OpenGL; "plan" is for
            depth, several times faster, its colours schematic; "none" sees nothing. Or another of
            `robosim.parts.CAMERA`.

    Raises:
        OpenGLError: If neither OSMesa nor EGL is installed, or its driver cannot draw; an OSError.
        RuntimeError: If OpenGL was bound to a display in this process already.
    """
    camera: Camera = CAMERA.make(backend, meshes, config, field="backend")
    return camera


def pyrender_camera(meshes: Sequence[trimesh.Trimesh], config: CameraConfig) -> Camera:
    """Draws with OpenGL, on OSMesa if it is installed, else on EGL (or as PYOPENGL_PLATFORM says)."""
    system = bind_opengl()  # before pyrender is imported
    from robosim.camera.rendering.pyrender_camera import PyrenderCamera

    return PyrenderCamera(meshes, config, system)


class NoCamera(ClosingCamera):
    """The camera of a robot that has none: its pictures are black, and nothing is measured in them."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig) -> None:
        shape = config.height, config.width
        self._frame = RGBD(np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32))

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """A black picture."""
        return self._frame
