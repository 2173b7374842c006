"""An RGB-D camera by pyrender, on OSMesa or EGL.

Made by `robosim.camera.cameras.make_camera`, which binds PyOpenGL before this module imports pyrender. pyrender
brings the vertices to the GPU. It is not used to draw triangles: at every frame it looks up the shaders of each
primitive, sets a dozen uniforms by their names, and sets and undoes all state, each time with PyOpenGL's checks. Here
a frame is: clear, set one matrix, and draw, in one call, those runs of triangles that can be seen.

That is enough for opaque triangles without lights and textures. Uses internals of pyrender 0.1.45, which this project
pins.

Things are drawn as far as infinity, and left out afterwards if they are beyond the far plane. With 0 at infinity
and C = 2^24 - 1 at the near plane, the depth buffer's code c stands for the depth near C / c.
"""

import ctypes
import weakref
from collections.abc import Sequence

import numpy as np
import pyrender
import trimesh
from jaxtyping import Float, Float32, Int
from OpenGL import GL, contextdata
from OpenGL.GL import shaders

from robosim.camera.model import RGBD, CameraConfig, ClosingCamera
from robosim.camera.rendering.gl_platforms import MAX_DEPTH_CODE, GLPlatform, make_platform
from robosim.camera.rendering.gl_systems import GLSystem
from robosim.camera.rendering.merged_meshes import merge
from robosim.camera.rendering.visibility import Parts, Visibility

_VERTEX = """
#version 330 core
layout(location = 0) in vec3 position;  // locations as pyrender gives them to positions and colours
layout(location = 1) in vec4 color_0;
uniform mat4 P_V;
out vec3 color;
void main() {
    gl_Position = P_V * vec4(position, 1.0);
    color = color_0.rgb;
}
"""
_COLOUR = """
#version 330 core
in vec3 color;
out vec4 frag_color;
void main() { frag_color = vec4(color, 1.0); }
"""


