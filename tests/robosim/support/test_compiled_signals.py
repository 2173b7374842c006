"""A signal finds compiled functions whole."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import robosim.support.compiled
from robosim.support.compiled import delayed_signals
from tests.robosim.support.mini_package import output_of, start
from wireless.geometry.convex import area_of

#: A loop of a second whose result numba makes by calling Python, and Ctrl-C in it or in its compiling.
INTERRUPTED = """
    import os, signal, threading, time
    from typing import NamedTuple

    import numpy as np

    from mini.compiled import compiled


    class Result(NamedTuple):
        values: np.ndarray
        number: int


    @compiled
    def spin(rounds, n):
        x = np.ones(n)
        for i in range(rounds):
            x[i % n] = np.sin(x[i % n] + i)
        return Result(x, 1)


    def interrupted(delay, call, longer=None):
        for _ in range(20):
            through = False
            try:
                threading.Timer(delay, os.kill, (os.getpid(), SIGNAL)).start()
                call()
                through = True
                time.sleep(60)
            except Stop:
                # On a busy machine the signal may come when all is over: then once more, for longer.
                if not through or longer is None:
                    return
                longer()
            else:
                break
        raise SystemExit("not interrupted")


    class Ended(Exception):
        pass


    def end(number, frame):
        raise Ended


    SIGNAL, Stop = signal.SIGINT, KeyboardInterrupt
    interrupted(0.05, lambda: spin(10, 3))
    begin = time.perf_counter()
    spin(2_000_000, 3)
    rounds = max(1, int(2_000_000 * 0.3 / (time.perf_counter() - begin)))

    def more():
        global rounds
        rounds *= 2

    for i in range(4):
        interrupted(0.02 + 0.05 * i, lambda: spin(rounds, 3), more)
    SIGNAL, Stop = signal.SIGTERM, Ended
    signal.signal(SIGNAL, end)
    interrupted(0.1, lambda: spin(rounds, 3), more)
    assert signal.getsignal(signal.SIGTERM) is end
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    asked = []
    signal.signal(signal.SIGINT, lambda number, frame: asked.append(number))
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    assert spin(rounds, 3).number == 1
    timer.join()
    assert asked == [signal.SIGINT]
    print("whole")
"""


def test_signals_wait_until_a_loop_is_through(mini):
    """Ctrl-C in a loop of the main thread, and in its compiling, is a KeyboardInterrupt; so for other handlers.

    Left alone, it is raised where numba makes an array of the result, and the process ends with signal 11.
    """
    assert output_of(start(mini, INTERRUPTED)).split() == ["whole"]


def test_several_loops_delay_signals_once_and_only_to_the_next_loop():
    """A signal between two loops is raised where the second starts, one after the last loop at the end of the block."""
    triangle, before, raised_late = np.eye(3, 2), signal.getsignal(signal.SIGINT), False
    with pytest.raises(KeyboardInterrupt), delayed_signals():
        delaying = signal.getsignal(signal.SIGINT)
        assert delaying != before
        area_of(triangle, 3)
        assert signal.getsignal(signal.SIGINT) == delaying
        signal.raise_signal(signal.SIGINT)
        raised_late = True
        area_of(triangle, 3)
        raise SystemExit("not interrupted")
    assert raised_late and signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt), delayed_signals():
        area_of(triangle, 3)
        signal.raise_signal(signal.SIGINT)
        raised_late = "at the end"
    assert raised_late == "at the end" and signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_during_a_trace_is_a_keyboard_interrupt():
    """Tracing in the main thread, interrupted four times in a process; before, it died at the first."""
    program = """
        import os, signal, threading, time

        import numpy as np
        import trimesh

        from wireless import Tracer, TracerConfig

        tracer = Tracer(trimesh.creation.box((8, 6, 3)), config=TracerConfig(scene="plan"))
        tx, rx = np.zeros((1, 3)), np.random.default_rng(0).uniform(-1, 1, (400, 3))
        tracer.trace(tx, rx[:1], workers=1)
        for i in range(4):
            try:
                threading.Timer(0.02 + 0.03 * i, os.kill, (os.getpid(), signal.SIGINT)).start()
                while True:
                    tracer.trace(tx, rx, workers=1)
            except KeyboardInterrupt:
                print("stopped")
    """
    root = Path(robosim.support.compiled.__file__).parents[3]
    process = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert process.returncode != -signal.SIGSEGV, process.stderr
    assert process.returncode == 0 and process.stdout.split() == ["stopped"] * 4, process.stderr
