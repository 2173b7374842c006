"""How inner loops are compiled.

Loops over triangles and paths are compiled by numba at their first call, and kept on disk for the next run.
They let go of the interpreter lock, so that threads may trace side by side. Type checkers that wrap functions
(as the tests do) are taken off first: the compiler reads plain functions only.
"""

import inspect
from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """The same function, compiled to machine code; its annotations are for the reader."""
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(inspect.unwrap(function)))
