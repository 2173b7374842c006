"""Processes that are sent calls and send back results, each by a pipe of its own.

Python's own pools share one pipe for all results: where a process is killed while it writes, the reader waits forever
for the rest, since the others hold that pipe open too. Here the end of a process is the end of its pipe.
"""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple

from robosim.support.parts import place_in_part

#: Libraries that would start threads of their own in each process.
_ONE_THREAD = {
    f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "VECLIB", "NUMEXPR", "NUMBA")
}
#: Interval at which a process checks that its parent is running [s].
_WATCH_S = 1.0


class Processes(ThreadPoolExecutor):
    """An executor of processes, each of which belongs to a thread that waits for it."""

    def __init__(self, count: int) -> None:
        """Each process starts when there is a call for which the others have no time."""
        super().__init__(count)
        self._of_thread = threading.local()
        self._all: list[_Process] = []
        self._is_killed = False

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """See `concurrent.futures.Executor`; the error is a BrokenProcessPool if the process is lost."""
        return super().submit(self._work, pickle.dumps((function, args, kwargs)))

    def kill(self) -> None:
        """End all processes at once, whatever they do."""
        with _starting:
            self._is_killed = True
            for process in self._all:
                process.process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `concurrent.futures.Executor`."""
        super().shutdown(wait=wait, cancel_futures=cancel_futures)
        if _spare is not None and wait and not self._is_killed:
            _spare.extend(self._all)
        else:
            for process in self._all:
                process.end()
        self._all.clear()

    def _work(self, call: bytes) -> Any:
        process = getattr(self._of_thread, "process", None) or self._start()
        try:
            process.pipe.send_bytes(call)
            is_result, content = pickle.loads(process.pipe.recv_bytes())
        except (EOFError, OSError) as error:
            self._of_thread.process = None
            process.process.join(_WATCH_S)
            with suppress(ValueError):  # shut down
                self._all.remove(process)
            raise BrokenProcessPool("a process was killed") from error
        if is_result:
            return content
        raise content

    def _start(self) -> "_Process":
        with _starting:
            if self._is_killed:
                raise BrokenProcessPool("all processes were killed")
            self._of_thread.process = process = _spare_one() or _Process.start()
            self._all.append(process)
        return process


class _Process(NamedTuple):
    """A process, and this end of its pipe."""

    process: BaseProcess
    pipe: Connection

    @classmethod
    def start(cls) -> "_Process":
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, os.getpid()), daemon=True)
        with _one_thread(), block_ctrl_c(), _without_main():
            process.start()
        there.close()  # so that it is closed when the process ends
        return cls(process, here)

    def end(self) -> None:
        """End a process that has nothing to do."""
        self.pipe.close()
        self.process.join()


#: Processes that wait for more work; None where they end with the work for which they were started.
_spare: list[_Process] | None = None
#: A single thread starts a process at a time, since starting changes environment and main module.
_starting = threading.Lock()


@contextmanager
def reuse_processes() -> Iterator[None]:
    """Until the block ends, processes whose work is done wait for more: each takes seconds to start."""
    global _spare
    before, _spare = _spare, []
    try:
        yield
    finally:
        ended, _spare = _spare, before
        for process in ended:
            process.end()


def _spare_one() -> _Process | None:
    """A process that waits, if one does and lives."""
    while _spare:
        process = _spare.pop()
        if process.process.is_alive():
            return process
        process.end()
    return None


def _serve(pipe: Connection, parent: int) -> None:
    """Answer calls until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # left to the parent
    end_with_parent(parent)
    with suppress(EOFError, OSError):
        while True:
            call = pipe.recv_bytes()
            try:
                function, args, kwargs = pickle.loads(call)
                answer = pickle.dumps((True, function(*args, **kwargs)))
            except Exception as error:
                answer = _pickled(error)
            pipe.send_bytes(answer)
    # Cleaning up of libraries takes most of a second when Python ends, and nothing outlives a process.
    with suppress(OSError):  # no reader is left
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(0)


def _pickled(error: Exception) -> bytes:
    """An error as it can be sent, with where it was raised."""
    error.add_note("".join(traceback.format_tb(error.__traceback__)).rstrip())
    place = place_in_part(error)
    try:
        error.place_in_part = place  # type: ignore[attr-defined]
        content = pickle.dumps((False, error))
        pickle.loads(content)
    except Exception:  # a few errors cannot be unpickled
        plain = RuntimeError(f"{type(error).__name__}: {error}")
        plain.place_in_part = place  # type: ignore[attr-defined]
        content = pickle.dumps((False, plain))
    return content


def end_with_parent(parent: int) -> None:
    """Let this process end soon after its parent, whose number is given, however the parent ends."""

    def follow() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_S)
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes that start inside of the block compute with one thread."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


@contextmanager
def block_ctrl_c() -> Iterator[None]:
    """Delay Ctrl-C until the block ends. Processes that start inside of it never receive it, even during imports."""
    # Python starts it with the first process, and then lets in the signals that are held back here.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _without_main() -> Iterator[None]:
    """Processes that start inside of the block do not import the running script; everything is sent by value.

    A script without `if __name__ == "__main__"` would start processes without end.
    """
    main = sys.modules["__main__"]
    spec, file = getattr(main, "__spec__", None), vars(main).get("__file__")
    main.__spec__ = None
    vars(main).pop("__file__", None)
    try:
        yield
    finally:
        main.__spec__ = spec
        if file is not None:
            vars(main)["__file__"] = file
