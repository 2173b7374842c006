"""Compiled functions on disk: which file is whose, and what is done where there is none.

Numba's own files would not do. It looks for changes in the file of the function that is called, but compiles into
it what that calls from others, and would go on with their old versions; it believes what it reads, damaged or
not; and it gives up where it can write nowhere.

Here a file is named after all that its machine code was made of: bytecode and constants of the function and of
whatever it calls, wherever that stands, values of globals, fields of named tuples, types of arguments, processor,
versions. A changed loop is thus another file, which is not there yet. Processes may read, write and delete side
by side: a file comes by renaming, whole, and a checksum tells a damaged one.

Files are looked for in the folder that NUMBA_CACHE_DIR names, in `__pycache__` beside the source, and in the
user's folder for caches, and written into the first of these that can be written. Where none can, functions are
compiled in every process, and that is said. What one process is compiling others wait for: on a new machine ten
workers would do the same work ten times, side by side.

Left out: what numba knows from elsewhere than a function's globals, as from `numba.extending.overload`.
"""

import contextlib
import fcntl
import hashlib
import logging
import os
import pickle
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from enum import Enum
from functools import cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

logger = logging.getLogger(__name__)

_config: Any = numba.config  # whose names come from the environment

#: Versions of a function that stay on disk: for types of arguments, processors, states of the source.
KEPT = 8
#: Age at which a half-written file is nobody's any more [s].
LEFT_OVER_S = 3600.0
#: How long a process waits for another that compiles a function, before it does so itself [s], and how often it looks.
PATIENCE_S, LOOK_S = 600.0, 0.05

#: What was said to the user already.
_told: set[str] = set()
#: Called once, when the first function has to be compiled since it is not on disk.
when_first: list[Callable[[], None]] = []


class CompiledFiles(_Cache):
    """The files of one function.

    Args:
        function: What numba made of it, a Dispatcher.
        between: Called before each function is looked for and after it was kept: whoever wants to stop may do so.
    """

    def __init__(self, function: Any, between: Callable[[], None]):
        self._function, self._between = function, between
        self._name = f"{function.__module__}.{function.__qualname__}".replace("<", "").replace(">", "")
        self._folders = folders_of(Path(function.py_func.__code__.co_filename))
        self._locks = ExitStack()

    @property
    def cache_path(self) -> str | None:
        """Where new files go."""
        folder, _ = first_writable(self._folders)
        return None if folder is None else str(folder)

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """The function for some types of arguments, if it is on disk."""
        self._between()
        target_context.refresh()
        name = self._file(sig)
        found = self._look(name, target_context)
        if found is None:
            self._tell()
            self._wait_for_others(name)
            found = self._look(name, target_context)
        return found

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Keep what was compiled, where that can be."""
        folder, _ = first_writable(self._folders)
        try:
            if folder is not None:
                write_checked(folder / self._file(sig), dumps(data._reduce()))
                _tidy(folder, self._name)
        except Exception as error:  # the function is there; another run may compile it again
            if str(folder) not in _told:
                _told.add(str(folder))
                logger.warning("Compiled loops cannot be kept in %s: %s", folder, error)
        self._between()

    @contextmanager
    def no_other_process(self) -> Iterator[None]:
        """Until its end, a function that is not on disk is compiled by this process alone."""
        before = self._locks
        try:
            with ExitStack() as self._locks:
                yield
        finally:
            self._locks = before

    def enable(self) -> None:
        """Nothing to do, as for the next two: files are made always, and outdated ones never found."""

    def disable(self) -> None:
        """See `enable`."""

    def flush(self) -> None:
        """See `enable`."""

    def _look(self, name: str, target_context: Any) -> CompileResult | None:
        """The function in a file, if there is one that can be used."""
        for folder in self._folders:
            data = read_checked(folder / name)
            if data is None:
                continue
            try:
                return CompileResult._rebuild(target_context, *pickle.loads(data))
            except Exception as error:  # whatever it is, compiling does without
                logger.info("%s cannot be used (%r); its function is compiled again.", folder / name, error)
        return None

    def _wait_for_others(self, name: str) -> None:
        """Until no other process compiles a function.

        A process waits with locks on functions that call this one, never on one that this one calls: none waits for
        another that waits for it. The system gives back locks of a process that died.
        """
        folder, _ = first_writable(self._folders)
        if folder is None:
            return
        path = folder / f".{name}.lock"
        deadline = time.monotonic() + PATIENCE_S
        # A disk may know no locks: twice compiled is as right as once.
        with contextlib.suppress(OSError):
            lock = os.open(path, os.O_CREAT | os.O_WRONLY)
            self._locks.callback(_give_back, lock, path)
            while time.monotonic() < deadline:
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    return
                except BlockingIOError:
                    time.sleep(LOOK_S)
                    self._between()

    def _file(self, sig: Any) -> str:
        """Name of the file for some types of arguments."""
        made_of = hashlib.sha256()
        types, _ = normalize_signature(sig)
        settings = (_config.OPT, _config.BOUNDSCHECK, _config.DEBUGINFO_DEFAULT, _config.USING_SVML)
        versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__)
        for part in (
            *_made_of(self._function, (), {}),
            *map(_type, types),
            *self._function.targetctx.codegen().magic_tuple(),
            *settings,
            *versions,
        ):
            made_of.update(repr(part).encode() + b"\n")
        return f"{self._name}-{made_of.hexdigest()[:32]}.compiled"

    def _tell(self) -> None:
        """Say once for each package that its functions are being compiled."""
        package = self._function.__module__.partition(".")[0]
        if package in _told:
            return
        _told.add(package)
        folder, why = first_writable(self._folders)
        if folder is not None:
            for call in [*when_first]:
                call()
            logger.warning(
                "The first use of %s compiles its inner loops: up to two minutes, kept for later runs.",
                package,
            )
            return
        logger.warning(
            "The inner loops of %s are compiled in each run, up to two minutes, since no folder for them can be "
            "written: %s. Set NUMBA_CACHE_DIR to one that can.",
            package,
            why,
        )


def _made_of(value: object, names: tuple[str, ...], met: dict[object, int]) -> Iterator[object]:
    """What the compiler takes from a value, piece by piece; from a function also what that calls.

    Args:
        value: A function, a constant, or the value of a global.
        names: Those that the code has which the value is for: what it may take from a module.
        met: Functions and modules that were gone through, and how many there were before.
    """
    if isinstance(value, Dispatcher | ModuleType):
        key = (id(value), names if isinstance(value, ModuleType) else ())
        if key in met:
            yield met[key]
            return
        met[key] = len(met)
    if isinstance(value, Dispatcher):
        function = value.py_func
        yield function.__module__, function.__qualname__, sorted(value.targetoptions.items())
        yield from _made_of(function.__defaults__, (), met)
        yield from _made_of(tuple(cell.cell_contents for cell in function.__closure__ or ()), (), met)
        yield from _code(function.__code__, function.__globals__, function.__doc__, met)
    elif isinstance(value, ModuleType):
        yield value.__name__
        for name in names:
            if name in vars(value):
                yield from _made_of(vars(value)[name], names, met)
    elif isinstance(value, tuple | list):
        yield type(value).__qualname__, len(value), getattr(value, "_fields", ())
        for item in value:
            yield from _made_of(item, names, met)
    elif isinstance(value, np.ndarray):
        yield value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()
    elif isinstance(value, type):
        members = getattr(value, "__members__", {})
        yield value.__module__, value.__qualname__, getattr(value, "_fields", ()), [*members.items()]
    elif isinstance(value, bool | int | float | complex | str | bytes | np.generic | Enum | None):
        yield type(value).__qualname__, repr(value)
    else:  # functions of NumPy and Python, by name
        yield type(value).__qualname__, getattr(value, "__module__", ""), getattr(value, "__name__", "")


def _code(
    code: CodeType, values: dict[str, object], doc: str | None, met: dict[object, int]
) -> Iterator[object]:
    """The same for the code of a function, with its globals; its docstring and line numbers do not count."""
    yield code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_flags
    yield code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_exceptiontable
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant, values, None, met)
        elif isinstance(constant, frozenset):
            yield sorted(map(repr, constant))
        elif constant is not doc or doc is None:
            yield from _made_of(constant, (), met)
    for name in code.co_names:
        if name in values:
            yield from _made_of(values[name], code.co_names, met)


def _type(one: Any) -> object:
    """All of numba's type of an argument; the name alone of a named tuple tells no fields."""
    inner = [_type(other) for other in getattr(one, "types", ())]
    of = getattr(one, "instance_class", None)
    return str(one), repr(one), getattr(one, "fields", ()), getattr(of, "__module__", ""), inner


