"""OpenGL contexts without a display: in NumPy memory by OSMesa, and on an EGL device.

OSMesa draws into NumPy memory. The library is called through ctypes: PyOpenGL 3.1.0, which pyrender 0.1.45 pins, cannot
ask OSMesa for a core profile. EGL contexts are pyrender's (EGL_DEVICE_ID in the environment chooses the device), with a
frame buffer of one sample per pixel: as on OSMesa, a pixel holds the colour and the depth at its centre.

Import only after `robosim.camera.rendering.gl_systems.bind_opengl`.
Reference: Mesa, include/GL/osmesa.h.
"""

import ctypes
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Integer, UInt8
from OpenGL import GL
from OpenGL.error import Error as PyOpenGLError

from robosim.camera.rendering.gl_systems import INSTALL, GLSystem, OpenGLError, open_libraries

#: Depth buffers have 24 bits: their codes go from 0 to this.
MAX_DEPTH_CODE = 2**24 - 1

# Values from include/GL/osmesa.h.
_OSMESA_Y_UP = 0x11
_OSMESA_FORMAT, _OSMESA_DEPTH_BITS = 0x22, 0x30
_OSMESA_PROFILE, _OSMESA_CORE_PROFILE = 0x33, 0x34
_OSMESA_MAJOR_VERSION, _OSMESA_MINOR_VERSION = 0x36, 0x37

_REMEDY = f"install Mesa's driver ({INSTALL['egl']}) or OSMesa ({INSTALL['osmesa']})"

_UINT, _INT, _POINTER, _BYTE = ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_ubyte
#: Functions that are called for every frame. PyOpenGL converts arguments and reads errors around every call, which
#: takes longer than drawing a small frame; these go straight to the driver.
_FRAME_FUNCTIONS: dict[str, tuple[type, ...]] = {
    "glClear": (_UINT,),
    "glFinish": (),
    "glMultiDrawElements": (_UINT, _POINTER, _UINT, _POINTER, _INT),
    "glPixelStorei": (_UINT, _INT),
    "glReadPixels": (_INT, _INT, _INT, _INT, _UINT, _UINT, _POINTER),
    "glUniformMatrix4fv": (_INT, _INT, _BYTE, _POINTER),
}


