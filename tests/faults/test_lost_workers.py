"""A worker that is killed, as by a machine out of memory: a clear line, the rest saved, and the same in the end."""

import os
import random
import signal
import time

from tests.faults.commands import COMMANDS
from tests.faults.conftest import children, comes_to_the_same, end_of, no_crash, started


def test_one_is_killed(bench, name, moments, tmp_path):
    """At a random moment from when workers are there."""
    reference = bench.reference(name)
    statuses = []
    for k, moment in enumerate(moments(name, reference.seconds)):
        folder = tmp_path / str(k)
        folder.mkdir()
        rng = random.Random(moment)
        begin = time.monotonic()
        with started(bench.words(COMMANDS[name], folder)) as process:
            while not (there := children(process.pid)) and process.poll() is None:
                time.sleep(0.02)
            time.sleep(rng.uniform(0, max(0.0, reference.seconds - (time.monotonic() - begin))))
            there = children(process.pid) or there
            killed = False
            if there and process.poll() is None:
                try:
                    os.kill(rng.choice(there), signal.SIGKILL)
                    killed = True
                except ProcessLookupError:
                    pass
            ended = end_of(process, begin)
        no_crash(ended)
        assert ended.status in ((0, 1) if killed else (0,)), ended
        if ended.status:
            assert "a worker process was killed" in ended.complained, ended
            assert "give the same command again" in ended.complained, ended
        comes_to_the_same(bench, name, folder)
        statuses.append(ended.status)
    print(f"{name}, worker killed: {len(statuses)} moments, statuses {sorted(set(statuses))}")


test_one_is_killed.commands = lambda command: command.workers
test_one_is_killed.daily = ("dataset",)