def folders_of(source: Path) -> tuple[Path, ...]:
    """Where compiled functions of a source file may be, best first."""
    folders = [Path(_config.CACHE_DIR).absolute() / "robosim"] if _config.CACHE_DIR else []
    if source.is_file():
        folders.append(source.parent.absolute() / "__pycache__")
    with contextlib.suppress(RuntimeError):  # a user without a home
        own = Path(os.environ.get("XDG_CACHE_HOME", ""))
        folders.append((own if own.is_absolute() else Path.home() / ".cache") / "robosim")
    return tuple(folders)


@cache
def first_writable(folders: tuple[Path, ...]) -> tuple[Path | None, str]:
    """The first folder that can be written, and why those before cannot."""
    why = []
    for folder in folders:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            trial = _beside(folder / "trial")
            trial.touch()
            trial.unlink()
        except OSError as error:
            why.append(f"{folder} ({error.strerror})")
        else:
            return folder, ", ".join(why)
    return None, ", ".join(why)


def _beside(path: Path) -> Path:
    """A name for what will be renamed to a path."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.partial")


def read_checked(path: Path) -> bytes | None:
    """What was written there, if it is there and whole; that it was wanted is marked by its time."""
    try:
        found = path.read_bytes()
    except OSError:
        return None
    checksum, data = found[:32], found[32:]
    if hashlib.sha256(data).digest() != checksum:
        logger.info("%s is damaged; its function is compiled again.", path)
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return data


def write_checked(path: Path, data: bytes) -> None:
    """Write a file so that others see all of it or none."""
    partial = _beside(path)
    try:
        partial.write_bytes(hashlib.sha256(data).digest() + data)
        partial.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise


def _give_back(lock: int, path: Path) -> None:
    """Let other processes go on, and leave no file of a lock."""
    with contextlib.suppress(OSError):
        path.unlink()
    os.close(lock)


def _tidy(folder: Path, name: str) -> None:
    """Delete versions of a function that were not wanted for the longest time, and what a killed process left."""
    with contextlib.suppress(OSError):  # another process may be at the same
        versions = sorted(folder.glob(f"{name}-*.compiled"), key=lambda path: path.stat().st_mtime)
        for path in versions[:-KEPT]:
            path.unlink(missing_ok=True)
        for path in folder.glob(".*.compiled.*"):
            if time.time() - path.stat().st_mtime > LEFT_OVER_S:
                path.unlink(missing_ok=True)
