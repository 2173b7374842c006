"""Processes that work on many calls, here or on a cluster: what every sweep of this project runs on.

Each process has one thread, so that how arrays are multiplied, and with it every result, does not depend on how many
processes there are. Results are handed back as they come, and the caller writes them: processes of a cluster
need no common folder.

- Ctrl-C: calls that are running are finished and handed back, no others begin. Pressed again, it ends at once.
- A process that is killed, as by a machine out of memory, loses the calls that were running. The others go on in
  new processes, and in the end a `WorkerLost` says so. On a cluster such calls are run again by another process.
- Processes never outlive the one that started them, however that ends.
"""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Any

import cloudpickle

from robosim.support.interrupt import noted_interrupt

#: Libraries that would start threads of their own in each process.
_ONE_THREAD = {
    f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "VECLIB", "NUMEXPR", "NUMBA")
}
#: How often a process looks whether the one that started it is there still [s].
_WATCH_S = 1.0


class WorkerLost(ChildProcessError):
    """Processes ended before their work was done."""


class Workers:
    """Processes, from when the first call is made until the block ends."""

    def __init__(
        self, count: int, cluster: str | None = None, *, what: str = "calls", resumable: bool = False
    ) -> None:
        """Say how many, or where.

        Args:
            count: Processes at once on this machine.
            cluster: Address of a dask scheduler whose workers are used instead.
            what: What the calls make, for messages.
            resumable: Whether a call goes on by itself where it was stopped, so that Ctrl-C need not wait for it.

        Raises:
            ValueError: If the count is less than 1.
        """
        if count < 1:
            raise ValueError(f"workers is {count}, expected at least one process.")
        self._count, self._cluster, self._what, self._resumable = count, cluster, what, resumable
        self._executor: Executor | None = None
        self._client: Any = None
        self._until_end = ExitStack()

    def __enter__(self) -> "Workers":
        if self._cluster is not None:
            self._client = _connect(self._cluster)
        signals = () if self._resumable else (signal.SIGINT,)
        noted = noted_interrupt(f"the {self._what} that are being worked on", signals)
        self._interrupt = self._until_end.enter_context(noted)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._until_end:
            self._close(at_once=kind is not None)
            if self._client is not None:
                self._client.close()

    def run(
        self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Any]]:
        """Call a function many times.

        Args:
            function: What to call. It and its arguments are pickled by value where need be, so that those of
                a script or a notebook will do.
            calls: Arguments of each call.

        Yields:
            Number of a call, and its result, as they come.

        Raises:
            KeyboardInterrupt: After Ctrl-C, when the calls that were running have been handed back.
            WorkerLost: At the end, if processes were killed; or at once, if no new one stays alive.
            Exception: What a call raises.
        """
        waiting = enumerate(calls)
        running: dict[Future[Any], int] = {}
        lost = handed = 0
        handed_before = -1
        while True:
            broken = False
            while not self._interrupt.asked and len(running) < self._window():
                call = next(waiting, None)
                if call is None:
                    break
                try:
                    running[self._submit(function, call[1])] = call[0]
                except BrokenProcessPool:  # one died while it had nothing to do
                    lost, broken = lost + 1, True
                    break
            if not running and not broken:
                break
            done = wait(running, return_when=FIRST_COMPLETED).done if running else ()
            for future in done:
                number = running.pop(future)
                try:
                    result = future.result()
                except Exception as error:
                    if not _is_loss(error):
                        raise
                    lost, broken = lost + 1, True
                    continue
                handed += 1
                yield number, result
            if broken:
                lost += len(running)
                running.clear()
                self._close(at_once=True)
                if handed == handed_before:
                    break
                handed_before = handed
        self._interrupt.stop()
        if lost:
            raise WorkerLost(
                f"a worker process was killed, perhaps for lack of memory: {lost} of the {self._what} are lost. "
                "What was finished is kept: give the same command again, perhaps with fewer --workers."
            )

    def in_order(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> list[Any]:
        """Results in the order of their calls; see `run`."""
        found = dict(self.run(function, calls))
        return [found[number] for number in sorted(found)]

    def _window(self) -> int:
        """Calls that are handed out at a time: they take seconds, so that none need wait in a process."""
        return self._count if self._client is None else 2 * max(1, sum(self._client.ncores().values()))

    def _submit(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Future[Any]:
        content = cloudpickle.dumps((function, arguments))
        if self._client is not None:
            self._executor = self._executor or self._client.get_executor(pure=False)
            return self._executor.submit(_call, content)
        if self._executor is None:
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(
                self._count, mp_context=context, initializer=_begin, initargs=(os.getpid(),)
            )
        with _one_thread(), _ctrl_c_held_back(), _main_left_out():
            return self._executor.submit(_call, content)

    def _close(self, *, at_once: bool) -> None:
        executor, self._executor = self._executor, None
        if executor is None:
            return
        if isinstance(executor, ProcessPoolExecutor) and at_once:
            for process in list((executor._processes or {}).values()):
                process.kill()
        executor.shutdown(wait=self._client is None)


def _is_loss(error: Exception) -> bool:
    """Whether an error says that a process is gone; dask says so after it has tried three of them."""
    return isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker"


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError("--cluster needs dask. Install it with `pip install robosim[cluster]`.") from error
    try:
        return Client(address, timeout="20s")
    except (OSError, ValueError) as error:
        raise ValueError(f"cluster is {address!r}, where no dask scheduler answers ({error}).") from error


def _call(content: bytes) -> Any:
    function, arguments = cloudpickle.loads(content)
    return function(*arguments)


def _begin(parent: int) -> None:
    """What a process does first: see to it that it ends with its parent, and leave Ctrl-C to that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(parent)


def end_with_parent(parent: int) -> None:
    """Let this process end soon after its parent has, however that ended.

    Args:
        parent: Number of the process that started this one.
    """

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
def _ctrl_c_held_back() -> Iterator[None]:
    """Ctrl-C comes when the block ends; to processes that start inside of it never, not while they import either."""
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
