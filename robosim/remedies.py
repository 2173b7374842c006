"""What to do about an error of the installation, as far as the error says.

What fails says little by itself: a package that cannot be imported, or a folder that cannot be written, comes up
wherever it is met first.
"""

import importlib.metadata
import re

from robosim.camera.rendering.gl_systems import OpenGLError
from robosim.support.installation import DISTRIBUTION, EXTRAS, install_command

#: No cache folder is writable.
CACHE_REMEDY = "set NUMBA_CACHE_DIR to a folder that you may write, so that compiled code is cached"

# Packages that are not called like their modules, or come with another one.
_PACKAGES = {
    "cv2": "opencv-contrib-python-headless",
    "PIL": "pillow",
    "yaml": "pyyaml",
    "OpenGL": "PyOpenGL==3.1.0",
    "rerun": "rerun-sdk",
}
_LIBRARY = re.compile(r"(lib[\w.+-]+\.so[.\d]*): cannot open shared object file")


def remedy(error: BaseException, module: str) -> str:
    """What to install or to do about an error.

    Args:
        error: What was raised.
        module: Python module that was being tried.
    """
    text = str(error)
    if isinstance(error, PermissionError) and error.filename:
        return f"get permission to use {error.filename}"
    if isinstance(error, OpenGLError):
        return error.remedy
    if isinstance(error, ImportError) and error.name and _known(error.name):
        module = error.name
    if (extra := EXTRAS.get(module.partition(".")[0])) and not _installed(module):
        return install_command(extra)
    if not _installed(module):
        return f"pip install '{_requirement(module)}'"
    again = f"pip install --force-reinstall --no-deps '{_requirement(module)}'"
    if library := _LIBRARY.search(text):
        return f"install the system's package that has {library[1]}; if it is one of {module}'s own: {again}"
    return again if isinstance(error, ImportError | OSError) else f"not known; perhaps {again}"


def _known(module: str) -> bool:
    """Whether a name in an error is that of a package, and not of a part of one (torch's _C, say)."""
    return _installed(module) or not module.startswith("_")


def _installed(module: str) -> bool:
    try:
        importlib.metadata.version(_package(module).partition("==")[0])
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _package(module: str) -> str:
    top = module.partition(".")[0]
    return _PACKAGES.get(top, top)


def _requirement(module: str) -> str:
    """What to ask pip for to get a module: as this project's own requirement says, if it has one."""
    package = _package(module)
    try:
        stated = importlib.metadata.requires(DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        stated = []
    for requirement in stated:
        if "extra ==" not in requirement and re.match(
            rf"{re.escape(package)}(?![\w.-])", requirement, re.IGNORECASE
        ):
            return requirement
    return package
