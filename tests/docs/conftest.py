"""Processes for what the documentation has its readers run."""

import multiprocessing
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

#: What examples import first, and takes seconds: each begins with these imported, and with nothing of ours.
LIBRARIES = ["matplotlib.pyplot", "numba", "scipy.optimize", "torch", "trimesh"]
#: No example takes so long, on a machine ten times slower either [s].
LIMIT_S = 600


class Ended(NamedTuple):
    """How a process ended."""

    status: int | None
    said: str


def _apart(function: Callable[..., int | None], arguments: tuple[object, ...], folder: Path) -> None:
    """What a process of its own does."""
    said = os.open(folder / "said.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(said, sys.stdout.fileno())
    os.dup2(said, sys.stderr.fileno())
    os.chdir(folder)
    import matplotlib

    matplotlib.use("Agg")
    sys.exit(function(*arguments))


@pytest.fixture(scope="session")
def apart() -> Callable[..., Ended]:
    """Calls a function in a process of its own, in a folder: a copy of one that has imported large libraries.

    In the tests' own process types are checked at each call, and one example would see what another has left.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LIBRARIES)

    def run(function: Callable[..., int | None], *arguments: object, folder: Path) -> Ended:
        process = context.Process(target=_apart, args=(function, arguments, folder))
        process.start()
        process.join(LIMIT_S)
        process.kill()
        process.join()
        return Ended(process.exitcode, (folder / "said.txt").read_text("utf-8"))

    return run
