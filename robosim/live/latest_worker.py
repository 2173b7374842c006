"""A worker that processes only the latest request: the request of a dragged handle is stale a frame later."""

import logging
import threading
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Any, Generic, TypeVar

logger = logging.getLogger(__name__)
T = TypeVar("T")


class LatestWorker(Generic[T]):
    """A thread that processes one request at a time, always the latest one."""

    def __init__(self, name: str, work: Callable[[T], None], on_error: Callable[[Exception], None]) -> None:
        """Start the thread.

        `work` processes a request, and may return early if `is_stale`. After an exception, which `on_error` receives,
        the thread continues with the next request.
        """
        self._work, self._on_error = work, on_error
        self._changed = threading.Condition()
        self._waiting: list[T] = []
        self._busy = self._closed = False
        self.n_dropped = 0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, request: T) -> None:
        """Request something; a request that still waits is dropped."""
        with self._changed:
            self.n_dropped += len(self._waiting)
            self._waiting[:] = [request]
            self._changed.notify_all()

    @property
    def is_stale(self) -> bool:
        """Whether the result of the current request is not needed: a newer one waits, or the worker is closed."""
        with self._changed:
            return bool(self._waiting) or self._closed

    def settle(self, timeout_s: float) -> bool:
        """Wait until all requests are processed; returns False on timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._waiting or self._busy), timeout_s)

    def close(self) -> None:
        """Drop the waiting request; the thread ends after the current one."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify_all()

    def join(self, timeout_s: float) -> None:
        """Wait for the end of the thread after `close`."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                request = self._waiting.pop()
                self._busy = True
            try:
                self._work(request)
            except Exception as error:
                logger.debug("%s failed", self._thread.name, exc_info=True)
                if not self._closed:
                    self._on_error(error)


def close_all(workers: Sequence[LatestWorker[Any]], timeout_s: float = 2.0) -> None:
    """Close workers and wait for all of them together; a worker that does not return in time ends by itself."""
    for worker in workers:
        worker.close()
    end = monotonic() + timeout_s
    for worker in workers:
        worker.join(max(end - monotonic(), 0.0))
