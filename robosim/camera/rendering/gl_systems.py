"""The systems that OpenGL draws on without a display: OSMesa, which draws in memory, and EGL.

pyrender draws through PyOpenGL, which binds itself to one system for the life of a process, when it is first imported.
`bind_opengl` chooses that system; it has to be called before pyrender or OpenGL is imported. MuJoCo's renderer works in
the same process if it is set to the same system (MUJOCO_GL=osmesa or egl).

No display is needed. As they are, pyrender imports its viewer, which needs pyglet, libGL and X; and PyOpenGL 3.1.0,
which pyrender pins, asks ldconfig for its libraries, so that it misses those on LD_LIBRARY_PATH (of a Conda
environment, say), and loads libGL for EGL, where libOpenGL is enough. `prepare_pyopengl` replaces both.

Only the standard library is imported at the top: `scripts/system_packages.py` uses this file before anything is
installed.
"""

import ctypes
import os
import sys
from types import ModuleType
from typing import Any, Literal

GLSystem = Literal["osmesa", "egl"]

#: Names of the systems in tables and messages, in the order of preference.
SYSTEM_NAMES: dict[GLSystem, str] = {"osmesa": "OSMesa", "egl": "EGL"}
#: Debian's and Ubuntu's packages of the systems, with Mesa's driver.
PACKAGES: dict[GLSystem, tuple[str, ...]] = {
    "osmesa": ("libosmesa6",),
    "egl": ("libegl1", "libopengl0", "libgl1-mesa-dri"),
}
#: Remedy if a system is missing or does not draw.
INSTALL = {system: f"apt-get install {' '.join(packages)}" for system, packages in PACKAGES.items()}

#: Shared libraries of the systems: names to try in turn, and what is wrong if there is none.
_LIBRARIES: dict[GLSystem, tuple[tuple[tuple[str, ...], str], ...]] = {
    "osmesa": ((("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"), "OSMesa is not installed."),),
    "egl": (
        (("libEGL.so.1",), "EGL is not installed."),
        # libOpenGL has all of OpenGL and nothing of X; libGL has both.
        (("libOpenGL.so.0", "libGL.so.1"), "EGL is there, but not libOpenGL."),
    ),
}
#: PyOpenGL's classes of the systems.
_PYOPENGL_NAMES: dict[str, GLSystem] = {"OSMesaPlatform": "osmesa", "EGLPlatform": "egl"}
_WITHOUT_OPENGL = 'or draw by ray casting, which needs no OpenGL: backend="embree" (--camera embree)'


class OpenGLError(OSError):
    """OpenGL cannot be used as this machine is set up."""

    def __init__(self, trouble: str, remedy: str) -> None:
        super().__init__(f"{trouble} To do: {remedy}.")
        self.trouble, self.remedy = trouble, remedy


def open_libraries(system: GLSystem) -> list[ctypes.CDLL]:
    """The shared libraries of a system, new objects at every call: OSMesa's only one, or EGL's and that of OpenGL.

    Raises:
        OpenGLError: If one is missing or too old; the message says what to install.
    """
    opened = []
    for names, trouble in _LIBRARIES[system]:
        library = next(filter(None, map(_open, names)), None)
        if library is None:
            raise OpenGLError(trouble, INSTALL[system])
        opened.append(library)
    if system == "osmesa" and not hasattr(opened[0], "OSMesaCreateContextAttribs"):
        raise OpenGLError("OSMesa is older than Mesa 12.", "install Mesa 17 or later")
    return opened


def _open(name: str) -> ctypes.CDLL | None:
    try:
        # Local: Mesa brings an LLVM, whose names would replace those of other libraries that are loaded later, which
        # makes PyTorch's compiler crash. Nor must the functions of one system hide those of the other.
        return ctypes.CDLL(name, mode=ctypes.RTLD_LOCAL)
    except OSError:
        return None


def missing(system: GLSystem) -> OpenGLError | None:
    """Find what a system lacks on this machine, and how to install it; None if its libraries are there."""
    try:
        open_libraries(system)
    except OpenGLError as error:
        return error
    return None


def _installed_system() -> GLSystem | None:
    """The first system whose libraries are installed."""
    return next((system for system in SYSTEM_NAMES if not missing(system)), None)


def default_system() -> GLSystem:
    """The system of PYOPENGL_PLATFORM if that names one, else the first that is installed; OpenGLError if none."""
    requested = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    for system in SYSTEM_NAMES:
        if system == requested:
            if lack := missing(system):
                other = _installed_system()
                instead = (
                    f"set PYOPENGL_PLATFORM={other}, which is installed"
                    if other
                    else "unset PYOPENGL_PLATFORM"
                )
                raise OpenGLError(
                    f"PYOPENGL_PLATFORM={requested}, but {lack.trouble}",
                    f"{lack.remedy}; or {instead}; {_WITHOUT_OPENGL}",
                )
            return system
    if installed := _installed_system():
        return installed
    lacks = [lack for system in SYSTEM_NAMES if (lack := missing(system))]
    trouble, remedy = " ".join(lack.trouble for lack in lacks), " or ".join(lack.remedy for lack in lacks)
    raise OpenGLError(trouble, f"{remedy}; {_WITHOUT_OPENGL}")


