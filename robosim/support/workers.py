"""Worker processes for many calls, on this machine or on a cluster; all sweeps use them.

Each process has one thread, so that results do not depend on the number of processes. The caller receives results as
they come and writes them: processes of a cluster need no common folder. A result stays with its worker until the
caller is ready for it, so that the memory of each process does not depend on the number of calls.

- Ctrl-C: running calls are finished, and no others begin. A second Ctrl-C ends the sweep at once.
- A killed process, as by a machine out of memory, loses its call. The others continue, with a new process, and at the
  end `WorkerLost` is raised. On a cluster another process runs such calls again.
- Processes never outlive the one that started them, however that ends.
"""

import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from types import TracebackType
from typing import Any

import cloudpickle

from robosim.support.installation import install_command
from robosim.support.interrupt import noted_interrupt
from robosim.support.processes import Processes


class WorkerLost(ChildProcessError):
    """Processes ended before their work was done."""


class Workers:
    """Processes, from when the first call is made until the block ends."""

    def __init__(
        self, count: int, cluster: str | None = None, *, what: str = "calls", resumable: bool = False
    ) -> None:
        """Processes on this machine, or the workers of the dask scheduler at the address `cluster`.

        `what` names the calls in messages. Calls that are `resumable` are stopped by Ctrl-C at once.
        """
        if count < 1:
            raise ValueError(f"workers is {count}, expected at least one process.")
        self._count, self._cluster, self._what, self._resumable = count, cluster, what, resumable
        self._executor: Processes | None = None
        self._client: Any = None
        self._arrivals: Any = None
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
        """Call a function with each of some arguments; yields numbers of calls and their results, as they come.

        Functions and arguments are pickled by value where necessary, so that those of a script or a notebook work.

        Raises:
            KeyboardInterrupt: After Ctrl-C, when all running calls are finished.
            WorkerLost: At the end, if processes were killed; or at once, if no new one stays alive, or no scheduler.
            Exception: The first error of a call.
        """
        try:
            yield from self._run(function, calls)
        except BaseException as error:
            # Without a scheduler, distributed raises errors of its own, or OSError when it connects again.
            is_cut_off = self._client is not None and self._client.status != "running"
            is_theirs = type(error).__module__.partition(".")[0] == "distributed"
            if not (is_theirs or (is_cut_off and isinstance(error, OSError))):
                raise
            raise WorkerLost(
                f"the dask scheduler at {self._cluster} does not answer ({type(error).__name__}). Finished "
                "parts are saved: start it and give the same command again."
            ) from error

    def _run(
        self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Any]]:
        if self._client is not None:
            from distributed import as_completed

            self._arrivals = as_completed(loop=self._client.loop)
        waiting = enumerate(calls)
        running: dict[Any, int] = {}
        lost = handed = 0
        handed_before = -1
        while True:
            broken = False
            window = self._window()
            while not self._interrupt.is_requested and len(running) < window:
                call = next(waiting, None)
                if call is None:
                    break
                running[self._submit(function, call[1])] = call[0]
            if not running:
                break
            finished = self._finished(running)
            while finished:
                future = finished.pop()
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
                if handed == handed_before:
                    lost += len(running)
                    self._close(at_once=True)
                    break
                handed_before = handed
        self._interrupt.stop()
        if lost:
            raise WorkerLost(
                f"a worker process was killed, perhaps for lack of memory: {lost} of the {self._what} are lost. "
                "Finished parts are saved: give the same command again, perhaps with fewer --workers."
            )

    def in_order(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> list[Any]:
        """Results in the order of their calls; see `run`."""
        results = dict(self.run(function, calls))
        return [results[number] for number in sorted(results)]

    def _window(self) -> int:
        """Number of calls in progress: they take seconds, so that none has to wait in a process."""
        return self._count if self._client is None else 2 * max(1, sum(self._client.ncores().values()))

    def _finished(self, running: dict[Any, int]) -> list[Any]:
        """Calls that are finished, at least one."""
        if self._client is None:
            return list(wait(running, return_when=FIRST_COMPLETED).done)
        return list(self._arrivals.next_batch())

    def _submit(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        content = cloudpickle.dumps((function, arguments))
        if self._client is not None:
            future = self._client.submit(_call, content, pure=False)
            self._arrivals.add(future)
            return future
        if self._executor is None:
            self._executor = Processes(self._count)
        return self._executor.submit(_call, content)

    def _close(self, *, at_once: bool) -> None:
        executor, self._executor = self._executor, None
        if executor is None:
            return
        if at_once:
            executor.kill()
        executor.shutdown()


def _is_loss(error: Exception) -> bool:
    """Whether a process was killed; dask raises its error after three processes."""
    return isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker"


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError(f"--cluster needs dask. Install it with `{install_command('cluster')}`.") from error
    try:
        return Client(address)
    except (OSError, ValueError) as error:
        raise ValueError(f"cluster is {address!r}, where no dask scheduler answers ({error}).") from error


def _call(content: bytes) -> Any:
    function, arguments = cloudpickle.loads(content)
    return function(*arguments)
