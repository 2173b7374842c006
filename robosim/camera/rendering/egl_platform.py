"""An OpenGL context on an EGL device, for machines without OSMesa or with a graphics card.

The context is pyrender's own (EGL_DEVICE_ID in the environment chooses the device), drawing into a frame buffer
of one sample a pixel: as on OSMesa, a pixel holds the colour and the depth at its centre. Where pyrender ends
the whole display together with one context, here the other cameras go on.

Import only after `robosim.camera.rendering.gl_binding.bind_opengl("egl")`.
"""

import os
from typing import Any

import numpy as np
from jaxtyping import Integer, UInt8
from OpenGL import EGL, GL
from OpenGL.error import Error as PyOpenGLError
from pyrender.platforms import egl

from robosim.camera.rendering import gl_calls as gl
from robosim.camera.rendering.gl_calls import GLCalls
from robosim.camera.rendering.gl_libraries import INSTALL, OpenGLError
from robosim.camera.rendering.gl_platform import read_depth_code

_REMEDY = f"install Mesa's driver ({INSTALL['egl']}) or OSMesa ({INSTALL['osmesa']})"


class EGLPlatform(egl.EGLPlatform):
    """A context on an EGL device; one thread may use it at a time."""

    def __init__(self, viewport_width: int, viewport_height: int) -> None:
        super().__init__(viewport_width, viewport_height, device=_chosen_device())
        self._egl_context: Any = None

    def init_context(self) -> None:
        """Create the context and its frame buffer, and make them current."""
        try:
            super().init_context()
        except (AssertionError, PyOpenGLError) as error:
            code = getattr(error, "err", None)
            reason = f"EGL error {int(code):#x}" if code else type(error).__name__
            raise OpenGLError(f"EGL cannot make an OpenGL 4.1 context ({reason}).", _REMEDY) from error
        self.calls = GLCalls(lambda name: EGL.eglGetProcAddress(name.encode()))
        self.frame = int(GL.glGenFramebuffers(1))
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self.frame)
        for place, kind in (
            (GL.GL_COLOR_ATTACHMENT0, GL.GL_RGBA8),
            (GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT24),
        ):
            buffer = GL.glGenRenderbuffers(1)
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, self.viewport_width, self.viewport_height)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, buffer)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            size = f"{self.viewport_width} x {self.viewport_height}"
            raise OpenGLError(f"The EGL device cannot draw into a frame buffer of {size} pixels.", _REMEDY)

    def make_current(self) -> None:
        """Direct this thread's OpenGL calls to the frame buffer."""
        super().make_current()
        if hasattr(self, "calls"):
            self.calls.bind_framebuffer(gl.FRAMEBUFFER, self.frame)

    def make_uncurrent(self) -> None:
        """Let go of the context, so that another thread can take it."""
        EGL.eglMakeCurrent(self._egl_display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT)

    def delete_context(self) -> None:
        """Free the context but not the display, which others may be using."""
        if self._egl_context is not None:
            EGL.eglDestroyContext(self._egl_display, self._egl_context)
            self._egl_context = None

    def supports_framebuffers(self) -> bool:
        """Whether pyrender shall draw into multisampled buffers of its own: no, into this one."""
        return False

    def read_rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Colours of the frame, first row on top."""
        rgb = np.empty((self.viewport_height, self.viewport_width, 3), np.uint8)
        size = self.viewport_width, self.viewport_height
        self.calls.pixel_store(gl.PACK_ALIGNMENT, 1)
        self.calls.read_pixels(0, 0, *size, gl.RGB, gl.UNSIGNED_BYTE, rgb.ctypes.data)
        return np.ascontiguousarray(rgb[::-1])

    def read_depth_code(self) -> Integer[np.ndarray, "h w"]:
        """Depth buffer of the frame, 0 to `gl_platform.MAX_DEPTH_CODE`, first row on top."""
        return read_depth_code(self.calls, self.viewport_width, self.viewport_height)


def _chosen_device() -> egl.EGLDevice:
    """The device that EGL_DEVICE_ID counts to, else the first."""
    number = os.environ.get("EGL_DEVICE_ID", "0")
    devices = egl.query_devices()
    if not devices:
        raise OpenGLError("EGL has no device to draw on.", _REMEDY)
    if not number.isdecimal() or int(number) >= len(devices):
        expected = f"expected a number from 0 to {len(devices) - 1}"
        raise OpenGLError(f"EGL_DEVICE_ID is {number!r}, {expected}.", "unset EGL_DEVICE_ID")
    return devices[int(number)]
