"""Inner loops as machine code.

Numba compiles a loop at its first call and caches the machine code on disk. Loops release the interpreter lock, so that
threads run in parallel.

Numba notices a change of the function that is called, but not of the functions and constants that are compiled into it.
Therefore the folder of the cached files carries a digest of the module's source and of all modules of this project that
it imports. Folders are in `NUMBA_CACHE_DIR` or in the user's cache folder (`XDG_CACHE_HOME`, `~/.cache`). If neither is
writable, each process compiles the loops that it calls. A checksum detects damaged files. A file lock lets one
process compile a function while others wait.

Signals are delayed until a loop returns; `delayed_signals` prepares that once for several loops. Numba does not check
whether creating the returned Python objects fails: the KeyboardInterrupt of Ctrl-C, raised there, would end the process
with a segmentation fault.
"""

import fcntl
import hashlib
import inspect
import logging
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, update_wrapper
from importlib.util import resolve_name
from pathlib import Path
from signal import SIGALRM, SIGINT, SIGTERM, getsignal, raise_signal, signal
from types import FrameType
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., object])

logger = logging.getLogger(__name__)

#: Packages whose sources belong to the digest, besides that of the loop itself.
PACKAGES = frozenset({"robosim", "slam", "wireless"})
#: Cached versions of a module that remain on disk, besides those that processes may be using.
MAX_VERSIONS = 8
#: Age up to which an opened version may be in use [s].
_IN_USE_S = 3600

_CACHE_DIR = "NUMBA_CACHE_DIR"
_IMPORT_TIME_S = time.time()
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|.*)|import[ \t]+(.*))", re.MULTILINE
)
#: Disabled after the first message.
_notice = logging.getLogger("robosim.compiled_loops")
_build_lock = threading.RLock()


def compiled(function: F) -> F:
    """Return the function, compiled to machine code at its first call. Annotations are not used."""
    return cast(F, Loop(inspect.unwrap(function)))  # type checkers of tests wrap functions


class Loop:
    """A function that numba compiles when it is called, or when another loop that calls it is compiled.

    Left out: records (named tuples) whose class is in a module that the loop's module does not import, directly or not.
    Their fields are not part of the digest.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._dispatcher: Any = None
        self._folder: Path | None = None

    @property
    def dispatcher(self) -> Any:
        """The function of numba; the plain function with `NUMBA_DISABLE_JIT=1`."""
        with _build_lock:
            if self._dispatcher is None:
                self._dispatcher = self._build()
            return self._dispatcher

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the machine code."""
        # Python handles signals in the main thread only.
        if _signals.are_delayed:
            _signals.let_in()
        elif threading.current_thread() is threading.main_thread():
            with _signals:
                return (self._dispatcher or self.dispatcher)(*args, **kwargs)
        return (self._dispatcher or self.dispatcher)(*args, **kwargs)

    def __reduce__(self) -> str:
        return self.py_func.__qualname__

    def _build(self) -> Any:
        import numba
        from numba.extending import typeof_impl

        typeof_impl.register(Loop, lambda loop, context: typeof_impl(loop.dispatcher, context))
        config: Any = numba.config
        if config.DISABLE_JIT:
            return self.py_func
        if folder := _folder_of(self.py_func):
            config.CACHE_DIR = str(folder)
            dispatcher: Any = numba.njit(cache=True, nogil=True, error_model="numpy")(self.py_func)
            config.CACHE_DIR = os.environ.get(_CACHE_DIR, "")
            # Unless the folder has become unwritable, or another thread has set its own.
            if Path(dispatcher.stats.cache_path).parent == folder:
                self._folder = folder
        if self._folder is None:
            dispatcher = numba.njit(nogil=True, error_model="numpy")(self.py_func)
        self._compile, dispatcher.compile = dispatcher.compile, self._compile_or_load
        return dispatcher

    def _compile_or_load(self, signature: Any) -> Any:
        """Replace the dispatcher's `compile`, also where numba compiles a loop that another loop calls."""
        from numba import types

        # A constant is an argument of its type. Numba would compile a function for each value.
        signature = tuple(map(types.unliteral, signature)) if isinstance(signature, tuple) else signature
        _signals.let_in()
        if self._folder is None:
            return self._compile(signature)
        with _lock(self._folder):
            if not _is_intact(self._folder):
                _notify(
                    f"Compiling inner loops, first those of {self.py_func.__module__}, which takes up to a minute "
                    "once. `robosim warm-up` compiles all in advance."
                )
            misses = _count_misses(self._dispatcher)
            try:
                made = self._compile(signature)
            except OSError as error:  # not cached; the next call finds the function in memory
                logger.warning(f"Compiled loops cannot be cached in {self._folder}: {error}")
                made = self._compile(signature)
            if _count_misses(self._dispatcher) > misses:
                _write_checksum(self._folder)
        return made


def _count_misses(dispatcher: Any) -> int:
    """How many signatures of a function were compiled, not loaded, in this process."""
    return sum(dispatcher.stats.cache_misses.values())


def _notify(text: str) -> None:
    """Report once in a process that it compiles."""
    if not _notice.disabled:
        _notice.warning(text)
        _notice.disabled = True


def cache_folders() -> tuple[Path, ...]:
    """Folders for cached files, best first."""
    named = os.environ.get(_CACHE_DIR)
    folders = [Path(named).absolute() / "robosim"] if named else []
    with suppress(RuntimeError):  # a user without a home directory
        user_folder = Path(os.environ.get("XDG_CACHE_HOME", ""))
        folders.append((user_folder if user_folder.is_absolute() else Path.home() / ".cache") / "robosim")
    return tuple(folders)


