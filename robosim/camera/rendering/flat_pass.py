"""Drawing triangles in the colours of their vertices, with the least work that a frame takes.

pyrender brings the vertices to the GPU. It is not used to draw: at every frame it looks up the shaders of each
primitive, sets a dozen uniforms by their names, and sets and undoes all state, each time with PyOpenGL's checks. Here
a frame is: clear, set one matrix, and draw, in one call, those runs of triangles that can be seen.

That is enough for opaque triangles without lights and textures. Uses internals of pyrender 0.1.45, which this project
pins. Import only after `robosim.camera.rendering.gl_systems.bind_opengl`.
"""

import ctypes
from collections.abc import Sequence

import numpy as np
import pyrender
from jaxtyping import Int
from OpenGL import GL
from OpenGL.GL import shaders

from robosim.camera.rendering.gl_platforms import GLPlatform

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
_DEPTH = """
#version 330 core
void main() {}
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
        self._programs = {True: _compile(_VERTEX, _COLOUR), False: _compile(_VERTEX, _DEPTH)}
        self._P_V = {key: GL.glGetUniformLocation(program, "P_V") for key, program in self._programs.items()}
        self._counts = (3 * run_lengths).astype(np.int32)  # three indices per triangle, of four bytes each
        self._offsets = (12 * (np.cumsum(run_lengths) - run_lengths)).astype(np.uint64)
        self._drawn_counts, self._drawn_offsets = self._counts.copy(), self._offsets.copy()
        self._draws_colour: bool | None = None
        GL.glViewport(0, 0, platform.width, platform.height)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthFunc(GL.GL_GREATER)
        GL.glDepthRange(1.0, 0.0)
        GL.glClearDepth(0.0)
        GL.glEnable(GL.GL_CULL_FACE)
        GL.glClearColor(0.0, 0.0, 0.0, 1.0)
        GL.glBindVertexArray(primitive._vaid)
        # Read once: NumPy's `ctypes` takes longer than a call of OpenGL.
        self._addresses = self._drawn_counts.ctypes.data, self._drawn_offsets.ctypes.data
        self._bits = int(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
        self._triangles, self._index_type = int(GL.GL_TRIANGLES), int(GL.GL_UNSIGNED_INT)

    def draw(self, P_V: Sequence[float], runs: Int[np.ndarray, " n"], *, colour: bool = True) -> None:
        """Draw some runs of triangles to the current context and wait for the end; depth always, colours on demand.

        `P_V` is projection times view, row by row: clip coordinates of points in the scene's frame.
        """
        calls = self._calls
        if colour != self._draws_colour:
            calls.glColorMask(*[int(colour)] * 4)
            calls.glUseProgram(self._programs[colour])
            self._draws_colour = colour
        calls.glClear(self._bits)
        calls.glUniformMatrix4fv(self._P_V[colour], 1, 1, (ctypes.c_float * 16)(*P_V))
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
