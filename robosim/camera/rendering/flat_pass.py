"""Drawing a pyrender scene in flat colours, with the least work that a frame takes.

pyrender stays the owner of the scene and of its meshes on the GPU. Replaced is what it does at every frame: look
up the shaders of each primitive, set a dozen uniforms by their names, set and undo all state, each time with
PyOpenGL's checks around it. Here a frame is: set the state, clear, bind a program with one matrix, and draw, in
one call, those runs of triangles that can be seen. The shaders are smaller, too: pyrender's flat one carries
positions and material to each pixel, which nobody asks for and a software renderer has to work out.

That is enough for opaque triangles without textures, in the colours of their vertices. Anything else that pyrender
draws (lights, textures, transparency) still goes through `pyrender.Renderer.render` in the same context.

Uses internals of pyrender 0.1.45, the version that this project pins. Import only after
`robosim.camera.rendering.gl_binding.bind_opengl`.
"""

import ctypes
from collections.abc import Sequence

import numpy as np
import pyrender
from jaxtyping import Int
from OpenGL import GL
from OpenGL.GL import shaders
from pyrender.constants import GLTF, BufFlags, RenderFlags

from robosim.camera.rendering import gl_calls as gl
from robosim.camera.rendering.gl_calls import GLCalls

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

    The depth buffer is turned round: 0 is infinitely far, its greatest value at the near plane.
    """

    def __init__(
        self,
        scene: pyrender.Scene,
        counts: Int[np.ndarray, " n"],
        renderer: pyrender.Renderer,
        calls: GLCalls,
    ) -> None:
        """Bring the scene's mesh to the context, which must be current, and compile the shaders.

        Args:
            scene: Its mesh must be one, of opaque indexed triangles with vertex colours, and not moved.
            counts: How many triangles there are in each run, which can be drawn without the others.
            renderer: Renderer of the context.
            calls: OpenGL functions of the context.

        Raises:
            ValueError: If the scene is not like that.
        """
        self._size = renderer.viewport_width, renderer.viewport_height
        self._calls = calls
        self._background = tuple(float(x) for x in np.broadcast_to(scene.bg_color, 4))
        primitive = _only_primitive(scene)
        renderer._update_context(scene, RenderFlags.FLAT)
        self._vertex_array = int(primitive._vaid)
        self._programs = {True: _compile(_VERTEX, _COLOUR), False: _compile(_VERTEX, _DEPTH)}
        self._P_V = {
            key: calls.get_uniform_location(program, b"P_V") for key, program in self._programs.items()
        }
        self._counts = (3 * counts).astype(np.int32)  # three indices for a triangle, of four bytes each
        self._offsets = (12 * (np.cumsum(counts) - counts)).astype(np.uint64)
        self._some_counts, self._some_offsets = self._counts.copy(), self._offsets.copy()
        self._count_place, self._offset_place = self._some_counts.ctypes.data, self._some_offsets.ctypes.data
        self._state_for_colour: bool | None = None
        self.set_state(True)

    def draw(self, P_V: Sequence[float], runs: Int[np.ndarray, " n"], *, colour: bool = True) -> None:
        """Draw one frame to the current context and wait for its end.

        Args:
            P_V: Clip coordinates of points in the scene's frame: projection times view, a matrix row by row.
            runs: Which runs of triangles to draw.
            colour: Whether colours are drawn; depth always is.
        """
        calls = self._calls
        if colour != self._state_for_colour:
            self.set_state(colour)
        calls.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT)
        calls.uniform_matrix(self._P_V[colour], 1, 1, (ctypes.c_float * 16)(*P_V))
        self._counts.take(runs, out=self._some_counts[: len(runs)], mode="clip")
        self._offsets.take(runs, out=self._some_offsets[: len(runs)], mode="clip")
        places = self._count_place, gl.UNSIGNED_INT, self._offset_place
        calls.multi_draw_elements(gl.TRIANGLES, *places, len(runs))
        calls.finish()

    def reset_state(self) -> None:
        """Undo what pyrender does not set for itself, before it draws in the context."""
        calls = self._calls
        calls.clear_depth(1.0)
        calls.color_mask(1, 1, 1, 1)
        self._state_for_colour = None

    def set_state(self, colour: bool) -> None:
        """Set all that drawing depends on."""
        calls = self._calls
        calls.viewport(0, 0, *self._size)
        calls.enable(gl.DEPTH_TEST)
        calls.depth_func(gl.GREATER)
        calls.depth_mask(1)
        calls.depth_range(1.0, 0.0)
        calls.clear_depth(0.0)
        calls.enable(gl.CULL_FACE)
        calls.cull_face(gl.BACK)
        calls.disable(gl.BLEND)
        calls.polygon_mode(gl.FRONT_AND_BACK, gl.FILL)
        calls.color_mask(*[int(colour)] * 4)
        calls.clear_color(*self._background)
        calls.use_program(self._programs[colour])
        calls.bind_vertex_array(self._vertex_array)
        self._state_for_colour = colour


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


def _only_primitive(scene: pyrender.Scene) -> pyrender.Primitive:
    """The primitive of a scene that has one only, which the flat pass can draw."""
    primitives = [primitive for mesh in scene.meshes for primitive in mesh.primitives]
    if len(primitives) != 1:
        raise ValueError(f"The scene has {len(primitives)} primitives, expected one with all triangles.")
    (primitive,) = primitives
    if primitive.mode != GLTF.TRIANGLES or primitive.indices is None or primitive.poses is not None:
        raise ValueError("The mesh has points, lines, instances or no indices; expected indexed triangles.")
    if primitive.buf_flags != BufFlags.POSITION | BufFlags.COLOR_0 or primitive.material.tex_flags:
        raise ValueError("The mesh has normals or textures; expected positions and vertex colours only.")
    if primitive.is_transparent:
        raise ValueError("The mesh is transparent; expected vertex colours with an alpha of 255.")
    return primitive
