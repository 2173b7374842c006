"""Memory, descriptors and files that hundreds of episodes in a process, and visitors of a live page, leave.

Episodes of several kinds take turns, each in a generated building of its own; each is written to disk and read back.
Visitors of a page read all that it sends, some at once; whenever one leaves and another comes, the transmitter has
moved, and occasionally a search runs. A row for each tenth: resident memory after garbage collection and after glibc
returned what it holds free, open descriptors, threads, processes, and temporary files of this process and its children.
"""

import ctypes
import gc
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from tyro.conf import OmitArgPrefixes

from robosim.episode_config import EpisodeConfig
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.live.page import Page
from robosim.movers.movers import MoversConfig
from robosim.plans.files import read_plan
from robosim.recording.episode_file import EPISODE, read_episode
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from robosim.support.progress import tracked
from robosim.team.team_config import TeamConfig
from tests.benchmarks.harness import DEFAULT, Options, console
from tests.benchmarks.live import reader, wait
from tests.benchmarks.results import Results

#: Rows of a table.
PARTS = 10
#: Seed of the first building; no training uses it or those after it.
FIRST = 43_000_000
#: Of so many visits, one comes while a search of so many decisions runs; a move of the transmitter is followed within.
SEARCH_EVERY, DECISIONS, SETTLE_S = 50, 20, 60.0


class Kind(NamedTuple):
    """Episodes of a kind."""

    style: str
    config: EpisodeConfig


def kinds(steps: int) -> list[Kind]:
    """Episodes in turn: the default, with people, in offices and teams; some on a campus, some that explore."""
    usual = EpisodeConfig(max_steps=steps)
    light = SimulatorConfig(physics="kinematic", camera="plan")
    small = [
        Kind("home", usual),
        Kind("home", replace(usual, simulator=replace(light, movers=MoversConfig(people=5)), goal="snr")),
        Kind("office", replace(usual, simulator=light, goal="fused")),
        Kind("home", replace(usual, simulator=light, goal="fused", team=TeamConfig(robots="2"))),
    ]
    explore = Kind("home", replace(usual, simulator=light, goal="explore"))
    campus = Kind("campus", replace(usual, simulator=light))
    return [*small, explore, *small, campus, *small, explore, *small]


def main(
    *,
    episodes: int = 500,
    steps: int = 4000,
    visits: int = 1000,
    at_once: int = 10,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Leaks: memory, descriptors, threads, processes and files after hundreds of episodes and visitors.

    Two to three hours; what is known is written after each tenth of the episodes. Needs the extra `live`.

    Args:
        episodes: Episodes in this process.
        steps: Most decisions of an episode.
        visits: Visitors of the page.
        at_once: Visitors who read at the same time.
        options: Of every benchmark.
    """
    results, folder = Results(), options.folder("leaks")
    with temporary_files(folder / "tmp"):
        for _ in run_episodes(folder / "episodes", episodes, steps, options.seed, results):
            options.finish("leaks", results)
        if visits:
            receive(visits, at_once, options.seed, results)
    return options.finish("leaks", results)


def run_episodes(out: Path, episodes: int, steps: int, seed: int, results: Results) -> Iterator[None]:
    """Run episodes one after the other, add what remains after each tenth of them, and yield then."""
    turns, decisions = kinds(steps), 0
    with tracked(range(episodes), "episodes", console) as numbers:
        for number in numbers:
            style, config = turns[number % len(turns)]
            plan = generate_plan(FIRST + number, config=GeneratorConfig(style=style))
            folder = out / f"{number:03d}"
            record_episode(plan, replace(config, seed=seed + number), folder, video=False)
            decisions += sum(len(read_episode(file)) for file in folder.rglob(EPISODE))
            if (number + 1) * PARTS % episodes < PARTS:
                results.add("episodes", f"{number + 1:,}", "decisions", decisions, digits=0)
                add_remains("episodes", f"{number + 1:,}", results)
                yield


def receive(visits: int, at_once: int, seed: int, results: Results) -> None:
    """Open a page for visitors who come and go, and add what remains after each tenth of them."""
    rng, present = np.random.default_rng(seed), list[ExitStack]()
    with (
        Page("127.0.0.1", 0, "bench") as page,
        ExitStack() as everybody,
        tracked(range(visits), "visits", console) as numbers,
    ):
        radio = page.explore(read_plan("flat"))
        searches = page.search(EpisodeConfig(seed=seed, max_steps=DECISIONS))
        radio.settle(SETTLE_S)
        start = radio.places["transmitter"]
        for number in numbers:
            if len(present) == at_once:
                present.pop(int(rng.integers(at_once))).close()
            visitor = everybody.enter_context(ExitStack())
            visitor.enter_context(reader(page))
            present.append(visitor)
            radio.move("transmitter", start + rng.uniform(-0.5, 0.5, 2))
            radio.settle(SETTLE_S)
            if number % SEARCH_EVERY == 0:
                searches.start()
                wait(lambda: not any(search.is_alive for search in searches.searches))
            if (number + 1) * PARTS % visits < PARTS:
                add_remains("visitors", f"{number + 1:,}", results)
    add_remains("visitors", "page closed", results)


def add_remains(table: str, row: str, results: Results) -> None:
    """Add a row with what this process holds now."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    megabytes = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    results.add(table, row, "resident memory", megabytes, "MB", digits=0)
    for name, count in (
        ("descriptors", len(os.listdir("/proc/self/fd"))),
        ("threads", threading.active_count()),
        ("processes", len(children())),
        ("temporary files", sum(len(files) for _, _, files in os.walk(tempfile.gettempdir()))),
    ):
        results.add(table, row, name, count, digits=0)


def children() -> list[str]:
    """Numbers of the processes that this one has started and that have not ended."""
    return [
        child for file in Path("/proc/self/task").glob("*/children") for child in file.read_text().split()
    ]


@contextmanager
def temporary_files(folder: Path) -> Iterator[None]:
    """Put temporary files of this process and its children into a folder of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    place = str(folder.resolve())
    with patch.dict(os.environ, TMPDIR=place), patch.object(tempfile, "tempdir", place):
        yield
