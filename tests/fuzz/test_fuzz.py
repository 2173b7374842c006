"""A short run of the fuzzer over every reader, and that it would notice what it looks for."""

import os
import pickle
import random
import time
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from robosim.support.parts import imported
from robosim.support.reading import read_bytes
from tests.fuzz import worker
from tests.fuzz.mutations import damage
from tests.fuzz.run import cases_of, fuzz
from tests.fuzz.seeds import make_seeds
from tests.fuzz.targets import TARGETS, Target
from tests.fuzz.trees import CANARY, MARKER, dumped, with_canaries
from tests.fuzz.worker import Case, run_case

CASES = 300


@pytest.fixture(scope="module")
def seeds(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("seeds")
    make_seeds(folder)
    return folder


def test_damaged_files_are_read_or_rejected_in_one_line(seeds, tmp_path):
    """No traceback, no hang, no gigabyte, no code run, whatever the damage; and damage there is: most are rejected."""
    tally = fuzz(cases_of(CASES, 1, list(TARGETS), seeds), seeds, tmp_path, workers=1)
    assert not tally.failures, "\n".join(
        f"{case.target}:{case.number} {outcome.kind} ({outcome.method} {outcome.file})\n{outcome.message}"
        for case, outcome in tally.failures
    )
    rejected = sum(counts["rejected"] for counts in tally.counts.values())
    assert rejected > CASES // 3
    assert set(tally.counts) == {name for name in TARGETS if (seeds / TARGETS[name].seed).is_dir()}


@pytest.mark.parametrize(
    ("target", "name"),
    [
        ("ros map with materials", "map.yaml"),
        ("ros map with materials", "map-wall.yaml"),
        ("ros map in full", "map.yaml"),
        ("furnished building", "room.yaml"),
        ("building of storeys", "building.yaml"),
        ("configuration", "result.json"),
        ("robot", "robot.yaml"),
        ("robot", "robot.json"),
        ("layers of a wall", "wall.yaml"),
        ("suite", "suite.yaml"),
        ("suite", "suite.json"),
        ("settings", "settings.json"),
        ("collected searches", "data/metadata.json"),
        ("grid, house, array", "house.json"),
        ("data set", "manifest.json"),
    ],
)
def test_code_at_any_place_of_a_file_is_not_run(seeds, tmp_path, monkeypatch, target, name):
    """A value, then a key, at each place in turn names a function of a module that could be imported."""
    reads = replace(TARGETS[target], files=name)
    path = seeds / reads.seed / name
    if not path.is_file():
        pytest.skip("needs the extra that writes it")
    monkeypatch.chdir(tmp_path)
    texts = list(with_canaries(yaml.safe_load(path.read_text())))
    for number, tree in enumerate(texts):
        outcome = run_case(Case(target, number), reads, seeds, tmp_path / "work", dumped(tree))
        assert outcome.kind in ("read", "rejected"), (tree, outcome)
    assert texts


def test_the_same_seed_does_the_same_damage(seeds, tmp_path):
    """Or a failure could not be looked at again."""
    others = sorted(path for path in seeds.rglob("*") if path.is_file())
    for source in others:
        damaged = []
        for name in ("one", "two"):
            path = tmp_path / name / source.name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(source.read_bytes())
            rng = random.Random(5)
            rng.random()
            method = damage(path, others, rng)
            if path.is_file() and path.stat().st_size < 1e8 and source.suffix not in (".npz", ".pt"):
                # Archives store the time they were written.
                damaged.append((method, path.read_bytes()))
        assert len(set(damaged)) <= 1, source


def _traceback(folder, file):
    raise KeyError("pose")


def _library(folder, file):
    b"\x8c".decode()


def _nameless(folder, file):
    raise ValueError("ZSTD decompression failed")


def _wordy(folder, file):
    raise ValueError(f"{file}: damaged\nsecond line")


def _memory(folder, file):
    bytearray(1_200_000_000)[:] = b"x" * 1_200_000_000


def _slow(folder, file):
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass


def _chatty(folder, file):
    os.write(2, b"libpng warning: bad adaptive filter value\n")


def _credulous(folder, file):
    pickle.loads(b"cos\nsystem\n(S'touch " + MARKER.encode() + b"'\ntR.")


def _imports(folder, file):
    imported("reader", CANARY)


def _two_lines(folder, file):
    os.write(2, f"WARNING beware\nrobosim: {file}: damaged\n".encode())
    raise SystemExit(2)


def _status_1(folder, file):
    raise SystemExit(1)


def _good(folder, file):
    raise SystemExit(0)


def _rejects(folder, file):
    read_bytes(file, "a cake", most_bytes=1)


@pytest.mark.parametrize(
    ("call", "is_command", "kind"),
    [
        (_traceback, False, "traceback"), (_library, False, "traceback"), (_nameless, False, "unnamed"),
        (_wordy, False, "lines"), (_memory, False, "memory"), (_slow, False, "slow"), (_chatty, False, "said more"),
        (_credulous, False, "code run"), 
        (_imports, False, "code run"), (_traceback, True, "traceback"), (_two_lines, True, "lines"),
        (_status_1, True, "traceback"), (_good, True, "read"), (_rejects, False, "rejected"),
    ],
)  # fmt: skip
def test_each_failure_is_noticed(tmp_path, monkeypatch, call, is_command, kind):
    """What the fuzzer looks for, done on purpose."""
    monkeypatch.setattr(worker, "MOST_S", 0.2 if kind == "slow" else 300.0)
    monkeypatch.chdir(tmp_path)
    seeds = tmp_path / "seeds"
    (seeds / "cake").mkdir(parents=True)
    (seeds / "cake" / "cake.txt").write_text("two layers")
    target = Target("cake", "*", call, is_command=is_command)
    assert run_case(Case("cake", 1), target, seeds, tmp_path / "work").kind == kind
