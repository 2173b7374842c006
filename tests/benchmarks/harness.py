"""What benchmarks share: their options, units of work that survive a kill, and timing in alternated runs."""

import hashlib
import math
import pickle
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robosim.evaluation.evaluate import code_digest
from robosim.plans.files import find_plans, read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.support.figures import save_figure
from robosim.support.files import write_whole
from robosim.support.progress import unit_progress
from robosim.support.workers import Workers
from tests.benchmarks.results import DATA, Results

console = Console(markup=False, emoji=False)
STARTED = datetime.now()


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of every benchmark."""

    out: Path | None = None
    """Folder for the results; a new one under runs/ if not given. A run that was ended goes on in its folder."""
    publish: bool = False
    """Also write the results to docs/results/data, which the pages and the README take their numbers from."""
    seed: int = 0
    """Seed of places, tasks and noise."""
    workers: int = 1
    """Processes, or threads where a benchmark measures those."""

    def folder(self, name: str) -> Path:
        """The folder for the results of a benchmark."""
        return self.out or Path("runs") / f"{STARTED:%Y%m%d-%H%M%S}-{name}"

    def finish(self, name: str, results: Results) -> Results:
        """Print a benchmark's tables, and write its results as JSON and its figures."""
        for title, cells in results.tables().items():
            table = Table(title=title)
            for place, word in enumerate(cells[0]):
                table.add_column(Text(word), justify="right" if place else "left")
            for row in cells[1:]:
                table.add_row(*map(Text, row))
            console.print(table)
        folders = [self.folder(name), *([DATA] if self.publish else [])]
        for folder in folders:
            results.write(folder / f"{name}.json", command_of(sys.argv[1:]))
            console.print(f"Wrote {folder / name}.json")
        for figure_name, figure in results.figures.items():
            save_figure(figure, folders[0] / f"{figure_name}.png")
        return results


def command_of(words: Sequence[str]) -> str:
    """The command that measures, without options of its output, and with names of files instead of paths."""
    shown = [
        Path(word).name if Path(word).exists() else word
        for before, word in pairwise(["", *words])
        if before != "--out" and word not in ("--out", "--publish")
    ]
    return f"python -m tests.benchmarks {shlex.join(shown)}"


#: Options if none is given.
DEFAULT = Options()


def plans_of(words: Sequence[str]) -> list[FloorPlan]:
    """Floor plans of names, files and folders."""
    return [read_plan(path) for path in find_plans(words)]


def run_units(
    function: Callable[..., Any], units: Mapping[str, tuple[Any, ...]], out: Path, *, workers: int = 1
) -> dict[str, Any]:
    """Results of a function for each unit of work; those that a run before has left are read.

    Args:
        function: Called in a process of its own, if there are several.
        units: Arguments by name.
        out: Folder; results are in out/units, by name and a digest of the arguments and of the code.
        workers: Processes.

    Returns:
        Results by name, in the order of the units.
    """
    code = code_digest()
    files = {
        name: out / "units" / f"{name.replace('/', '-')}-{_digest(code, function.__name__, arguments)}.pickle"
        for name, arguments in units.items()
    }
    missing = [name for name, file in files.items() if not file.exists()]
    with (
        Workers(min(workers, len(missing) or 1), None, what="units") as pool,
        unit_progress(console, function.__name__, len(units), len(units) - len(missing)) as report,
    ):
        for number, result in pool.run(function, [units[name] for name in missing]):
            write_whole(files[missing[number]], pickle.dumps(result))
            report(missing[number])
    return {name: pickle.loads(file.read_bytes()) for name, file in files.items()}


def _digest(*parts: Any) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def alternate(
    actions: Mapping[str, Callable[[], Any]], *, turns: int, clock: Callable[[], float] = time.process_time
) -> dict[str, Float[np.ndarray, " turns"]]:
    """Seconds that actions take, in turns, so that other work of the machine disturbs all of them alike.

    Args:
        actions: By name; each is called once before it counts.
        turns: How often each is called.
        clock: Of the processor's time, or the wall's.
    """
    for action in actions.values():
        action()
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(turns):
        for name, action in actions.items():
            seconds[name].append(timed(action, clock)[0])
    return {name: np.array(own) for name, own in seconds.items()}


def timed(action: Callable[[], Any], clock: Callable[[], float] = time.process_time) -> tuple[float, Any]:
    """Seconds that an action takes, and what it returns."""
    begin = clock()
    found = action()
    return clock() - begin, found


def quartiles(values: Iterable[float]) -> tuple[float, tuple[float, float]]:
    """Median, and quartiles as a spread; NaN of nothing."""
    numbers = np.asarray(list(values), float)
    if not len(numbers):
        return math.nan, (math.nan, math.nan)
    low, middle, high = np.quantile(numbers, [0.25, 0.5, 0.75])
    return float(middle), (float(low), float(high))


def ratio_interval(
    parts: Float[np.ndarray, " n"], totals: Float[np.ndarray, " n"]
) -> tuple[float, tuple[float, float] | None]:
    """Ratio of two sums over homes, with its 95 % interval by bootstrap over homes; no interval of one home.

    Args:
        parts: Numerator of each home, such as its links that agree.
        totals: Denominator of each, such as its links.
    """
    parts, totals = np.asarray(parts, float), np.asarray(totals, float)
    if not totals.sum():
        return math.nan, None
    ratio = float(parts.sum() / totals.sum())
    if len(parts) < 2:
        return ratio, None
    drawn = np.random.default_rng(0).integers(len(parts), size=(2000, len(parts)))
    sums, of = parts[drawn].sum(axis=1), totals[drawn].sum(axis=1)
    low, high = np.quantile(sums[of > 0] / of[of > 0], (0.025, 0.975))
    return ratio, (float(low), float(high))


def figure_of(panels: int, *, size: tuple[float, float] = (5.5, 4.2)) -> tuple[Figure, list[Axes]]:
    """A figure with panels side by side, a light grid in each."""
    figure = Figure(figsize=(panels * size[0], size[1]), layout="constrained")
    axes = list(np.atleast_1d(figure.subplots(1, panels)))
    for one in axes:
        one.grid(True, which="both", lw=0.3)
    return figure, axes


def free_places(free: shapely.Geometry, count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 2"]:
    """Random places in free space, uniform over its area [m].

    Args:
        free: Polygons.
        count: Number of places.
        rng: Draws them.
    """
    low, high = np.array(free.bounds).reshape(2, 2)
    found = np.empty((0, 2))
    while len(found) < count:
        drawn = rng.uniform(low, high, (4 * count, 2))
        found = np.concatenate([found, drawn[shapely.contains_xy(free, drawn)]])
    return found[:count]
