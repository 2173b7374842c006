"""Signals at random moments: no crash, nobody left at work, no half file that stays, the same bytes in the end."""

import os
import signal
import time
from contextlib import suppress

import pytest

from tests.faults.commands import COMMANDS, contents
from tests.faults.conftest import comes_to_the_same, end_of, no_crash, started

STATUS = {
    signal.SIGINT: (0, 130),
    signal.SIGTERM: (0, 143, -signal.SIGTERM),
    signal.SIGKILL: (0, -signal.SIGKILL),
}


@pytest.mark.parametrize("number", STATUS, ids=lambda number: number.name)
def test_at_any_moment(bench, name, number, moments, tmp_path, record_property):
    """SIGINT to all processes, as from a terminal; SIGTERM and SIGKILL to the one in charge, as from a scheduler."""
    reference = bench.reference(name)
    ended_by = []
    for k, moment in enumerate(moments(name, reference.seconds)):
        folder = tmp_path / str(k)
        folder.mkdir()
        words, begin = bench.words(COMMANDS[name], folder), time.monotonic()
        with started(words) as process:
            time.sleep(moment)
            with suppress(ProcessLookupError):
                (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
            ended = end_of(process, begin)
        no_crash(ended)
        assert ended.status in STATUS[number], (moment, ended)
        if ended.status != 0 and number != signal.SIGKILL:
            assert not list(folder.rglob(".*partial*"))
            there = contents(folder / "out", COMMANDS[name]) if (folder / "out").exists() else {}
            if "result.json" in there and name == "episode":
                assert set(COMMANDS[name].keeps) <= set(there)
        comes_to_the_same(bench, name, folder)
        ended_by.append(ended.status)
    record_property("statuses", ended_by)
    print(f"{name}, {number.name}: {len(ended_by)} moments, statuses {sorted(set(ended_by))}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_an_episode_keeps_what_was_done(bench, number, tmp_path):
    """In the middle of an episode: all its files, of the decisions until then, and they can be replayed."""
    words = bench.words(COMMANDS["episode"], tmp_path)
    words[words.index("--max-steps") + 1] = "100000"
    words = [word for word in words if word != "explore"]
    words.insert(words.index("--goal") + 1, "visual")
    begin = time.monotonic()
    with started(words) as process:
        while not (tmp_path / "out").exists() or not list((tmp_path / "out").glob(".episode.partial*")):
            assert process.poll() is None, process.communicate()
            time.sleep(0.05)
        time.sleep(3)
        os.kill(process.pid, number)
        ended = end_of(process, begin)
    no_crash(ended)
    if ended.status != 0:  # else it had arrived by then
        assert ended.status == 128 + number
        assert "Stopping after this step" in ended.complained
    assert set(COMMANDS["episode"].keeps) <= {path.name for path in (tmp_path / "out").iterdir()}
