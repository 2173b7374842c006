"""Teams that search: steps until the first robot arrives, over those of one robot on the same task.

Of campus floors two tasks each are searched, of homes the hard ones, by the steps of the oracle among all tasks of the
suite. Robots start next to each other, move without dynamics, and follow `fused`. Ratios are geometric means over
tasks; intervals draw floors and homes again. A search that is given up counts with all its steps. What a robot takes
that knows the target, the oracle, says how much is to be gained.

Memory is the peak of a process that searches the first of the tasks and nothing else; a robot more takes what a team
takes more than one robot, divided among its others. Decisions of a team are those of all its robots; their rate is
compared with that of one robot in as many steps of the same task, which the same process takes next: the first steps of
a search take longer than later ones.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.entrants import make_entrants
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.episodes import scene, task_of
from robosim.evaluation.search_scores import difficulty
from robosim.evaluation.suite import Suite, SuiteTask, read_suite
from robosim.simulator import SimulatorConfig
from robosim.team.team_config import ExchangeName, TeamConfig
from tests.benchmarks.harness import DEFAULT, Options, run_units
from tests.benchmarks.results import Results

#: Bars of steps over those of one robot, by the number of robots, on campus floors and in homes.
BARS = {"campus": {2: 0.70, 4: 0.50}, "homes": {2: 0.85, 4: 0.75}}
#: Bar of memory for each robot more [MB], and of decisions per CPU second over those of one robot.
MEMORY_MB, SPEED = 150, 0.9
#: Decisions in which a process loads all compiled loops.
_LOADED = 15


def main(
    campus: Positional[Path],
    homes: Positional[Path],
    *,
    sizes: tuple[int, ...] = (2, 4),
    tasks: tuple[int, ...] = (0, 1),
    hard_tasks: int | None = None,
    exchange: ExchangeName = "radio",
    max_steps: int = 4000,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Steps until the first robot of a team arrives over those of one robot, contacts, memory and speed.

    Args:
        campus: Suite of campus floors, as `large_buildings` makes it.
        homes: Suite of homes, as `robosim evaluate --suite-out` makes it.
        sizes: Numbers of robots.
        tasks: Numbers of the tasks of each campus floor; by default the first two.
        hard_tasks: Number of hard tasks of homes, in the order of the suite; all by default.
        exchange: What the robots exchange.
        max_steps: Decisions before a search is given up.
        options: Of every benchmark.
    """
    results = Results()
    out = options.folder("team_search")

    def arguments(suite: Suite, task: SuiteTask, size: int, goal: str = "fused") -> tuple[Any, ...]:
        plan = str(suite.plans[task.plan])
        return (plan, suite.reader, suite.seed, task, goal, size, exchange, max_steps)

    def searched(suite: Suite, chosen: list[SuiteTask], size: int, goal: str = "fused") -> dict[str, Any]:
        units = {
            f"{task.plan} {task.number} {goal} {size}": arguments(suite, task, size, goal) for task in chosen
        }
        return run_units(search_timed, units, out, workers=options.workers)

    def peak_mb(suite: Suite, task: SuiteTask, size: int) -> float:
        """A unit alone has a process of its own."""
        name = f"{task.plan} {task.number} memory {size}"
        return float(run_units(peak_of, {name: arguments(suite, task, size)}, out)[name])

    suite = read_suite(campus)
    chosen = [task for task in suite.tasks if task.number in tasks]
    oracle = searched(suite, chosen, 1, "oracle")
    _compare(results, "campus", chosen, sizes, oracle.values(), lambda size: searched(suite, chosen, size))
    _add_memory(results, "campus", sizes, lambda size: peak_mb(suite, chosen[0], size))
    suite = read_suite(homes)
    oracle = searched(suite, list(suite.tasks), 1, "oracle")
    known = {(t.plan, t.number): run for t, run in zip(suite.tasks, oracle.values(), strict=True)}
    classes = difficulty({key: run["steps"] for key, run in known.items()})
    hard = [task for task in suite.tasks if classes[task.plan, task.number] == "hard"][:hard_tasks]
    of_hard = [known[task.plan, task.number] for task in hard]
    _compare(results, "homes", hard, sizes, of_hard, lambda size: searched(suite, hard, size))
    _add_memory(results, "homes", sizes, lambda size: peak_mb(suite, hard[0], size))
    return options.finish("team_search", results)