class GLPlatform(ABC):
    """An OpenGL context that frames are drawn in and read from; one thread may use it at a time."""

    calls: Any
    """Functions of OpenGL by name: arguments are plain numbers and addresses, and no errors are checked."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height

    @abstractmethod
    def make_current(self) -> None:
        """Direct this thread's OpenGL calls to the context."""

    @abstractmethod
    def make_uncurrent(self) -> None:
        """Release the context, so that another thread can use it."""

    @abstractmethod
    def delete_context(self) -> None:
        """Free the context."""

    @abstractmethod
    def read_rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Colours of the frame, first row on top. To be called after glFinish."""

    def read_depth_code(self) -> Integer[np.ndarray, "h w"]:
        """Depth buffer of the frame, 0 to MAX_DEPTH_CODE, first row on top; valid until the next frame."""
        code = np.empty((self.height, self.width), np.uint32)
        size = self.width, self.height
        self.calls.glReadPixels(0, 0, *size, GL.GL_DEPTH_COMPONENT, GL.GL_UNSIGNED_INT, code.ctypes.data)
        return code[::-1] >> 8  # OpenGL spreads 24 bits over all 32

    def _find_functions(self, address_of: Callable[[bytes], int | None]) -> None:
        functions = {
            name: ctypes.CFUNCTYPE(None, *arguments)(address_of(name.encode()))  # type: ignore[arg-type]
            for name, arguments in _FRAME_FUNCTIONS.items()
        }
        self.calls = SimpleNamespace(**functions)


class OSMesaPlatform(GLPlatform):
    """A software context, core profile 3.3 with 24 bits of depth, that draws into NumPy memory."""

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self._library = _osmesa()
        self._rgba = np.zeros((height, width, 4), np.uint8)
        self._target = self._rgba.ctypes.data, GL.GL_UNSIGNED_BYTE, width, height
        attributes = [
            *(_OSMESA_FORMAT, GL.GL_RGBA),
            *(_OSMESA_DEPTH_BITS, 24),
            *(_OSMESA_PROFILE, _OSMESA_CORE_PROFILE),
            *(_OSMESA_MAJOR_VERSION, 3),
            *(_OSMESA_MINOR_VERSION, 3),
        ]
        self._context: int | None = self._library.OSMesaCreateContextAttribs(
            (ctypes.c_int * 11)(*attributes, 0), None
        )
        if not self._context:
            raise OpenGLError("OSMesa cannot make an OpenGL 3.3 context.", "install Mesa 17 or later")
        self.make_current()
        self._library.OSMesaPixelStore(_OSMESA_Y_UP, 0)  # first row on top
        self._find_functions(self._library.OSMesaGetProcAddress)

    def make_current(self) -> None:
        """Direct this thread's OpenGL calls to the context."""
        if not self._library.OSMesaMakeCurrent(self._context, *self._target):
            raise RuntimeError("The OSMesa context cannot be made current.")

    def make_uncurrent(self) -> None:
        """Release the context, so that another thread can use it."""
        self._library.OSMesaMakeCurrent(None, None, 0, 0, 0)

    def delete_context(self) -> None:
        """Free the context."""
        self._library.OSMesaDestroyContext(self._context)

    def read_rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Colours of the frame, first row on top. To be called after glFinish."""
        return cv2.cvtColor(self._rgba, cv2.COLOR_RGBA2RGB)


class EGLPlatform(GLPlatform):
    """A context on an EGL device, OpenGL 4.1, with a frame buffer of its own.

    It does without pyrender's end of a context, which ends the display, and so the contexts of all other cameras.
    """

    def __init__(self, width: int, height: int) -> None:
        from OpenGL import EGL
        from pyrender.platforms import egl

        super().__init__(width, height)
        self._context = egl.EGLPlatform(width, height, device=_chosen_device(egl.query_devices()))
        try:
            self._context.init_context()
        except (AssertionError, PyOpenGLError) as error:
            code = getattr(error, "err", None)
            reason = f"EGL error {int(code):#x}" if code else type(error).__name__
            raise OpenGLError(f"EGL cannot make an OpenGL 4.1 context ({reason}).", _REMEDY) from error
        self._find_functions(EGL.eglGetProcAddress)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, GL.glGenFramebuffers(1))
        for attachment, kind in (
            (GL.GL_COLOR_ATTACHMENT0, GL.GL_RGBA8),
            (GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT24),
        ):
            buffer = GL.glGenRenderbuffers(1)
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, width, height)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, attachment, GL.GL_RENDERBUFFER, buffer)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            size = f"{width} x {height}"
            raise OpenGLError(f"The EGL device cannot draw into a frame buffer of {size} pixels.", _REMEDY)

    def make_current(self) -> None:
        """Direct this thread's OpenGL calls to the context."""
        self._context.make_current()

    def make_uncurrent(self) -> None:
        """Release the context, so that another thread can use it."""
        from OpenGL import EGL

        display = self._context._egl_display
        EGL.eglMakeCurrent(display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT)

    def delete_context(self) -> None:
        """Free the context."""
        from OpenGL import EGL

        EGL.eglDestroyContext(self._context._egl_display, self._context._egl_context)

    def read_rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Colours of the frame, first row on top. To be called after glFinish."""
        rgb = np.empty((self.height, self.width, 3), np.uint8)
        size = self.width, self.height
        self.calls.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        self.calls.glReadPixels(0, 0, *size, GL.GL_RGB, GL.GL_UNSIGNED_BYTE, rgb.ctypes.data)
        return np.ascontiguousarray(rgb[::-1])


def make_platform(system: GLSystem, width: int, height: int) -> GLPlatform:
    """A context of some size [pixels], which is this thread's current one; OpenGLError if there can be none."""
    return OSMesaPlatform(width, height) if system == "osmesa" else EGLPlatform(width, height)


def _osmesa() -> ctypes.CDLL:
    """The OSMesa library, its functions declared."""
    (library,) = open_libraries("osmesa")
    for name, result, *arguments in (
        ("OSMesaCreateContextAttribs", _POINTER, ctypes.POINTER(_INT), _POINTER),
        ("OSMesaMakeCurrent", _BYTE, _POINTER, _POINTER, _UINT, _INT, _INT),
        ("OSMesaDestroyContext", None, _POINTER),
        ("OSMesaPixelStore", None, _INT, _INT),
        ("OSMesaGetProcAddress", _POINTER, ctypes.c_char_p),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def _chosen_device(devices: list[Any]) -> Any:
    """The device that EGL_DEVICE_ID counts to, else the first."""
    number = os.environ.get("EGL_DEVICE_ID", "0")
    if not devices:
        raise OpenGLError("EGL has no device to draw on.", _REMEDY)
    if not number.isdecimal() or int(number) >= len(devices):
        expected = f"expected a number from 0 to {len(devices) - 1}"
        raise OpenGLError(f"EGL_DEVICE_ID is {number!r}, {expected}.", "unset EGL_DEVICE_ID")
    return devices[int(number)]