class FlatPass:
    """Draws one mesh, which stays as it is, in its vertex colours.

    The depth buffer is reversed: 0 is infinitely far, its greatest value at the near plane.
    """

    def __init__(
        self, primitive: pyrender.Primitive, run_lengths: Int[np.ndarray, " n"], platform: GLPlatform
    ) -> None:
        """Bring the mesh to the platform's context, which must be current, and set all that drawing depends on.

        The primitive is of opaque indexed triangles with positions and vertex colours only. Each run of them can be
        drawn without the others.
        """
        self._calls = platform.calls
        primitive._add_to_context()
        program = _compile(_VERTEX, _COLOUR)
        self._P_V = GL.glGetUniformLocation(program, "P_V")
        self._counts = (3 * run_lengths).astype(np.int32)  # three indices per triangle, of four bytes each
        self._offsets = (12 * (np.cumsum(run_lengths) - run_lengths)).astype(np.uint64)
        self._drawn_counts, self._drawn_offsets = self._counts.copy(), self._offsets.copy()
        GL.glViewport(0, 0, platform.width, platform.height)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthFunc(GL.GL_GREATER)
        GL.glDepthRange(1.0, 0.0)
        GL.glClearDepth(0.0)
        GL.glEnable(GL.GL_CULL_FACE)
        GL.glClearColor(0.0, 0.0, 0.0, 1.0)
        GL.glBindVertexArray(primitive._vaid)
        GL.glUseProgram(program)
        # Read once: NumPy's `ctypes` takes longer than a call of OpenGL.
        self._addresses = self._drawn_counts.ctypes.data, self._drawn_offsets.ctypes.data
        self._bits = int(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
        self._triangles, self._index_type = int(GL.GL_TRIANGLES), int(GL.GL_UNSIGNED_INT)

    def draw(self, P_V: Sequence[float], runs: Int[np.ndarray, " n"]) -> None:
        """Draw some runs of triangles to the current context and wait for the end.

        `P_V` is projection times view, row by row: clip coordinates of points in the scene's frame.
        """
        calls = self._calls
        calls.glClear(self._bits)
        calls.glUniformMatrix4fv(self._P_V, 1, 1, (ctypes.c_float * 16)(*P_V))
        n = len(runs)
        self._counts.take(runs, out=self._drawn_counts[:n], mode="clip")
        self._offsets.take(runs, out=self._drawn_offsets[:n], mode="clip")
        counts, offsets = self._addresses
        calls.glMultiDrawElements(self._triangles, counts, self._index_type, offsets, n)
        calls.glFinish()


def _compile(vertex: str, fragment: str) -> int:
    stages = (vertex, GL.GL_VERTEX_SHADER), (fragment, GL.GL_FRAGMENT_SHADER)
    compiled = [shaders.compileShader(source.strip(), kind) for source, kind in stages]
    program = GL.glCreateProgram()
    for shader in compiled:
        GL.glAttachShader(program, shader)
    GL.glLinkProgram(program)
    if not GL.glGetProgramiv(program, GL.GL_LINK_STATUS):
        raise RuntimeError(
            f"The OpenGL driver cannot link the flat shaders: {GL.glGetProgramInfoLog(program)}"
        )
    for shader in compiled:
        GL.glDeleteShader(shader)
    return int(program)


class PyrenderCamera(ClosingCamera):
    """Draws pictures with OpenGL.

    Each camera has a context of its own, which is this thread's current one only while a picture is drawn.
    Cameras work in forked and in spawned processes; a camera that was made before a fork serves both.
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh], config: CameraConfig, system: GLSystem) -> None:
        """Make a context and bring the meshes there; see `robosim.camera.cameras.make_camera`."""
        self.config = config
        self._scenery = merge(meshes)
        scenery, triangles = self._scenery, self._scenery.triangles
        parts = Parts.of(triangles, scenery.colours[scenery.faces], float(config.focal_px))
        self._visibility = Visibility(triangles, parts, config)
        self._unit = np.float32(config.near_m * MAX_DEPTH_CODE)
        self._least = np.float32(config.near_m * MAX_DEPTH_CODE / config.far_m)
        positions, colours, counts = scenery.vertices, scenery.colours, parts.counts
        faces = scenery.faces[parts.order]
        if parts.blocks is not None:
            fans = parts.blocks.fans.reshape(-1, 3)
            faces = np.vstack([faces, len(positions) + np.arange(len(fans), dtype=np.int32).reshape(-1, 3)])
            positions = np.vstack([positions, fans])
            colours = np.vstack([colours, np.repeat(parts.blocks.colours, 3, axis=0)])
            counts = np.concatenate([counts, parts.blocks.counts])
        opaque = np.full((len(colours), 1), 255, np.uint8)
        primitive = pyrender.Primitive(
            positions=positions, indices=faces, color_0=np.concatenate([colours, opaque], axis=1)
        )
        self.platform = make_platform(system, config.width, config.height)
        # Runs at the end of the process too, while the modules that it needs are still there.
        self._free = weakref.finalize(self, _free, self.platform, primitive)
        self._pass = FlatPass(primitive, counts, self.platform)
        self.platform.make_uncurrent()

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose; RuntimeError if the camera is closed."""
        if not self._free.alive:
            raise RuntimeError("The camera is closed. Make a new one with make_camera.")
        R, t = self._scenery.to_local(T_map_camera)
        seen = self._visibility.parts(R, t)
        self.platform.make_current()
        self._pass.draw(self._projection_view(R, t), seen)
        rgb = self.platform.read_rgb()
        depth, whole = self._metres(self.platform.read_depth_code())
        self.platform.make_uncurrent()
        if not whole:
            rgb[depth == 0] = 0
        return RGBD(rgb, depth)

    def close(self) -> None:
        """Free the context and what is in it; nothing happens the second time."""
        self._free()

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
