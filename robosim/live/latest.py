"""A worker for which only the latest request counts: what a dragged handle asks for is stale a frame later."""

import logging
import threading
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Any, Generic, TypeVar

logger = logging.getLogger(__name__)
T = TypeVar("T")


class Latest(Generic[T]):
    """A thread that works on one request at a time, and always takes the latest one."""

    def __init__(self, name: str, work: Callable[[T], None], failed: Callable[[Exception], None]) -> None:
        """Start the thread.

        Args:
            name: Of the thread.
            work: What is done with a request; it may ask `stale` and break off.
            failed: Is told of what `work` raises. The thread goes on with the next request.
        """
        self._work, self._failed = work, failed
        self._changed = threading.Condition()
        self._waiting: list[T] = []
        self._busy = self._closed = False
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, request: T) -> None:
        """Ask for something; a request that still waits is dropped for it."""
        with self._changed:
            self.dropped += len(self._waiting)
            self._waiting[:] = [request]
            self._changed.notify_all()

    @property
    def stale(self) -> bool:
        """Whether a newer request waits, or nobody does any more."""
        with self._changed:
            return bool(self._waiting) or self._closed

    def settle(self, timeout_s: float) -> bool:
        """Wait until nothing is asked for and nothing is worked on; returns whether that came to be in time."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._waiting or self._busy), timeout_s)

    def close(self) -> None:
        """Drop what waits, and let the thread end after what it is working on."""
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
            except Exception as error:  # whoever asked is told, and may ask for something else
                logger.debug("%s failed", self._thread.name, exc_info=True)
                if not self._closed:
                    self._failed(error)


def close_all(workers: Sequence[Latest[Any]], timeout_s: float = 2.0) -> None:
    """End workers together; one that does not break off in time is left to end by itself.

    Args:
        workers: All that are to end.
        timeout_s: How long to wait for them in all.
    """
    for worker in workers:
        worker.close()
    end = monotonic() + timeout_s
    for worker in workers:
        worker.join(max(end - monotonic(), 0.0))
