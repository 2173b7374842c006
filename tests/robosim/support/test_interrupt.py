"""Ctrl-C in a loop: noted once, raised when it is pressed again, and as it was afterwards."""

import contextlib
import signal
import threading

import pytest

from robosim.cli import main
from robosim.support.interrupt import noted_interrupt, unwinding


def test_the_first_is_noted_and_the_second_raises(capfd):
    with pytest.raises(KeyboardInterrupt), noted_interrupt("this step") as interrupt:
        assert not interrupt.is_requested
        signal.raise_signal(signal.SIGINT)
        assert interrupt.is_requested
        assert capfd.readouterr().err == "Stopping after this step. Press Ctrl-C again to end at once.\n"
        signal.raise_signal(signal.SIGINT)


def test_sigterm_is_noted_where_that_is_asked_for():
    """And ends with its own status."""
    with (
        pytest.raises(SystemExit) as stop,
        noted_interrupt("it", (signal.SIGINT, signal.SIGTERM)) as interrupt,
    ):
        signal.raise_signal(signal.SIGTERM)
        assert interrupt.word == "terminated"
        interrupt.stop()
    assert stop.value.code == 143


def test_sigterm_unwinds():
    with pytest.raises(SystemExit) as stop, unwinding():
        signal.raise_signal(signal.SIGTERM)
    assert stop.value.code == 143


def test_what_fails_of_a_swallowed_interruption_is_reported_as_the_interruption(monkeypatch, capsys):
    """SciPy's import ends so in a NameError."""

    def importing(words):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise NameError("name '_ndimage_api' is not defined")

    monkeypatch.setattr("robosim.cli._run", importing)
    with pytest.raises(SystemExit) as stop:
        main(["plan"])
    assert stop.value.code == 130
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("presses", [0, 1])
def test_afterwards_signals_go_where_they_went_before(presses):
    before = signal.getsignal(signal.SIGINT)
    with noted_interrupt("this step"):
        for _ in range(presses):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_another_thread_has_no_signals_to_note():
    """Setting a handler there would raise."""
    requested = []

    def work():
        with noted_interrupt("this step") as interrupt:
            requested.append(interrupt.is_requested)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert requested == [False]
