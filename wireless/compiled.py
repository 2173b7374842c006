"""How inner loops are compiled.

Loops over triangles and paths are compiled by numba at their first call (about a minute for all), and kept
on disk for the next run. They let go of the interpreter lock, so that threads may trace side by side. Type
checkers that wrap functions (as the tests do) are taken off first: the compiler reads plain functions only.

Numba compiles what a function calls into it, from other files too, but notices changes of its own file only.
So what is kept is thrown away here whenever any source of this package has changed.
"""

import contextlib
import inspect
import logging
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba

logger = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., object])


def _forget_outdated(folder: Path) -> None:
    """Delete compiled functions if they were made from other sources than those in the folder now."""
    sources = sorted((p.name, p.stat().st_mtime_ns, p.stat().st_size) for p in folder.glob("*.py"))
    kept, stamp = folder / "__pycache__", folder / "__pycache__" / "compiled.stamp"
    with contextlib.suppress(OSError):  # not ours to write: numba keeps its files elsewhere then
        if stamp.exists() and stamp.read_text() == repr(sources):
            return
        for file in kept.glob("*.nb[ci]"):
            file.unlink(missing_ok=True)
        kept.mkdir(exist_ok=True)
        stamp.write_text(repr(sources))
        logger.warning(
            "The first use of the radio compiles its inner loops: about a minute, kept for later runs."
        )


_forget_outdated(Path(__file__).parent)


def compiled(function: F) -> F:
    """The same function, compiled to machine code; its annotations are for the reader."""
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(inspect.unwrap(function)))
