"""Ctrl-C that a loop asks for, rather than one that strikes anywhere in it.

Python raises KeyboardInterrupt between any two instructions: in the middle of a step, which leaves half a log, or
inside of a callback from C, where it is printed and lost. Here the first Ctrl-C is only noted, and the loop ends
where it is whole. A second one raises, for whoever cannot wait.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType


@dataclass
class Interrupt:
    """Whether Ctrl-C was pressed."""

    asked: bool = False


@contextmanager
def noted_interrupt() -> Iterator[Interrupt]:
    """Note the first SIGINT inside of the block; outside of the main thread, which alone gets signals, none comes."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return

    def note(number: int, frame: FrameType | None) -> None:
        interrupt.asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, before)
