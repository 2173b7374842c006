"""Robots with cameras and radio in buildings made from floor plans.

The main path is `robosim.episode`: one episode on one page. Public names are in `__init__.pyi`.
"""

import logging
import os
import signal
import sys

# As a program (its name is "-m" as long as this is loaded by `python -m robosim`) it takes a second to load, in which
# there is nothing to tidy up: Ctrl-C ends it without a word. `robosim.__main__` gives the signal back.
if (
    os.path.basename(sys.argv[0]) in ("-m", "robosim")
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, lambda number, frame: os._exit(128 + number))

from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import gymnasium

from robosim.support import installation as _installation
from robosim_support.public_names import public_names

#: `from robosim import *` brings data sets for PyTorch only where that is installed.
_hidden = () if _installation.is_installed("torch") else ("robosim.datasets.torch_data",)
__getattr__, __dir__, __all__ = public_names(__name__, __file__, _hidden)

if (_trouble := _installation.namesake()) is not None:
    logging.getLogger(__name__).warning(_trouble)

# MuJoCo's EGL needs a newer PyOpenGL than that of pyrender: with MUJOCO_GL=egl, as many servers have it
# set, `import mujoco` would fail. Its renderer is not used here but to compare with.
if os.environ.get("MUJOCO_GL", "").lower() == "egl" and version("PyOpenGL") == "3.1.0":
    del os.environ["MUJOCO_GL"]

# MuJoCo imports glfw, which starts another Python that reads the version of its library. That costs time, and a signal
# in that moment leaves that Python's traceback on the terminal. With the path of the library, glfw starts none.
if (
    "PYGLFW_LIBRARY" not in os.environ
    and (_glfw := find_spec("glfw")) is not None
    and _glfw.origin is not None
):
    _windows = "wayland" if os.environ.get("XDG_SESSION_TYPE") == "wayland" else "x11"
    _library = Path(_glfw.origin).with_name(_windows) / "libglfw.so"
    if _library.is_file():
        os.environ["PYGLFW_LIBRARY"] = str(_library)

gymnasium.register(
    id="robosim/TargetSearch-v0",
    entry_point="robosim.environments.target_search:target_search_v0",
    max_episode_steps=1000,
)
gymnasium.register(
    id="robosim/TargetSearch-v1",
    entry_point="robosim.environments.target_search:TargetSearch",
    vector_entry_point="robosim.environments.target_search_vector:TargetSearchVector",
    max_episode_steps=1000,
)
