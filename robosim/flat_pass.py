"""Drawing a pyrender scene in flat colours, with the fewest OpenGL calls that a frame takes.

pyrender stays the owner of the scene, of its meshes on the GPU and of the shaders. Replaced is what it does at
every frame: look up the shaders of each primitive, set a dozen uniforms by their names, set and undo all state,
each time with PyOpenGL's checks around it. Here a frame is: set the state, clear, and for each primitive a
program, three matrices and a draw call.

That is enough for opaque triangles without textures, in the colours of their vertices. Anything else that pyrender
draws (lights, textures, transparency) still goes through `pyrender.Renderer.render` in the same context.

Uses internals of pyrender 0.1.45, the version that this project pins. Import only after
`robosim.gl_binding.bind_opengl`.
"""

from dataclasses import dataclass

import numpy as np
import pyrender
from jaxtyping import Float
from pyrender.constants import GLTF, BufFlags, ProgramFlags, RenderFlags

from robosim import gl_calls as gl
from robosim.gl_calls import GLCalls


@dataclass(frozen=True)
class _Draw:
    """What one draw call needs."""

    vertex_array: int
    program: int
    n_indices: int
    P: int
    """Place of the uniform matrix P, and so on."""
    V: int
    M: int


class FlatPass:
    """Draws the meshes of one scene, which stay as they are, in their vertex colours.

    Meshes are taken as lying in the scene's own frame: poses of nodes are left out.
    """

    def __init__(self, scene: pyrender.Scene, renderer: pyrender.Renderer, calls: GLCalls) -> None:
        """Bring the scene's meshes to the context, which must be current, and compile the shaders.

        Raises:
            ValueError: If a mesh is not made of opaque indexed triangles with vertex colours only.
        """
        self._size = renderer.viewport_width, renderer.viewport_height
        self._calls = calls
        self._background = tuple(float(x) for x in np.broadcast_to(scene.bg_color, 4))
        primitives = [primitive for mesh in scene.meshes for primitive in mesh.primitives]
        for primitive in primitives:
            _check_flat(primitive)
        renderer._update_context(scene, RenderFlags.FLAT)
        self._colour = [self._prepare(renderer, primitive, RenderFlags.FLAT) for primitive in primitives]
        self._depth = [self._prepare(renderer, primitive, RenderFlags.DEPTH_ONLY) for primitive in primitives]
        self._identity = np.eye(4, dtype=np.float32)

    def draw(self, P_V: Float[np.ndarray, "4 4"], *, colour: bool = True) -> None:
        """Draw one frame to the current context and wait for its end.

        Args:
            P_V: Clip coordinates of points in the scene's frame: projection times view.
            colour: Whether colours are drawn; depth always is.
        """
        calls = self._calls
        self._set_state(colour)
        # One product, formed in float64, takes the place of P; rounding P and V apart loses half a millimetre.
        product = np.ascontiguousarray(P_V, dtype=np.float32)
        for draw in self._colour if colour else self._depth:
            calls.use_program(draw.program)
            calls.uniform_matrix(draw.P, 1, 1, product.ctypes.data)
            calls.uniform_matrix(draw.V, 1, 1, self._identity.ctypes.data)
            calls.uniform_matrix(draw.M, 1, 1, self._identity.ctypes.data)
            calls.bind_vertex_array(draw.vertex_array)
            calls.draw_elements(gl.TRIANGLES, draw.n_indices, gl.UNSIGNED_INT, None)
        calls.finish()

    def _set_state(self, colour: bool) -> None:
        """All that drawing depends on, since pyrender's own passes may have been at work in between."""
        calls = self._calls
        calls.viewport(0, 0, *self._size)
        calls.enable(gl.DEPTH_TEST)
        calls.depth_func(gl.LESS)
        calls.depth_mask(1)
        calls.enable(gl.CULL_FACE)
        calls.cull_face(gl.BACK)
        calls.disable(gl.BLEND)
        calls.polygon_mode(gl.FRONT_AND_BACK, gl.FILL)
        calls.color_mask(*[int(colour)] * 4)
        calls.clear_color(*self._background)
        calls.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT)

    def _prepare(self, renderer: pyrender.Renderer, primitive: pyrender.Primitive, flags: int) -> _Draw:
        material = ProgramFlags.USE_MATERIAL if flags == RenderFlags.FLAT else ProgramFlags.NONE
        program = renderer._get_primitive_program(primitive, flags, material)
        program._bind()
        if flags == RenderFlags.FLAT:
            program.set_uniform("material.base_color_factor", primitive.material.baseColorFactor)
        find = self._calls.get_uniform_location
        places = {name: find(program._program_id, name.encode()) for name in ("P", "V", "M")}
        return _Draw(int(primitive._vaid), int(program._program_id), int(primitive.indices.size), **places)


def _check_flat(primitive: pyrender.Primitive) -> None:
    if primitive.mode != GLTF.TRIANGLES or primitive.indices is None or primitive.poses is not None:
        raise ValueError("A mesh has points, lines, instances or no indices; expected indexed triangles.")
    if primitive.buf_flags != BufFlags.POSITION | BufFlags.COLOR_0 or primitive.material.tex_flags:
        raise ValueError("A mesh has normals or textures; expected positions and vertex colours only.")
    if primitive.is_transparent:
        raise ValueError("A mesh is transparent; expected vertex colours with an alpha of 255.")
