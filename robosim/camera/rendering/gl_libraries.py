"""The shared libraries of OSMesa and of EGL: which are there, what to install where they are not.

PyOpenGL 3.1.0, which pyrender pins, asks ldconfig for its libraries, so that it misses those on LD_LIBRARY_PATH
(of a Conda environment, say), and for EGL it asks for libGL, which drags in X, where libOpenGL is enough. Here they
are opened by the names that the dynamic linker knows, and handed to PyOpenGL by
`robosim.camera.rendering.pyopengl_systems`.
Imports nothing but the standard library, since `scripts/system_packages.py` uses it before anything is installed.
"""

import ctypes
import functools
from collections.abc import Sequence
from typing import Literal

GLSystem = Literal["osmesa", "egl"]

#: How tables and messages call the systems; in the order of preference.
SYSTEM_NAMES: dict[GLSystem, str] = {"osmesa": "OSMesa", "egl": "EGL"}
#: Debian's and Ubuntu's packages of the systems, with Mesa's driver.
PACKAGES: dict[GLSystem, tuple[str, ...]] = {
    "osmesa": ("libosmesa6",),
    "egl": ("libegl1", "libopengl0", "libgl1-mesa-dri"),
}
#: What to do where a system is not there, or does not draw.
INSTALL = {system: f"apt-get install {' '.join(packages)}" for system, packages in PACKAGES.items()}

_OSMESA = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
_EGL = ("libEGL.so.1",)
# All of OpenGL and nothing of X; else the one that has both.
_EGL_OPENGL = ("libOpenGL.so.0", "libGL.so.1")


class OpenGLError(OSError):
    """OpenGL cannot be used as this machine is set up."""

    def __init__(self, trouble: str, remedy: str) -> None:
        """Say what is wrong, and what to do about it."""
        super().__init__(f"{trouble} To do: {remedy}.")
        self.trouble, self.remedy = trouble, remedy


def missing(system: GLSystem) -> OpenGLError | None:
    """What a system lacks on this machine, and how to install it; None if its libraries are there."""
    try:
        if system == "osmesa":
            open_osmesa()
        else:
            open_egl()
            open_egl_opengl()
    except OpenGLError as error:
        return error
    return None


@functools.cache
def load_osmesa() -> ctypes.CDLL:
    """The OSMesa library, its functions declared.

    Raises:
        OpenGLError: If there is none; the message says what to install.
    """
    library = open_osmesa()
    c_int, pointer = ctypes.c_int, ctypes.c_void_p
    for name, result, *arguments in (
        ("OSMesaCreateContextAttribs", pointer, ctypes.POINTER(c_int), pointer),
        ("OSMesaMakeCurrent", ctypes.c_ubyte, pointer, pointer, ctypes.c_uint, c_int, c_int),
        ("OSMesaDestroyContext", None, pointer),
        ("OSMesaPixelStore", None, c_int, c_int),
        ("OSMesaGetProcAddress", pointer, ctypes.c_char_p),
        ("OSMesaGetDepthBuffer", ctypes.c_ubyte, pointer, pointer, pointer, pointer, pointer),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def open_osmesa() -> ctypes.CDLL:
    """The OSMesa library as it comes, a new object at every call.

    Raises:
        OpenGLError: If there is none; the message says what to install.
    """
    library = _open(_OSMESA)
    if library is None:
        raise OpenGLError("OSMesa is not installed.", INSTALL["osmesa"])
    if not hasattr(library, "OSMesaCreateContextAttribs"):
        raise OpenGLError("OSMesa is older than Mesa 12.", "install Mesa 17 or later")
    return library


def open_egl() -> ctypes.CDLL:
    """The EGL library.

    Raises:
        OpenGLError: If there is none; the message says what to install.
    """
    library = _open(_EGL)
    if library is None:
        raise OpenGLError("EGL is not installed.", INSTALL["egl"])
    return library


def open_egl_opengl() -> ctypes.CDLL:
    """The OpenGL functions that are used on EGL.

    Raises:
        OpenGLError: If there is no library of them; the message says what to install.
    """
    library = _open(_EGL_OPENGL)
    if library is None:
        raise OpenGLError("EGL is there, but not libOpenGL.", INSTALL["egl"])
    return library


def _open(names: Sequence[str]) -> ctypes.CDLL | None:
    for name in names:
        try:
            # Local: Mesa brings an LLVM, whose names would take the place of those in other libraries that are loaded
            # later. PyTorch's compiler crashes of that. Nor must one system's functions hide those of the other.
            return ctypes.CDLL(name, mode=ctypes.RTLD_LOCAL)
        except OSError:
            continue
    return None
