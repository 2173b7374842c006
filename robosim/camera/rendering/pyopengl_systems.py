"""OSMesa and EGL as PyOpenGL knows them, with the libraries of `robosim.camera.rendering.gl_libraries`.

PyOpenGL makes one of these classes while it is imported itself, as `robosim.camera.rendering.gl_binding` has told it
to; nothing else imports this module. The classes have the names of those that they replace.
"""

import ctypes

from OpenGL.platform import egl, osmesa
from OpenGL.platform.baseplatform import lazy_property

from robosim.camera.rendering.gl_libraries import open_egl, open_egl_opengl, open_osmesa


class OSMesaPlatform(osmesa.OSMesaPlatform):
    """OSMesa, from wherever the dynamic linker finds it."""

    @lazy_property
    def GL(self) -> ctypes.CDLL:
        """The library that has OpenGL's functions."""
        return open_osmesa()


class EGLPlatform(egl.EGLPlatform):
    """EGL with the OpenGL library that does without X, if it is there."""

    @lazy_property
    def EGL(self) -> ctypes.CDLL:
        """The library that has EGL's functions."""
        return open_egl()

    @lazy_property
    def GL(self) -> ctypes.CDLL:
        """The library that has OpenGL's functions."""
        return open_egl_opengl()
