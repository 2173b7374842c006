"""MuJoCo, imported in an environment in which its import works.

With `MUJOCO_GL=egl`, as many servers have it set, `import mujoco` fails with the PyOpenGL that pyrender requires; its
renderer is not used here. And it imports glfw, which starts another Python that reads the version of its library: that
costs time, and a signal in that moment leaves that Python's traceback on the terminal. With the path of the library in
`PYGLFW_LIBRARY`, glfw starts none. The environment is restored after the import.
"""

import os
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import patch


def _environment() -> dict[str, str]:
    """The environment variables during the import."""
    variables = dict(os.environ)
    if variables.get("MUJOCO_GL", "").lower() == "egl" and version("PyOpenGL") == "3.1.0":
        del variables["MUJOCO_GL"]
    glfw = find_spec("glfw")
    if "PYGLFW_LIBRARY" not in variables and glfw is not None and glfw.origin is not None:
        windows = "wayland" if variables.get("XDG_SESSION_TYPE") == "wayland" else "x11"
        library = Path(glfw.origin).with_name(windows) / "libglfw.so"
        if library.is_file():
            variables["PYGLFW_LIBRARY"] = str(library)
    return variables


with patch.dict(os.environ, _environment(), clear=True):
    import mujoco

__all__ = ["mujoco"]
