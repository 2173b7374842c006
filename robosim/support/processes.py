"""Processes that are sent calls and send back results, each by a pipe of its own.

Python's own pools share one pipe for all results: where a process is killed while it writes to it, whoever reads waits
for the rest for ever, since the others hold that pipe open too. Here the end of a process is the end of its pipe.
"""

import gc
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
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from robosim.support.garbage import look_for_garbage
from robosim.support.parts import place_in_part

#: Libraries that would start threads of their own in each process.
_ONE_THREAD = {
    f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "VECLIB", "NUMEXPR", "NUMBA")
}
#: How often a process looks whether the one that started it is there still [s].
_WATCH_S = 1.0


class Processes(ThreadPoolExecutor):
    """An executor of processes, each of which a thread here waits for."""

    def __init__(self, count: int) -> None:
        """Say how many; each starts when there is a call that the others have no time for."""
        super().__init__(count)
        self._count = count
        self._lock = threading.Lock()
        self._killed = False
        self._calls = 0
        self._all: list[_Process] = []
        self._idle: SimpleQueue[_Process] = SimpleQueue()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """See `concurrent.futures.Executor`; the error is a BrokenProcessPool if the process is lost.

        To be called in the main thread, which alone can hold Ctrl-C back from processes that start.
        """
        with self._lock:
            self._calls += 1
            if len(self._all) < min(self._calls, self._count):
                self._all.append(_kept_one() or _Process.started())
                self._idle.put(self._all[-1])
        return super().submit(self._work, pickle.dumps((function, args, kwargs)))

    def kill(self) -> None:
        """End all processes at once, whatever they do."""
        with self._lock:
            self._killed = True
            for process in self._all:
                process.process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `concurrent.futures.Executor`."""
        super().shutdown(wait=wait, cancel_futures=cancel_futures)
        if _kept is not None and wait and not self._killed:
            _kept.extend(self._all)
        else:
            for process in self._all:
                process.end()
        self._all.clear()

    def _work(self, call: bytes) -> Any:
        process = None
        try:
            process = self._an_idle_one()
            process.pipe.send_bytes(call)
            fine, content = pickle.loads(process.pipe.recv_bytes())
        except (EOFError, OSError) as error:
            with self._lock:
                self._calls -= 1
                if process is not None:
                    process.process.join(_WATCH_S)
                    self._all.remove(process)
            raise BrokenProcessPool("a process is gone") from error
        with self._lock:
            self._calls -= 1
        self._idle.put(process)
        if fine:
            return content
        raise content

    def _an_idle_one(self) -> "_Process":
        while True:
            try:
                return self._idle.get(timeout=_WATCH_S)
            except Empty:
                if not self._all:
                    raise EOFError("no process is left") from None


class _Process(NamedTuple):
    """A process, and this end of its pipe."""

    process: BaseProcess
    pipe: Connection

    @classmethod
    def started(cls) -> "_Process":
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, os.getpid()), daemon=True)
        with _one_thread(), block_ctrl_c(), _main_left_out():
            process.start()
        there.close()  # so that it is closed when the process ends
        return cls(process, here)

    def end(self) -> None:
        """End a process that has nothing to do."""
        self.pipe.close()
        self.process.join()


#: Processes that wait for more work; None where they end with the work that they were started for.
_kept: list[_Process] | None = None


@contextmanager
def reuse_processes() -> Iterator[None]:
    """Until the block ends, processes whose work is done wait for more: it takes each of them seconds to start."""
    global _kept
    before, _kept = _kept, []
    try:
        yield
    finally:
        ended, _kept = _kept, before
        for process in ended:
            process.end()


def _kept_one() -> _Process | None:
    """A process that waits, if one does and lives."""
    while _kept:
        process = _kept.pop()
        if process.process.is_alive():
            return process
        process.end()
    return None


def _serve(pipe: Connection, parent: int) -> None:
    """What a process does: answer calls until its pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # left to the parent
    end_with_parent(parent)
    gc.disable()  # what the first call loads stays, and is not looked through for garbage
    with suppress(EOFError, OSError):
        while True:
            call = pipe.recv_bytes()
            try:
                function, args, kwargs = pickle.loads(call)
                look_for_garbage()
                answer = pickle.dumps((True, function(*args, **kwargs)))
            except Exception as error:
                answer = _told(error)
            pipe.send_bytes(answer)
    # What libraries tidy up when Python ends takes most of a second, and nothing of it outlives a process.
    with suppress(OSError):  # nobody listens
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(0)


def _told(error: Exception) -> bytes:
    """An error as it can be sent, with where it was raised."""
    error.add_note("".join(traceback.format_tb(error.__traceback__)).rstrip())
    place = place_in_part(error)
    try:
        error.place_in_part = place  # type: ignore[attr-defined]
        content = pickle.dumps((False, error))
        pickle.loads(content)
    except Exception:  # some cannot be made again from what they hold
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
def _main_left_out() -> Iterator[None]:
    """Processes that start inside of the block do not run the script again that is running here.

    A new process of Python would import it, to find what it is sent there; here everything is sent by value. A script
    without `if __name__ == "__main__"` would start an endless row of processes.
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
