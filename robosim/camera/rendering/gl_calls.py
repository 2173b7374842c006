"""The few OpenGL functions that drawing a frame takes, called through ctypes.

PyOpenGL converts arguments and asks for errors around every call, which costs more than the software renderer
needs for a small frame. These go straight to the driver: arguments are plain numbers and addresses.
"""

import ctypes
from collections.abc import Callable

from robosim.camera.rendering.gl_libraries import OpenGLError

DEPTH_BUFFER_BIT, COLOR_BUFFER_BIT = 0x0100, 0x4000
TRIANGLES = 0x0004
GREATER = 0x0204
BACK = 0x0405
FRONT_AND_BACK, FILL = 0x0408, 0x1B02
CULL_FACE, DEPTH_TEST, BLEND, SCISSOR_TEST, MULTISAMPLE = 0x0B44, 0x0B71, 0x0BE2, 0x0C11, 0x809D
PACK_ALIGNMENT = 0x0D05
UNSIGNED_BYTE, UNSIGNED_INT = 0x1401, 0x1405
DEPTH_COMPONENT, RGB, RGBA = 0x1902, 0x1907, 0x1908
FRAMEBUFFER = 0x8D40

_ENUM, _INT, _POINTER = ctypes.c_uint, ctypes.c_int, ctypes.c_void_p
_FLOAT, _DOUBLE, _BOOL = ctypes.c_float, ctypes.c_double, ctypes.c_ubyte


class GLCalls:
    """OpenGL functions of the context that was current when this was made."""

    def __init__(self, procedure: Callable[[str], int | None]) -> None:
        """Look the functions up.

        Args:
            procedure: Gives the address of a function by its name.

        Raises:
            OpenGLError: If the driver lacks one.
        """

        def find(name: str, *arguments: type, result: type | None = None) -> Callable[..., int | None]:
            address = procedure(name)
            if not address:
                raise OpenGLError(f"The OpenGL driver has no {name}.", "install Mesa 17 or later")
            return ctypes.CFUNCTYPE(result, *arguments)(address)

        self.bind_framebuffer = find("glBindFramebuffer", _ENUM, _ENUM)
        self.bind_vertex_array = find("glBindVertexArray", _ENUM)
        self.clear = find("glClear", _ENUM)
        self.clear_color = find("glClearColor", _FLOAT, _FLOAT, _FLOAT, _FLOAT)
        self.clear_depth = find("glClearDepth", _DOUBLE)
        self.color_mask = find("glColorMask", _BOOL, _BOOL, _BOOL, _BOOL)
        self.cull_face = find("glCullFace", _ENUM)
        self.depth_func = find("glDepthFunc", _ENUM)
        self.depth_mask = find("glDepthMask", _BOOL)
        self.depth_range = find("glDepthRange", _DOUBLE, _DOUBLE)
        self.disable = find("glDisable", _ENUM)
        self.enable = find("glEnable", _ENUM)
        self.finish = find("glFinish")
        self.get_error = find("glGetError", result=_ENUM)
        self.get_uniform_location = find("glGetUniformLocation", _ENUM, ctypes.c_char_p, result=_INT)
        self.multi_draw_elements = find("glMultiDrawElements", _ENUM, _POINTER, _ENUM, _POINTER, _INT)
        self.pixel_store = find("glPixelStorei", _ENUM, _INT)
        self.polygon_mode = find("glPolygonMode", _ENUM, _ENUM)
        self.read_pixels = find("glReadPixels", _INT, _INT, _INT, _INT, _ENUM, _ENUM, _POINTER)
        self.scissor = find("glScissor", _INT, _INT, _INT, _INT)
        self.uniform_matrix = find("glUniformMatrix4fv", _INT, _INT, _BOOL, _POINTER)
        self.use_program = find("glUseProgram", _ENUM)
        self.viewport = find("glViewport", _INT, _INT, _INT, _INT)
