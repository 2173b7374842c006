"""Installs missing system packages: a software renderer, and Python's venv.

    python3 scripts/system_packages.py          OSMesa if the distribution has it, otherwise EGL
    python3 scripts/system_packages.py --all    OSMesa, EGL and a browser for the tests, where the distribution has them
    python3 scripts/system_packages.py --venv   also the packages of `python3 -m venv`

The Makefile runs it before the virtual environment exists, so it uses only the standard library. It needs root or
sudo on Debian and its derivatives. On other systems, or without root, it prints what to install, and succeeds if
robosim can work with the installed packages.
"""

import argparse
import ctypes
import functools
import importlib.util
import os
import runpy
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

# The same check as the camera's, from a module that imports only the standard library.
_SYSTEMS = Path(__file__).resolve().parents[1] / "robosim" / "camera" / "rendering" / "gl_systems.py"
PACKAGES, SYSTEM_NAMES, missing = map(
    runpy.run_path(str(_SYSTEMS)).get, ("PACKAGES", "SYSTEM_NAMES", "missing")
)

#: Browser for tests of the page of `robosim live`: Debian's package, and suitable programs.
BROWSER_PACKAGE = "chromium"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: Library that Playwright needs.
DRIVER_PACKAGE, DRIVER_LIBRARY = "libatomic1", "libatomic.so.1"
VENV_PACKAGE = f"python{sys.version_info[0]}.{sys.version_info[1]}-venv"
PACKAGE_LISTS = Path("/var/lib/apt/lists")
# A cloud machine often installs updates after its start and holds the lock meanwhile.
_WAIT = ("-o", "DPkg::Lock::Timeout=300")


def main(arguments: Sequence[str]) -> int:
    """Install missing packages, report what is still missing, and return the exit status."""
    parser = argparse.ArgumentParser(description="Install what robosim needs from the system.")
    parser.add_argument("--all", action="store_true", help="both renderers, not only one, and a browser")
    parser.add_argument("--venv", action="store_true", help="what Python needs to make a virtual environment")
    options = parser.parse_args(arguments)
    if options.venv and not has_venv() and (obstacle := install([VENV_PACKAGE])):
        say(f"{sys.executable} cannot make virtual environments without {VENV_PACKAGE}. {obstacle}")
        say(f"Install it (apt-get install {VENV_PACKAGE}), or pass another Python: make PYTHON=...")
        return 1
    for system, packages in PACKAGES.items():
        if missing(system) and (obstacle := install(packages)):
            say(f"{SYSTEM_NAMES[system]} is missing ({' '.join(packages)}). {obstacle}")
        if not options.all and not missing(system):
            break
    if options.all and not any(map(shutil.which, BROWSERS)) and (obstacle := install([BROWSER_PACKAGE])):
        say(f"Chromium is missing ({BROWSER_PACKAGE}). {obstacle} Tests in a browser are skipped.")
    if options.all and not has_library(DRIVER_LIBRARY) and (obstacle := install([DRIVER_PACKAGE])):
        say(f"{DRIVER_LIBRARY} is missing ({DRIVER_PACKAGE}). {obstacle} Tests in a browser are skipped.")
    if any(not missing(system) for system in SYSTEM_NAMES):
        return 0
    say("One software renderer is needed. Install one of these, and run make again:")
    for packages in PACKAGES.values():
        say(f"  apt-get install {' '.join(packages)}")
    say(
        "On other distributions they are a part of Mesa. Ray casting needs neither: robosim episode --camera embree."
    )
    return 1


def has_venv() -> bool:
    """Whether this Python can create virtual environments with pip; Debian's cannot by default."""
    return all(importlib.util.find_spec(name) for name in ("venv", "ensurepip"))


def has_library(name: str) -> bool:
    """Whether the system has a shared library."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def install(packages: Sequence[str]) -> str:
    """Install packages; return the reason of a failure, or an empty string."""
    if not shutil.which("apt-get"):
        return "This system has no apt-get."
    root = _as_root()
    if not all(map(_offered, packages)) and not (root is None or _lists_are_there()):
        _update()
    if missing_here := [package for package in packages if not _offered(package)]:
        return f"This distribution does not offer {' '.join(missing_here)}."
    if root is None:
        return "It takes root or sudo to install it."
    say(f"Installing {' '.join(packages)}")
    _update()
    done = _apt_get("install", "-y", "--no-install-recommends", *packages)
    return "" if done.returncode == 0 else f"apt-get says: {' '.join((done.stderr or done.stdout).split())}"


@functools.cache
def _as_root() -> tuple[str, ...] | None:
    """Prefix of a command that needs root; None without root and sudo. sudo prompts on a terminal only."""
    if os.geteuid() == 0:
        return ()
    if not shutil.which("sudo"):
        return None
    if subprocess.run(["sudo", "-n", "true"], capture_output=True, check=False).returncode == 0:
        return ("sudo", "-n")
    urgent = not has_venv() or all(missing(system) for system in SYSTEM_NAMES)
    return ("sudo",) if urgent and sys.stdin.isatty() else None


def _apt_get(*arguments: str) -> subprocess.CompletedProcess[str]:
    settings = ("env", "DEBIAN_FRONTEND=noninteractive", "LC_ALL=C.UTF-8")
    command = (*(_as_root() or ()), *settings, "apt-get", "-qq", *_WAIT, *arguments)
    return subprocess.run(command, capture_output=True, text=True, check=False)


@functools.cache
def _update() -> None:
    """Fetch the lists of packages, once."""
    _apt_get("update")


def _lists_are_there() -> bool:
    return any(PACKAGE_LISTS.glob("*Packages*"))


def _offered(package: str) -> bool:
    """Whether the distribution has a package, by the lists on this machine."""
    command = ["env", "LC_ALL=C.UTF-8", "apt-cache", "policy", package]
    answer = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    return "Candidate:" in answer and "Candidate: (none)" not in answer


def say(sentence: str) -> None:
    """Print a sentence for the user."""
    print(sentence, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
