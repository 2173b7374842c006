"""Ctrl-C in a loop: noted once, raised when it is pressed again, and as it was afterwards."""

import signal
import threading

import pytest

from robosim.support.interrupt import noted_interrupt


def test_the_first_is_noted_and_the_second_raises():
    with pytest.raises(KeyboardInterrupt), noted_interrupt() as interrupt:
        assert not interrupt.asked
        signal.raise_signal(signal.SIGINT)
        assert interrupt.asked
        signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("presses", [0, 1])
def test_afterwards_signals_go_where_they_went_before(presses):
    before = signal.getsignal(signal.SIGINT)
    with noted_interrupt():
        for _ in range(presses):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_another_thread_has_no_signals_to_note():
    """Setting a handler there would raise."""
    asked = []

    def work():
        with noted_interrupt() as interrupt:
            asked.append(interrupt.asked)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert asked == [False]
