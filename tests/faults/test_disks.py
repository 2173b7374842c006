"""Disks that are full, files that may not grow, folders that become unwritable: a clear line, no half work."""

import os
import random
import resource
import subprocess
import time
from functools import partial
from pathlib import Path

import pytest

from tests.faults.commands import COMMANDS
from tests.faults.conftest import comes_to_the_same, end_of, no_crash, run, started


@pytest.fixture
def disk(tmp_path: Path):
    """Makes a small disk, of so many bytes."""
    mounted = []

    def make(size: int) -> Path:
        folder = tmp_path / f"disk-{len(mounted)}"
        folder.mkdir()
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            pytest.skip(f"needs to mount a small disk: {done.stderr.strip()}")
        mounted.append(folder)
        return folder

    yield make
    for folder in mounted:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def _fails_clearly(ended, folder: Path) -> None:
    no_crash(ended)
    assert ended.status in (1, 2), ended
    lines = ended.complained.strip().splitlines()
    assert sum(line.startswith("robosim: ") for line in lines) == 1, ended.complained
    assert not list(folder.rglob(".*partial*"))


def _size(bench, name: str) -> int:
    return sum(path.stat().st_size for path in bench.out(name).rglob("*") if path.is_file())


def test_a_full_disk(bench, name, moments, disk, tmp_path):
    """Disks that hold a random part of what the command writes."""
    statuses = []
    for share in moments(name, 0.9):
        size = 4096 * max(1, int(share * _size(bench, name) / 4096))
        folder = disk(size)
        ended = run(bench.words(COMMANDS[name], folder))
        if ended.status:
            _fails_clearly(ended, folder)
        statuses.append(ended.status)
    print(f"{name}, full disk: {len(statuses)} sizes, statuses {sorted(set(statuses))}")


test_a_full_disk.commands = lambda command: not command.needs
test_a_full_disk.daily = ("episode", "dataset")


def test_files_that_may_not_grow(bench, name, moments, tmp_path):
    """A limit on the size of files (RLIMIT_FSIZE), as quotas work; then the same command without it."""
    largest = max(path.stat().st_size for path in bench.out(name).rglob("*") if path.is_file())
    statuses = []
    for k, share in enumerate(moments(name, 0.9)):
        folder = tmp_path / str(k)
        folder.mkdir()
        words = bench.words(COMMANDS[name], folder)
        limits = (max(1, int(share * largest)),) * 2
        ended = run(words, preexec_fn=partial(resource.setrlimit, resource.RLIMIT_FSIZE, limits))
        if ended.status:
            _fails_clearly(ended, folder)
        comes_to_the_same(bench, name, folder)
        statuses.append(ended.status)
    print(f"{name}, RLIMIT_FSIZE: {len(statuses)} limits, statuses {sorted(set(statuses))}")


test_files_that_may_not_grow.daily = ("replay",)


def test_a_folder_that_becomes_unwritable(bench, name, moments, disk):
    """Its disk is made read-only in the middle."""
    reference = bench.reference(name)
    statuses = []
    for moment in moments(name, reference.seconds):
        folder = disk(200_000_000)
        words, begin = bench.words(COMMANDS[name], folder), time.monotonic()
        with started(words) as process:
            time.sleep(moment)
            while process.poll() is None:
                done = subprocess.run(["mount", "-o", "remount,ro", str(folder)], capture_output=True)
                if done.returncode == 0:
                    break
                time.sleep(0.005 * random.random())  # a file is being written
            ended = end_of(process, begin)
        no_crash(ended)
        assert ended.status in (0, 1, 2), ended
        if ended.status:
            assert "robosim: " in ended.complained
            assert os.access(folder, os.R_OK)
        statuses.append(ended.status)
    print(f"{name}, read-only: {len(statuses)} moments, statuses {sorted(set(statuses))}")


test_a_folder_that_becomes_unwritable.daily = ("trace",)
