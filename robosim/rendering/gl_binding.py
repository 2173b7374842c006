"""Which system OpenGL runs on in this process: OSMesa, which draws in memory, or EGL.

pyrender draws through PyOpenGL, and PyOpenGL binds itself to one system for the life of a process, when it is
first imported. `bind_opengl` chooses, before pyrender or OpenGL is imported. MuJoCo's renderer works beside it
when set to the same system (MUJOCO_GL=osmesa).

Mesa's software renderer is kept from starting threads (LP_NUM_THREADS=0, unless set already): pictures of 128 by
128 gain next to nothing from them (two threads on two idle cores: 2 %; at 256 by 256 a fifth), and a process that is
forked while they run would wait for them forever.
"""

import ctypes
import functools
import os
import sys
from typing import Literal

GLSystem = Literal["osmesa", "egl"]

_OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
_PYOPENGL_NAMES: dict[str, GLSystem] = {"OSMesaPlatform": "osmesa", "EGLPlatform": "egl"}
_INSTALL_OSMESA = (
    "Install OSMesa (Debian, Ubuntu: apt-get install libosmesa6), or draw by ray casting, which needs no OpenGL "
    '(backend="embree").'
)


def bind_opengl(system: GLSystem | None = None) -> GLSystem:
    """Choose the system that OpenGL runs on in this process, and return it.

    Args:
        system: What to use; by default what the process or PYOPENGL_PLATFORM has chosen already, else OSMesa
            if its library is there, else EGL.

    Raises:
        ValueError: If there is no system of that name.
        RuntimeError: If the process is bound to another one already.
        OSError: If its library is not installed.
    """
    if system not in (None, "osmesa", "egl"):
        raise ValueError(f"OpenGL platform is {system!r}, expected 'osmesa' or 'egl'.")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    bound = _bound_system()
    if bound is not None:
        if system not in (None, bound):
            raise RuntimeError(
                f"OpenGL platform is {system!r}, but this process already uses {bound!r}, and PyOpenGL serves "
                f"only one. Draw with {system!r} in a process of its own."
            )
        if bound == "osmesa":
            _name_contexts_by_address()
        return bound
    chosen = system or _default_system()
    if chosen == "osmesa":
        load_osmesa()
    os.environ["PYOPENGL_PLATFORM"] = chosen
    try:
        import OpenGL.platform  # noqa: F401
    except ImportError as error:
        package = {"osmesa": "libosmesa6", "egl": "libegl1 libopengl0"}[chosen]
        raise OSError(f"PyOpenGL cannot use {chosen}: {error}. Try apt-get install {package}.") from error
    if chosen == "osmesa":
        _name_contexts_by_address()
    return chosen


@functools.cache
def load_osmesa() -> ctypes.CDLL:
    """The OSMesa library, its functions declared.

    Raises:
        OSError: If there is none; the message says what to install.
    """
    for name in _OSMESA_LIBRARIES:
        try:
            library = ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
        if hasattr(library, "OSMesaCreateContextAttribs"):
            return _declare(library)
    raise OSError(f"OSMesa is not installed, or is older than Mesa 12. {_INSTALL_OSMESA}")


def _declare(library: ctypes.CDLL) -> ctypes.CDLL:
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


def _name_contexts_by_address() -> None:
    """Let PyOpenGL know the current context again when it asks a second time.

    On OSMesa it gets a new pointer object at every call, which cannot be a key (3.1.0) or is another key every
    time (later ones). It needs keys to look up extensions, and pyrender to find its compiled shaders: stock
    pyrender compiles them anew for every frame, and keeps them all. The objects stay those of PyOpenGL otherwise,
    which MuJoCo's renderer relies on.
    """
    import OpenGL.platform
    from OpenGL.raw.osmesa._types import OSMesaContext

    class ContextKey(OSMesaContext):
        """A pointer to a context, equal to any other pointer to it."""

        _type_ = OSMesaContext._type_  # not inherited; without it, to follow the pointer is to crash

        def _key(self) -> int:
            return ctypes.cast(self, ctypes.c_void_p).value or 0

        def __hash__(self) -> int:
            return hash(self._key())

        def __eq__(self, other: object) -> bool:
            return self._key() == (other._key() if isinstance(other, ContextKey) else other)

    OpenGL.platform.GetCurrentContext.restype = ContextKey


def _bound_system() -> GLSystem | None:
    """The system that PyOpenGL serves in this process already; None if it has not been imported."""
    loaded = sys.modules.get("OpenGL.platform")
    if loaded is None or not hasattr(loaded, "PLATFORM"):
        return None
    name = type(loaded.PLATFORM).__name__
    if name not in _PYOPENGL_NAMES:
        raise RuntimeError(
            f"PyOpenGL was imported for a display ({name}) before a camera could ask for OSMesa. Make the camera "
            "before importing what draws on a display, or set PYOPENGL_PLATFORM=osmesa before Python starts."
        )
    return _PYOPENGL_NAMES[name]


def _default_system() -> GLSystem:
    wanted = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    if wanted == "egl":
        return "egl"
    if wanted == "osmesa":
        return "osmesa"
    try:
        load_osmesa()
    except OSError:
        try:
            ctypes.CDLL("libEGL.so.1")
        except OSError:
            raise OSError(f"Neither OSMesa nor EGL is installed. {_INSTALL_OSMESA}") from None
        return "egl"
    return "osmesa"