def bind_opengl(system: GLSystem | None = None) -> GLSystem:
    """Choose the system that OpenGL runs on in this process, and return it; None for the one in use or the default.

    Mesa's software renderer starts no threads (LP_NUM_THREADS=0, unless it is set): they hardly speed up small
    pictures, and a process that is forked while they run would wait for them forever.

    Raises:
        RuntimeError: If the process is bound to another one already.
        OpenGLError: If its libraries are not installed; an OSError.
    """
    if system not in (None, *SYSTEM_NAMES):
        raise ValueError(f"OpenGL platform is {system!r}, expected 'osmesa' or 'egl'.")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    prepare_pyopengl()
    bound = _bound_system()
    if bound is None:
        bound = system or default_system()
        if lack := missing(bound):
            raise OpenGLError(lack.trouble, f"{lack.remedy}; {_WITHOUT_OPENGL}")
        os.environ["PYOPENGL_PLATFORM"] = bound
        import OpenGL.platform  # noqa: F401
    elif system not in (None, bound):
        raise RuntimeError(
            f"OpenGL platform is {system!r}, but this process already uses {bound!r}, and PyOpenGL serves "
            f"only one. Draw with {system!r} in a process of its own."
        )
    if bound == "osmesa":
        _make_contexts_comparable()
    else:
        complete_egl()
    return bound


def _bound_system() -> GLSystem | None:
    """The system that PyOpenGL is bound to in this process; None if it has not been imported."""
    loaded = sys.modules.get("OpenGL.platform")
    if loaded is None or not hasattr(loaded, "PLATFORM"):
        return None
    name = type(loaded.PLATFORM).__name__
    if name not in _PYOPENGL_NAMES:
        system = _installed_system() or "osmesa"
        raise RuntimeError(
            f"PyOpenGL was imported for a display ({name}) before a camera could choose {SYSTEM_NAMES[system]}. Make "
            f"the camera before importing what draws on a display, or set PYOPENGL_PLATFORM={system} before Python "
            "starts."
        )
    return _PYOPENGL_NAMES[name]


def prepare_pyopengl() -> None:
    """Let pyrender and PyOpenGL, if they are not imported yet, do without the libraries of a display."""
    if "pyrender" not in sys.modules:
        stand_in: Any = ModuleType("pyrender.viewer", "Replaces pyrender's viewer, which needs a display.")
        stand_in.Viewer = _NoViewer
        sys.modules.setdefault("pyrender.viewer", stand_in)
    if "OpenGL.platform" not in sys.modules:
        from OpenGL.plugins import PlatformPlugin

        PlatformPlugin.by_name("osmesa").load = _osmesa_of_pyopengl
        PlatformPlugin.by_name("egl").load = _egl_of_pyopengl


class _NoViewer:
    """Replaces `pyrender.Viewer`."""

    def __init__(self, *arguments: object, **options: object) -> None:
        raise RuntimeError(
            "pyrender.Viewer is left out, since it needs a display. To use it in this process, import pyrender before "
            "the first camera is made."
        )


def _osmesa_of_pyopengl() -> type:
    from OpenGL.platform import osmesa

    (library,) = open_libraries("osmesa")
    return type("OSMesaPlatform", (osmesa.OSMesaPlatform,), {"GL": library})


def _egl_of_pyopengl() -> type:
    from OpenGL.platform import egl

    egl_library, opengl = open_libraries("egl")
    return type("EGLPlatform", (egl.EGLPlatform,), {"EGL": egl_library, "GL": opengl})


def _make_contexts_comparable() -> None:
    """Let PyOpenGL recognise the current context of OSMesa when it reads it again.

    It gets a new pointer object at every call, which cannot be a key (3.1.0) or is another key every time (later
    versions); keys are needed to look up extensions and stored values. The objects stay those of PyOpenGL otherwise,
    which MuJoCo's renderer relies on.
    """
    import OpenGL.platform
    from OpenGL.raw.osmesa._types import OSMesaContext

    class ContextKey(OSMesaContext):
        """A pointer to a context, equal to any other pointer to it."""

        _type_ = OSMesaContext._type_  # not inherited; without it, following the pointer crashes

        def _key(self) -> int:
            return ctypes.cast(self, ctypes.c_void_p).value or 0

        def __hash__(self) -> int:
            return hash(self._key())

        def __eq__(self, other: object) -> bool:
            return self._key() == (other._key() if isinstance(other, ContextKey) else other)

    OpenGL.platform.GetCurrentContext.restype = ContextKey


def complete_egl() -> None:
    """Add to PyOpenGL 3.1.0 what later versions have of EGL.

    That is the type of EGL's devices, which MuJoCo's renderer needs, and a prefix of extensions as bytes: without
    it, looking up an extension that does not exist raises a TypeError.
    """
    from OpenGL import EGL
    from OpenGL._opaque import opaque_pointer_cls
    from OpenGL.raw.EGL._types import EGLQuerier

    if not hasattr(EGL, "EGLDeviceEXT"):
        EGL.EGLDeviceEXT = opaque_pointer_cls("EGLDeviceEXT")
    if isinstance(EGLQuerier.prefix, str):
        EGLQuerier.prefix = EGLQuerier.prefix.encode()
        EGLQuerier.version_prefix = EGLQuerier.version_prefix.encode()
