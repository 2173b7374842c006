"""Processes for the code and commands of the documentation."""

import multiprocessing
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

#: Libraries that take seconds to import: each process begins with these imported, and without modules of this project.
LIBRARIES = ["matplotlib.pyplot", "numba", "scipy.optimize", "torch", "trimesh"]
#: No example takes this long, even on a machine ten times slower [s].
LIMIT_S = 600


class Ended(NamedTuple):
    """Result of a process."""

    status: int | None
    output: str


def _in_process(function: Callable[..., int | None], arguments: tuple[object, ...], folder: Path) -> None:
    """Run a function in this process, with its output in a file."""
    output = os.open(folder / "output.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(output, sys.stdout.fileno())
    os.dup2(output, sys.stderr.fileno())
    os.chdir(folder)
    import matplotlib

    matplotlib.use("Agg")
    sys.exit(function(*arguments))


@pytest.fixture(scope="session")
def separate_process() -> Callable[..., Ended]:
    """Call a function in a separate process and folder: a fork of a process that has imported large libraries.

    The tests' own process checks types at each call, and examples would share its state.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LIBRARIES)

    def run(function: Callable[..., int | None], *arguments: object, folder: Path) -> Ended:
        process = context.Process(target=_in_process, args=(function, arguments, folder))
        process.start()
        process.join(LIMIT_S)
        process.kill()
        process.join()
        return Ended(process.exitcode, (folder / "output.txt").read_text("utf-8"))

    return run
