"""Which system OpenGL runs on in this process: OSMesa, which draws in memory, or EGL.

pyrender draws through PyOpenGL, and PyOpenGL binds itself to one system for the life of a process, when it is
first imported. `bind_opengl` chooses, before pyrender or OpenGL is imported. MuJoCo's renderer works beside it
when set to the same system (MUJOCO_GL=osmesa or egl).

No display is needed, but pyrender and PyOpenGL would ask for what belongs to one: pyrender imports its viewer, that
pyglet, and that libGL and X. `keep_x_out` leaves the viewer out.

Mesa's software renderer is kept from starting threads (LP_NUM_THREADS=0, unless set already): pictures of 128 by
128 gain next to nothing from them (two threads on two idle cores: 2 %; at 256 by 256 a fifth), and a process that is
forked while they run would wait for them forever.
"""

import ctypes
import os
import sys
from types import ModuleType
from typing import Any

from robosim.camera.rendering.gl_libraries import SYSTEM_NAMES, GLSystem, OpenGLError, missing

_PYOPENGL_NAMES: dict[str, GLSystem] = {"OSMesaPlatform": "osmesa", "EGLPlatform": "egl"}
_WITHOUT_OPENGL = 'or draw by ray casting, which needs no OpenGL: backend="embree" (--camera embree)'


def bind_opengl(system: GLSystem | None = None) -> GLSystem:
    """Choose the system that OpenGL runs on in this process, and return it.

    Args:
        system: What to use; by default what the process or PYOPENGL_PLATFORM has chosen already, else OSMesa
            if its library is there, else EGL.

    Raises:
        ValueError: If there is no system of that name.
        RuntimeError: If the process is bound to another one already.
        OpenGLError: If its libraries are not installed; an OSError.
    """
    if system not in (None, *SYSTEM_NAMES):
        raise ValueError(f"OpenGL platform is {system!r}, expected 'osmesa' or 'egl'.")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    keep_x_out()
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
        _name_contexts_by_address()
    else:
        complete_egl()
    return bound


def default_system() -> GLSystem:
    """The system that a process takes which has not been told one.

    Raises:
        OpenGLError: If PYOPENGL_PLATFORM asks for one that is not installed, or none is; an OSError.
    """
    wanted = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    for system in SYSTEM_NAMES:
        if wanted == system:
            if lack := missing(system):
                trouble = f"PYOPENGL_PLATFORM={wanted}, but {lack.trouble}"
                other = _installed_system()
                instead = (
                    f"set PYOPENGL_PLATFORM={other}, which is installed"
                    if other
                    else "unset PYOPENGL_PLATFORM"
                )
                raise OpenGLError(trouble, f"{lack.remedy}; or {instead}; {_WITHOUT_OPENGL}")
            return system
    lacks = []
    for system in SYSTEM_NAMES:
        lack = missing(system)
        if not lack:
            return system
        lacks.append(lack)
    trouble, remedy = " ".join(lack.trouble for lack in lacks), " or ".join(lack.remedy for lack in lacks)
    raise OpenGLError(trouble, f"{remedy}; {_WITHOUT_OPENGL}")


def _installed_system() -> GLSystem | None:
    """The first system whose libraries are installed."""
    return next((system for system in SYSTEM_NAMES if not missing(system)), None)


def keep_x_out() -> None:
    """Let pyrender and PyOpenGL, where they are yet to be imported, do without a display's libraries."""
    if "pyrender" not in sys.modules:
        stand_in: Any = ModuleType("pyrender.viewer", "Stands for pyrender's viewer, which needs a display.")
        stand_in.Viewer = _NoViewer
        sys.modules.setdefault("pyrender.viewer", stand_in)
    if "OpenGL.platform" not in sys.modules:
        from OpenGL.plugins import PlatformPlugin

        for name, system in _PYOPENGL_NAMES.items():
            PlatformPlugin.by_name(system).import_path = f"robosim.camera.rendering.pyopengl_systems.{name}"


class _NoViewer:
    """What `pyrender.Viewer` is after `keep_x_out`."""

    def __init__(self, *arguments: object, **options: object) -> None:
        raise RuntimeError(
            "pyrender.Viewer is left out, since it needs a display. To use it in this process, import pyrender "
            "before the first camera is made."
        )


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


def complete_egl() -> None:
    """Give PyOpenGL 3.1.0 what later versions have of EGL.

    That is the type of EGL's devices, which MuJoCo's renderer asks for, and a prefix of extensions that is compared
    with other byte strings: without it, to ask for an extension of OpenGL that is not there ends in a TypeError.
    """
    from OpenGL import EGL
    from OpenGL._opaque import opaque_pointer_cls
    from OpenGL.raw.EGL._types import EGLQuerier

    if not hasattr(EGL, "EGLDeviceEXT"):
        EGL.EGLDeviceEXT = opaque_pointer_cls("EGLDeviceEXT")
    if isinstance(EGLQuerier.prefix, str):
        EGLQuerier.prefix = EGLQuerier.prefix.encode()
        EGLQuerier.version_prefix = EGLQuerier.version_prefix.encode()


def _bound_system() -> GLSystem | None:
    """The system that PyOpenGL serves in this process already; None if it has not been imported."""
    loaded = sys.modules.get("OpenGL.platform")
    if loaded is None or not hasattr(loaded, "PLATFORM"):
        return None
    name = type(loaded.PLATFORM).__name__
    if name not in _PYOPENGL_NAMES:
        system = _installed_system() or "osmesa"
        raise RuntimeError(
            f"PyOpenGL was imported for a display ({name}) before a camera could ask for {SYSTEM_NAMES[system]}. Make "
            f"the camera before importing what draws on a display, or set PYOPENGL_PLATFORM={system} before Python "
            "starts."
        )
    return _PYOPENGL_NAMES[name]
