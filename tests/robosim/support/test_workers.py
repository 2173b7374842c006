"""Processes that work on calls: results, errors, lost processes, Ctrl-C, and nothing left behind."""

import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest

from robosim.support.processes import reuse_processes
from robosim.support.workers import WorkerLost, Workers

SQUARES = [(n,) for n in range(7)]

pytestmark = pytest.mark.usefixtures("real_workers")


def square(n):
    return n * n


def own_pid_and_threads(n):
    return os.getpid(), os.environ["OMP_NUM_THREADS"]


def own_pid(seconds):
    time.sleep(seconds)
    return os.getpid()


def killed_by_two(n):
    if n == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return n


def fails(n):
    raise ValueError(f"{n} is wrong")


@pytest.mark.parametrize("count", [1, 3])
def test_results_come_with_the_numbers_of_their_calls(count):
    with Workers(count) as pool:
        assert dict(pool.run(square, SQUARES)) == {n: n * n for n in range(7)}
        assert pool.in_order(square, SQUARES) == [n * n for n in range(7)]


def test_processes_are_others_of_one_thread_each(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with Workers(2) as pool:
        pids, threads = zip(*pool.in_order(own_pid_and_threads, SQUARES), strict=True)
    assert os.getpid() not in pids
    assert set(threads) == {"1"}
    assert "OMP_NUM_THREADS" not in os.environ


def test_no_process_ever_gets_ctrl_c():
    """Also not the first one, which starts together with another process of Python's: it would die as it imports."""
    code = """
import re
from pathlib import Path
from robosim.support.workers import Workers

def held_back():
    return int(re.search(r"SigBlk:\\s*(\\w+)", Path("/proc/self/status").read_text())[1], 16)

with Workers(2) as pool:
    print(*[mask for _, mask in pool.run(held_back, [()] * 2)])
print(held_back())
"""
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=True
    )
    workers, own = run.stdout.splitlines()
    ctrl_c = 1 << (signal.SIGINT - 1)
    assert [int(mask) & ctrl_c for mask in workers.split()] == [ctrl_c, ctrl_c]
    assert int(own) & ctrl_c == 0


def test_processes_wait_for_more_work_where_that_is_wanted():
    """A second sweep finds those of the first, but for one that was killed; all have ended with the block."""

    def of(count):
        with Workers(count) as pool:
            return set(pool.in_order(own_pid, [(0.5,)] * count))

    with reuse_processes():
        first = of(1)
        second = of(2)
        assert first < second
        os.kill(next(iter(first)), signal.SIGKILL)
        time.sleep(0.5)
        third = of(2)
        assert second - first < third
        assert not first & third
    assert not [pid for pid in second | third if Path(f"/proc/{pid}").exists()]
    assert of(1).isdisjoint(third)


def test_functions_travel_by_value():
    """As those of a notebook have to, where no module can be imported."""
    offset = np.arange(3)
    with Workers(1) as pool:
        assert pool.in_order(lambda n: (n + offset).tolist(), [(4,)]) == [[4, 5, 6]]


def test_an_error_of_a_call_is_raised_as_it_is():
    with pytest.raises(ValueError, match="0 is wrong"), Workers(1) as pool:
        list(pool.run(fails, SQUARES))


def test_a_killed_process_loses_its_calls_and_no_others():
    """Of nine calls by one process the third is lost; the others are done by a new one, and then an error is raised."""
    done = []
    with pytest.raises(WorkerLost, match="1 of the squares are lost"), Workers(1, what="squares") as pool:
        for _, n in pool.run(killed_by_two, [(n,) for n in range(9)]):
            done.append(n)
    assert done == [0, 1, 3, 4, 5, 6, 7, 8]


def much_at_once(n):
    """A result that takes a while to send; the third process is killed amid it."""
    if n == 2:
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return bytes(200_000_000) if n == 2 else n


def test_a_process_that_is_killed_while_it_sends_loses_its_call(monkeypatch):
    """What is read of a result half sent ends with the process, not never: a pool with one pipe for all would hang."""
    whole = Connection.recv_bytes

    def slowly(pipe):
        time.sleep(1.0)  # a pipe holds 64 kB: the rest is not sent before it is killed
        return whole(pipe)

    monkeypatch.setattr(Connection, "recv_bytes", slowly)
    with pytest.raises(WorkerLost, match="1 of the calls are lost"), Workers(2) as pool:
        done = []
        for _, n in pool.run(much_at_once, [(n,) for n in range(5)]):
            done.append(n)
    assert sorted(done) == [0, 1, 3, 4]


def test_an_error_says_where_it_was_raised():
    with pytest.raises(ValueError) as raised, Workers(1) as pool:
        list(pool.run(fails, SQUARES))
    assert "in fails" in "".join(raised.value.__notes__)


def test_processes_that_never_live_are_an_error_at_once():
    with pytest.raises(WorkerLost, match=r"\b[1-9] of the calls are lost"), Workers(2) as pool:
        list(pool.run(os._exit, [(1,)] * 1000))


def test_workers_must_be_some():
    with pytest.raises(ValueError, match="workers is 0, expected at least one process"):
        Workers(0)


def test_no_cluster_is_an_error():
    pytest.importorskip("distributed", reason="needs the extra cluster")
    with pytest.raises(ValueError, match="no dask scheduler answers"), Workers(1, "nowhere"):
        pass


SCRIPT = """
import sys, time
from robosim.support.workers import Workers
def slow(n):
    open(f"{sys_argv[1]}/begun-{n}", "w").close()
    time.sleep(float(sys_argv[2]))
    return n
sys_argv = sys.argv
with Workers(2, what="sleeps") as pool:
    for _, n in pool.run(slow, [(n,) for n in range(50)]):
        open(f"{sys.argv[1]}/done-{n}", "w").close()
"""


def _started(folder, sleep_s):
    """A script without a guard that works with two processes, once both are at work; the group of its processes."""
    script = folder / "script.py"
    script.write_text(SCRIPT)
    process = subprocess.Popen(
        [sys.executable, str(script), str(folder), str(sleep_s)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    while len(list(folder.glob("begun-*"))) < 2:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.01)
    return process


def _group_ends(group, within_s):
    """Whether all processes of a group end in time."""
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_ctrl_c_finishes_what_has_begun(tmp_path):
    """Sent to all processes, as by a terminal: what had begun is done and handed back, no more begins."""
    process = _started(tmp_path, 1.5)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=1200)
    begun, done = (
        sorted(path.name.split("-")[1] for path in tmp_path.glob(f"{what}-*")) for what in ("begun", "done")
    )
    assert begun == done
    assert 2 <= len(done) < 50
    assert said.startswith("Stopping after the sleeps that are being worked on. Press Ctrl-C again")
    assert "KeyboardInterrupt" in said
    assert _group_ends(process.pid, 10)


@pytest.mark.parametrize("signals", [(signal.SIGINT, signal.SIGINT), (signal.SIGTERM,), (signal.SIGKILL,)])
def test_what_ends_it_at_once_leaves_no_process(tmp_path, signals):
    """A second Ctrl-C, SIGTERM, SIGKILL of the one that is in charge: ten seconds later nothing is at work."""
    process = _started(tmp_path, 1000)
    for number in signals:
        os.kill(process.pid, number)
        time.sleep(0.3)
    process.communicate(timeout=1200)
    assert _group_ends(process.pid, 10)
    assert not list(tmp_path.glob("done-*"))
