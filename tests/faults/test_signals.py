"""Signals at random moments: no crash, no worker left, no half file that stays, the same bytes in the end."""

import json
import os
import signal
import time
from contextlib import suppress

import av
import pytest

from tests.faults.commands import COMMANDS, contents
from tests.faults.conftest import before_us, comes_to_the_same, end_of, no_crash, started

#: A process that ended itself by SIGINT, as Python does where the signal met code that it makes from text, has 130 to
#: a shell.
STATUS = {
    signal.SIGINT: (0, 130, -signal.SIGINT),
    signal.SIGTERM: (0, 143, -signal.SIGTERM),
    signal.SIGKILL: (0, -signal.SIGKILL),
}


def _at_any_moment(bench, name, number, moments, tmp_path):
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
        assert ended.status in STATUS[number] or before_us(ended), (moment, ended)
        if ended.status != 0 and number != signal.SIGKILL:
            assert not list(folder.rglob(".*partial*"))
            there = contents(folder / "out", COMMANDS[name]) if (folder / "out").exists() else {}
            if "result.json" in there and name == "episode":
                assert set(COMMANDS[name].keeps) <= set(there)
        comes_to_the_same(bench, name, folder)
        ended_by.append(ended.status)
    print(f"{name}, {number.name}: {len(ended_by)} moments, statuses {sorted(set(ended_by))}")


def test_ctrl_c_at_any_moment(bench, name, moments, tmp_path):
    """SIGINT to all processes, as from a terminal."""
    _at_any_moment(bench, name, signal.SIGINT, moments, tmp_path)


def test_sigterm_at_any_moment(bench, name, moments, tmp_path):
    """SIGTERM to the one in charge, as from a scheduler."""
    _at_any_moment(bench, name, signal.SIGTERM, moments, tmp_path)


def test_sigkill_at_any_moment(bench, name, moments, tmp_path):
    """SIGKILL of the one in charge."""
    _at_any_moment(bench, name, signal.SIGKILL, moments, tmp_path)


test_ctrl_c_at_any_moment.daily = ("replay", "dataset", "train mapper")
test_sigterm_at_any_moment.daily = ("collect",)
test_sigkill_at_any_moment.daily = ("episode", "trace")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_an_episode_keeps_what_was_done(bench, number, tmp_path):
    """In the middle of an episode: all its files contain the decisions until then, and the video plays."""
    words = bench.words(COMMANDS["episode"], tmp_path)
    words[1], words[words.index("--max-steps") + 1] = "office", "100000"
    begin = time.monotonic()
    with started(words) as process:
        # The film has its first frames: some decisions are made.
        while not any(film.stat().st_size for film in tmp_path.glob("out/.episode.partial*")):
            assert process.poll() is None, process.communicate()
            time.sleep(0.05)
        os.kill(process.pid, number)
        ended = end_of(process, begin)
    no_crash(ended)
    assert ended.status == 128 + number
    assert "Stopping after this step" in ended.complained
    assert set(COMMANDS["episode"].keeps) <= {path.name for path in (tmp_path / "out").iterdir()}
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    assert stored["ended"] == {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}[number]
    assert stored["steps"] > 0
    assert len((tmp_path / "out" / "trajectory.tum").read_text().splitlines()) == stored["steps"] + 1
    with av.open(str(tmp_path / "out" / "episode.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) >= stored["steps"]
