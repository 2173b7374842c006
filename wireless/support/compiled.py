"""How inner loops are compiled, and called.

Loops over triangles, paths or cells are compiled by numba at their first call, and kept on disk for the next
process (`compiled_files`). They let go of the interpreter lock, so that threads may work side by side. Type
checkers that wrap functions (as the tests do) are taken off first: the compiler reads plain functions only.

A signal waits until a loop is through. Numba makes Python objects of what a loop returns by calling Python, and
does not look whether that failed: were Ctrl-C's KeyboardInterrupt raised there, where the first chance for it is
if the loop ran in the main thread, an array would be made of no class, and the process end in a segmentation
fault. While functions compile, a signal waits for the one at hand: LLVM calls back into Python, where the
exception would be printed and lost.

This file, `compiled_files` and `linked` stand in `slam` and in `wireless` alike, as neither imports the other; a test
compares them.
"""

import _signal  # `signal` makes enumerations of what these return: ten times the time
import gc
import inspect
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from signal import SIGALRM, SIGINT, SIGTERM, raise_signal
from types import FrameType
from typing import Any, TypeVar, cast

import numba
from numba import types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from .compiled_files import CompiledFiles
from .linked import OptimisedOnce

F = TypeVar("F", bound=Callable[..., object])


#: No function here is called from C.
_OPTIONS = {"nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def compiled(function: F) -> F:
    """The same function, compiled to machine code; its annotations are for the reader."""
    plain = inspect.unwrap(function)
    config: Any = numba.config
    if config.DISABLE_JIT:  # for debuggers
        return cast(F, plain)
    return cast(F, _Loop(plain, {}, _OPTIONS))


class _Part(CPUDispatcher):
    """A compiled function that others call; it cannot be called from Python, for which there is `_Loop`."""

    def __init__(
        self,
        function: Callable[..., object],
        local_types: dict[str, Any],
        options: dict[str, Any],
    ):
        super().__init__(function, local_types, options, OptimisedOnce)
        self._cache = CompiledFiles(self, between=_signals.let_in)

    def compile(self, sig: Any) -> Any:
        with global_compiler_lock, self._cache.no_other_process(), _uncollected():
            return super().compile(sig)


class _Loop(_Part):
    """A compiled function that no signal interrupts half-way.

    What other compiled functions call of it is compiled without what unpacks arguments from Python, which for records
    of many arrays is as much code again.
    """

    def __init__(
        self,
        function: Callable[..., object],
        local_types: dict[str, Any],
        options: dict[str, Any],
    ):
        super().__init__(function, local_types, options)
        self._part: Any = _Part(function, local_types, {**options, "no_cpython_wrapper": True})

    def get_call_template(self, args: Any, kws: Any) -> Any:
        # A constant counts as any number of its type: numba would compile a function for it alone.
        args, kws = (
            [types.unliteral(one) for one in args],
            {k: types.unliteral(one) for k, one in kws.items()},
        )
        return self._part.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Where other compiled functions find this one."""
        return self._part.get_overload(sig)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        # Signals are handled in the main thread alone.
        if _signals.wait or threading.current_thread() is not threading.main_thread():
            return super().__call__(*args, **kwargs)
        with _signals:
            return super().__call__(*args, **kwargs)


@contextmanager
def _uncollected() -> Iterator[None]:
    """No search for garbage while a function compiles: it would take a sixth of the time, and find little."""
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()


class _Signals:
    """Signals whose handlers may raise: kept while a loop runs, raised again after it."""

    #: Ctrl-C, a polite end, a time limit.
    NUMBERS = (SIGINT, SIGTERM, SIGALRM)

    def __init__(self) -> None:
        self._handler: dict[int, Any] = {}
        self._came: list[int] = []

    @property
    def wait(self) -> bool:
        """Whether signals are being kept."""
        return bool(self._handler)

    def __enter__(self) -> None:
        try:
            for number in self.NUMBERS:
                handler = _signal.getsignal(number)
                if callable(handler):
                    self._handler[number] = handler
                    _signal.signal(number, self._note)
        except BaseException:  # of a signal that is not kept yet
            self._release()
            raise

    def __exit__(self, *error: object) -> None:
        self._release()
        came, self._came = self._came, []
        for number in came:
            raise_signal(number)

    def let_in(self) -> None:
        """Raise what came so far."""
        if self._came:
            self.__exit__()
            self.__enter__()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._came.append(number)

    def _release(self) -> None:
        """Give signals back to their handlers, all of them even if one raises meanwhile."""
        try:
            while self._handler:
                number = next(iter(self._handler))
                _signal.signal(number, self._handler[number])
                del self._handler[number]
        finally:
            if self._handler:
                self._release()


_signals = _Signals()