@cache
def writable_folder(folders: tuple[Path, ...]) -> Path | None:
    """The first folder that can be written; a warning says why none can."""
    reasons = []
    for folder in folders:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            trial = folder / f".trial-{os.getpid()}-{threading.get_ident()}"
            trial.touch()
            trial.unlink()
        except OSError as error:
            reasons.append(f"{folder} ({error.strerror})")
        else:
            return folder
    _notify(
        f"Each run compiles its inner loops, up to a minute, since no cache folder is writable: {', '.join(reasons)}. "
        "Set NUMBA_CACHE_DIR to a writable folder."
    )
    return None


def _folder_of(function: Callable[..., object]) -> Path | None:
    """Where the machine code of a function is cached; nowhere if its source is missing or has changed since import."""
    module, name = function.__module__, function.__qualname__.replace("<locals>.", "")
    root, digest = writable_folder(cache_folders()), source_digest(module)
    if root is None or not digest or not Path(inspect.getfile(function)).is_file():
        return None
    return _module_folder(root, module, digest) / name


@cache
def _module_folder(root: Path, module: str, digest: str) -> Path:
    """The folder of the current version of a module; old versions are deleted."""
    folder = root / f"{module}-{digest}"
    with suppress(OSError):
        folder.mkdir(exist_ok=True)
        os.utime(folder)
        versions = [path for path in root.glob(f"{module}-*") if path.name[len(module) + 1 :].isalnum()]
        ages = sorted((time.time() - path.stat().st_mtime, path) for path in versions)
        for age_s, version in ages[MAX_VERSIONS:]:
            if age_s > _IN_USE_S:
                shutil.rmtree(version, ignore_errors=True)
    return folder


@cache
def source_digest(module: str) -> str:
    """Digest of the source of a module and of all modules of this project that it imports, directly or not.

    It is empty if a source may differ from the code in memory.
    """
    import numba
    import numpy as np

    config: Any = numba.config
    settings = (np.__version__, config.OPT, config.BOUNDSCHECK, config.DEBUGINFO_DEFAULT)
    digest = hashlib.sha256(repr(settings).encode())
    packages = PACKAGES | {module.partition(".")[0]}
    modules, pending = {module}, [module]
    while pending:
        new = {name for name in _imports(pending.pop()) if name.partition(".")[0] in packages} - modules
        modules |= new
        pending += new
    for name in sorted(modules):
        file = getattr(sys.modules[name], "__file__", None)
        # A later time is of a machine whose clock differs.
        if file and _IMPORT_TIME_S < Path(file).stat().st_mtime <= time.time():
            return ""
        digest.update(name.encode() + hashlib.sha256(_source(name).encode()).digest())
    return digest.hexdigest()[:16]


@cache
def _source(module: str) -> str:
    file = getattr(sys.modules[module], "__file__", None)
    return Path(file).read_text("utf-8") if file else ""


@cache
def _imports(module: str) -> frozenset[str]:
    """Imported modules that a source file names."""
    package = getattr(sys.modules[module], "__package__", None) or ""
    names: set[str] = set()
    for origin, items, plain in _IMPORT.findall(_source(module)):
        if origin:
            parent = resolve_name(origin, package)
            names |= {parent, *(f"{parent}.{item}" for item in re.findall(r"\w+", items))}
        else:
            names |= set(re.findall(r"[\w.]+", plain))
    return frozenset(names & sys.modules.keys())


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Let one process at a time compile a function, or read and write its files."""
    lock = None
    # A disk without locks, or that is full: two processes may compile the same function.
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder / "lock", os.O_CREAT | os.O_RDWR)
        # Not `flock`, which also excludes other threads: another thread may hold numba's lock and wait for this one.
        fcntl.lockf(lock, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


def _checksum(folder: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.nb[ci]")):
        digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _is_intact(folder: Path) -> bool:
    """Whether a function has undamaged cached files; damaged ones are deleted."""
    with suppress(OSError, UnicodeDecodeError):
        if (folder / "checksum").read_text() == _checksum(folder):
            return True
    for path in folder.glob("*"):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
    return False


def _write_checksum(folder: Path) -> None:
    with suppress(OSError):
        (folder / "checksum").write_text(_checksum(folder))


class _Signals:
    """Delays signals whose handlers may raise, while a loop runs."""

    #: Ctrl-C, a request to end, a time limit.
    NUMBERS = (SIGINT, SIGTERM, SIGALRM)

    def __init__(self) -> None:
        self._handlers: dict[int, Any] = {}
        self._received: list[int] = []

    @property
    def are_delayed(self) -> bool:
        """Whether a loop runs in the main thread."""
        return bool(self._handlers)

    def __enter__(self) -> None:
        try:
            for number in self.NUMBERS:
                handler = getsignal(number)
                if callable(handler):
                    self._handlers[number] = handler
                    signal(number, self._note)
        except BaseException:  # raised by the handler of a signal that is not delayed yet
            self._restore()
            raise

    def __exit__(self, *error: object) -> None:
        self._restore()
        received, self._received = self._received, []
        for number in received:
            raise_signal(number)

    def let_in(self) -> None:
        """Raise the signals received so far, in the main thread."""
        if self._received and threading.current_thread() is threading.main_thread():
            self.__exit__()
            self.__enter__()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._received.append(number)

    def _restore(self) -> None:
        """Restore all handlers, even if one of them raises meanwhile."""
        try:
            while self._handlers:
                number = next(iter(self._handlers))
                signal(number, self._handlers[number])
                del self._handlers[number]
        finally:
            if self._handlers:
                self._restore()


_signals = _Signals()


@contextmanager
def delayed_signals() -> Iterator[None]:
    """Delay signals until the next loop starts or the block ends: setting handlers takes longer than a short loop."""
    if _signals.are_delayed or threading.current_thread() is not threading.main_thread():
        yield
    else:
        with _signals:
            yield
