"""An OpenGL context in memory by OSMesa, with the methods that pyrender asks of a platform.

A frame lands in NumPy memory, and its depth buffer can be looked at where it lies, so that no `glReadPixels` is
needed. The library is called by ctypes: the PyOpenGL that pyrender 0.1.45 pins (3.1.0) cannot ask OSMesa for a
core profile, which is why pyrender's own OSMesa platform fails on it.

Reference: Mesa, include/GL/osmesa.h.
"""

import ctypes

import cv2
import numpy as np
from jaxtyping import Integer, UInt8

from robosim.camera.rendering import gl_calls as gl
from robosim.camera.rendering.gl_calls import GLCalls
from robosim.camera.rendering.gl_libraries import OpenGLError, load_osmesa

#: Depth buffers have 24 bits: their codes go from 0 to this.
MAX_DEPTH_CODE = 2**24 - 1

# Rows of Mesa's depth buffer are padded to cache lines; a width of whole lines leaves no padding.
_WIDTH_STEP = 64

# Values from include/GL/osmesa.h.
_OSMESA_Y_UP = 0x11
_OSMESA_FORMAT, _OSMESA_DEPTH_BITS = 0x22, 0x30
_OSMESA_PROFILE, _OSMESA_CORE_PROFILE = 0x33, 0x34
_OSMESA_MAJOR_VERSION, _OSMESA_MINOR_VERSION = 0x36, 0x37


class OSMesaPlatform:
    """A software context that draws into NumPy memory.

    One thread may use it at a time; frames make it current and then let it go.
    """

    frame = 0
    """OpenGL's name of the frame buffer that pictures are drawn into."""

    def __init__(self, viewport_width: int, viewport_height: int) -> None:
        self.viewport_width = viewport_width
        self.viewport_height = viewport_height
        self._library = load_osmesa()
        self._context: int | None = None
        self._width = -(-viewport_width // _WIDTH_STEP) * _WIDTH_STEP
        self._rgba = np.zeros((viewport_height, self._width, 4), np.uint8)
        self._where = self._rgba.ctypes.data, gl.UNSIGNED_BYTE, self._width, viewport_height
        self._answer = ctypes.c_int(), ctypes.c_int(), ctypes.c_int(), ctypes.c_void_p()
        self._answer_places = tuple(ctypes.byref(place) for place in self._answer)
        self._depth_address: int | None = None

    def init_context(self) -> None:
        """Create the context, core profile 3.3 with 24 bits of depth, and make it current."""
        wanted = (
            (_OSMESA_FORMAT, gl.RGBA),
            (_OSMESA_DEPTH_BITS, 24),
            (_OSMESA_PROFILE, _OSMESA_CORE_PROFILE),
            (_OSMESA_MAJOR_VERSION, 3),
            (_OSMESA_MINOR_VERSION, 3),
        )
        attributes = [value for pair in wanted for value in pair]
        self._context = self._library.OSMesaCreateContextAttribs((ctypes.c_int * 11)(*attributes, 0), None)
        if not self._context:
            raise OpenGLError("OSMesa cannot make an OpenGL 3.3 context.", "install Mesa 17 or later")
        self.make_current()
        self._library.OSMesaPixelStore(_OSMESA_Y_UP, 0)  # first row on top
        self.calls = GLCalls(lambda name: self._library.OSMesaGetProcAddress(name.encode()))
        self._depth_is_plain = self._depth_lies_plain()

    def make_current(self) -> None:
        """Direct this thread's OpenGL calls here."""
        if not self._context or not self._library.OSMesaMakeCurrent(self._context, *self._where):
            raise RuntimeError("The OSMesa context cannot be made current: it has been closed.")

    def make_uncurrent(self) -> None:
        """Let go of the context, so that another thread can take it."""
        self._library.OSMesaMakeCurrent(None, None, 0, 0, 0)

    def delete_context(self) -> None:
        """Free the context; nothing happens the second time."""
        if self._context:
            self._library.OSMesaDestroyContext(self._context)
            self._context = None

    def supports_framebuffers(self) -> bool:
        """Whether pyrender shall draw into multisampled buffers of its own: no, straight into memory."""
        return False

    def read_rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Colours of the frame, first row on top. To be called after glFinish."""
        return cv2.cvtColor(self._rgba[:, : self.viewport_width], cv2.COLOR_RGBA2RGB)

    def read_depth_code(self) -> Integer[np.ndarray, "h w"]:
        """Depth buffer of the frame, 0 to MAX_DEPTH_CODE, first row on top; valid until the next frame."""
        if not self._depth_is_plain:
            return read_depth_code(self.calls, self.viewport_width, self.viewport_height)
        return self._depth_memory()[::-1, : self.viewport_width]

    def _depth_memory(self) -> Integer[np.ndarray, "h padded_w"]:
        """The depth buffer where it lies, first row at the bottom; empty if OSMesa does not show it."""
        shown = self._library.OSMesaGetDepthBuffer(self._context, *self._answer_places)
        size, address = self._answer[2].value, self._answer[3].value
        if not shown or not address or size != 4:
            return np.empty((0, 0), np.uint32)
        if address != self._depth_address:
            self._depth_address = address
            memory = (ctypes.c_uint32 * (self._width * self.viewport_height)).from_address(address)
            self._depth = np.ctypeslib.as_array(memory).reshape(self.viewport_height, self._width)
        return self._depth

    def _depth_lies_plain(self) -> bool:
        """Whether the depth memory is what this module takes it for: rows without gaps, 24 bits in 32."""
        calls, (width, height) = self.calls, (self.viewport_width, self.viewport_height)
        calls.enable(gl.SCISSOR_TEST)
        for depth, box in ((1.0, (0, 0, self._width, height)), (0.25, (width - 1, height // 2, 1, 1))):
            calls.clear_depth(depth)
            calls.scissor(*box)
            calls.clear(gl.DEPTH_BUFFER_BIT)
        calls.clear_depth(1.0)
        calls.disable(gl.SCISSOR_TEST)
        calls.finish()
        memory = self._depth_memory()
        expected = np.full((height, self._width), MAX_DEPTH_CODE)
        expected[height // 2, width - 1] = round(0.25 * MAX_DEPTH_CODE)
        return memory.shape == expected.shape and bool((np.abs(memory.astype(int) - expected) <= 1).all())


def read_depth_code(calls: GLCalls, width: int, height: int) -> Integer[np.ndarray, "h w"]:
    """Depth buffer of the current context, 0 to MAX_DEPTH_CODE, first row on top."""
    code = np.empty((height, width), np.uint32)
    calls.read_pixels(0, 0, width, height, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, code.ctypes.data)
    return code[::-1] >> 8  # OpenGL spreads 24 bits over all 32
