"""How long it takes to start: all loops compiled from an empty cache, later starts, imports and help."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tyro.conf import OmitArgPrefixes

from tests.benchmarks.harness import DEFAULT, Options, quartiles
from tests.benchmarks.results import Results

EPISODE = (
    "-m",
    "robosim",
    "episode",
    "office",
    "--goal",
    "fused",
    "--seed",
    "2",
    "--max-steps",
    "1",
    "--out",
)


def main(*, turns: int = 5, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Cold start, later starts, import and help, by the clock and by processor time.

    Args:
        turns: How often later starts are timed; the cold one once.
        options: Of every benchmark.
    """
    results = Results()
    with tempfile.TemporaryDirectory() as folder:
        cache = {**os.environ, "XDG_CACHE_HOME": folder}
        cache.pop("NUMBA_CACHE_DIR", None)

        def add(row: str, words: tuple[str, ...], count: int) -> None:
            clock, processor = zip(*(_timed(words, cache) for _ in range(count)), strict=True)
            for name, seconds in (("by the clock", clock), ("processor time", processor)):
                middle, spread = quartiles(seconds)
                results.add("starts", row, name, middle, "s", digits=1, spread=spread if count > 1 else None)

        add("warm-up, nothing compiled", ("-m", "robosim", "warm-up", "--episode"), 1)
        add("later start, one decision, all files written", (*EPISODE, str(Path(folder) / "out")), turns)
        add("import robosim", ("-c", "import robosim"), turns)
        add("robosim --help", ("-m", "robosim", "--help"), turns)
    return options.finish("start", results)


def _timed(words: tuple[str, ...], environment: dict[str, str]) -> tuple[float, float]:
    """Seconds that a Python takes by the clock, and of all its processes' time."""
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True)
    clock, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
