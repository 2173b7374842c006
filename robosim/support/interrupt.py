"""Signals that a loop handles where its state is complete.

Python raises KeyboardInterrupt between any two instructions: in the middle of a step, which leaves half a log, or
inside of a callback from C, where it is printed and lost. Here the first Ctrl-C is noted, a line says what is finished
first, and the loop ends where its state is complete. A second one raises the error at once.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

#: Exit status of a command that was ended by a signal is this and the signal's number.
SIGNALLED = 128


@dataclass
class Interrupt:
    """Whether the user has requested a stop."""

    signal: int = 0
    """Number of the first signal that came, 0 for none."""

    @property
    def is_requested(self) -> bool:
        """Whether any came."""
        return self.signal != 0

    @property
    def word(self) -> str:
        """Name of such an end in results."""
        return "terminated" if self.signal == signal.SIGTERM else "interrupted"

    def stop(self) -> None:
        """Raise KeyboardInterrupt after SIGINT, SystemExit after another signal."""
        if self.signal == signal.SIGINT:
            raise KeyboardInterrupt
        if self.is_requested:
            raise SystemExit(SIGNALLED + self.signal)


@contextmanager
def noted_interrupt(
    waits_for: str, signals: tuple[signal.Signals, ...] = (signal.SIGINT,)
) -> Iterator[Interrupt]:
    """Note the first signal inside of the block, and print what the loop finishes first, which is `waits_for`.

    Outside of the main thread, which alone receives signals, none comes.
    """
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return

    def note(number: int, frame: FrameType | None) -> None:
        if interrupt.is_requested:
            signal.signal(number, signal.SIG_IGN)
            interrupt.signal = number
            interrupt.stop()
        interrupt.signal = number
        print_line(f"Stopping after {waits_for}. Press Ctrl-C again to end at once.")

    with _handled(signals, note):
        yield interrupt


@contextmanager
def unwinding() -> Iterator[Interrupt]:
    """Let SIGTERM unwind the program, as Ctrl-C does, so that partial files are removed.

    Yields the signal: a library may swallow an interruption of its import and fail later, so that an error after a
    signal is reported as the signal.
    """
    interrupt = Interrupt()

    def end(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)
        interrupt.signal = number
        interrupt.stop()

    with _handled((signal.SIGINT, signal.SIGTERM), end):
        yield interrupt


@contextmanager
def _handled(
    numbers: tuple[signal.Signals, ...], handler: Callable[[int, FrameType | None], None]
) -> Iterator[None]:
    """Have signals handled inside of the block, but for those that are ignored, as a shell does for its background."""
    heeded = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in heeded}
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)


def print_line(line: str) -> None:
    """Print a line on standard error from a signal handler, where files of Python may be in use."""
    # A bar may be on the line: begin at its start, and clear the rest of it.
    start = "\r\x1b[K" if sys.stderr is not None and sys.stderr.isatty() else ""
    with contextlib.suppress(OSError):  # standard error is closed
        os.write(2, f"{start}{line}\n".encode())