def search(
    plan: str,
    reader: str,
    seed: int,
    task: SuiteTask,
    goal: str,
    size: int,
    exchange: ExchangeName,
    max_steps: int,
) -> dict[str, Any]:
    """Steps, arrival, contacts, metres, CPU seconds and trajectories of a team."""
    config = EpisodeConfig(
        goal=goal,
        max_steps=max_steps,
        seed=task.seed(seed, 0),
        simulator=SimulatorConfig(physics="kinematic"),
        team=TeamConfig(robots=str(size), exchange=exchange),
    )
    hull_m = config.simulator.robot.hull_m
    building, places = scene(Path(plan), reader, config.building, hull_m)
    entrants = make_entrants(building, places, task_of(places, task), config)
    begin = time.process_time()
    team = run_team(building, entrants)
    seconds = time.process_time() - begin
    logs, result = team.robots.values(), team.result()
    return {
        "steps": team.first.steps,
        "arrived": result["arrived"],
        "contacts": result.get("contacts_between_robots", 0),
        "collisions": result["collisions"],
        "km": sum(log.path_length_m for log in logs) / 1000,
        "decisions": sum(log.steps for log in logs),
        "cpu_s": seconds,
        "poses": {name: np.array(log.poses, np.float32) for name, log in team.robots.items()},
    }


def search_timed(*arguments: Any) -> dict[str, Any]:
    """A search; after that of a team also `alone`, one robot in as many steps."""
    *task, size, exchange, _ = arguments
    if size > 1:
        search(*task, size, exchange, _LOADED)
    run = search(*arguments)
    return run if size == 1 else {**run, "alone": search(*task, 1, exchange, run["steps"])}


def peak_of(*arguments: Any) -> float:
    """Peak of the resident memory of this process after a search [MB]."""
    search(*arguments)
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6


def _compare(
    results: Results,
    table: str,
    tasks: list[SuiteTask],
    sizes: tuple[int, ...],
    oracle: Iterable[Any],
    searched: Callable[[int], Mapping[str, Any]],
) -> None:
    """Add rows of one robot, of one that knows the target, and of teams."""
    alone, plans = list(searched(1).values()), [task.plan for task in tasks]
    alone_steps = _column(alone, "steps")
    results.add_ratio(table, "oracle", "steps over one", _column(list(oracle), "steps") / alone_steps, plans)
    for size in (1, *sizes):
        runs = alone if size == 1 else list(searched(size).values())
        row = f"{size} robots" if size > 1 else "1 robot"
        if size > 1:
            ratios = _column(runs, "steps") / alone_steps
            results.add_ratio(table, row, "steps over one", ratios, plans, BARS[table].get(size))
        km = _column(runs, "km").sum()
        results.add(table, row, "arrived", 100 * _column(runs, "arrived").mean(), "%", digits=0, bar=100)
        results.add(table, row, "driven", km, "km", digits=2)
        results.add(
            table, row, "contacts with walls per km", _column(runs, "collisions").sum() / km, digits=1
        )
        if size > 1:
            contacts = _column(runs, "contacts").sum()
            results.add(table, row, "contacts between robots", contacts, digits=0)
            speed = _speed(runs) / _speed([run["alone"] for run in runs])
            results.add(table, row, "decisions per CPU second over one", speed, digits=2, bar=SPEED)


def _add_memory(
    results: Results, table: str, sizes: tuple[int, ...], peak_mb: Callable[[int], float]
) -> None:
    """Add what each robot more takes."""
    alone_mb = peak_mb(1)
    for size in sizes:
        more_mb = (peak_mb(size) - alone_mb) / (size - 1)
        row = f"{size} robots"
        results.add(table, row, "memory of a robot more", more_mb, "MB", digits=0, bar=MEMORY_MB)


def _column(runs: list[Any], name: str) -> Float[np.ndarray, " n"]:
    return np.array([run[name] for run in runs], float)


def _speed(runs: list[Any]) -> float:
    """Decisions of all robots per CPU second."""
    return float(_column(runs, "decisions").sum() / _column(runs, "cpu_s").sum())
