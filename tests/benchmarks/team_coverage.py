"""Teams that explore: floor that the robots have seen together over time, by their number and by what they exchange.

Robots start next to each other, at random places of each plan. The floor of a plan is that which the robots reach. A
team stops when it has seen `SHARE` of it; one that does not counts with all its decisions. Overlap is the part of the
seen floor that several robots have seen by then. Ratios are geometric means over starts; intervals draw plans again.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from signal import SIGTERM, raise_signal
from typing import Any
from unittest.mock import patch

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.entrants import make_entrants
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.plans.files import find_plans, read_plan
from robosim.simulator import SimulatorConfig
from robosim.step import Step
from robosim.task.coverage import Coverage
from robosim.task.tasks import make_task
from robosim.team.team_config import ExchangeName, TeamConfig
from robosim.team.team_log import TeamLog
from tests.benchmarks.harness import DEFAULT, Options, run_units
from tests.benchmarks.results import Results

#: Part of the floor at which teams are compared.
SHARE = 0.9
#: Bars of decisions over those of one robot, by the number of robots, and of overlap over that without exchange.
BARS, OVERLAP = {2: 0.58, 4: 0.36}, 0.5
_STYLES = {"perfect": "-", "radio": "--", "none": ":"}


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    sizes: tuple[int, ...] = (2, 4, 8),
    exchanges: tuple[ExchangeName, ...] = ("perfect", "radio", "none"),
    starts: int = 1,
    max_steps: int = 6000,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Decisions until teams have seen 90 % of a floor over those of one robot, overlap, contacts; curves.

    Args:
        plans: Floor plans by file or name; those in a folder have a table in common.
        sizes: Numbers of robots besides one.
        exchanges: What the robots exchange.
        starts: Number of starts in each plan.
        max_steps: Decisions before exploring is given up.
        options: Of every benchmark.
    """
    results, out = Results(), options.folder("team_coverage")
    teams = [(1, exchanges[0]), *product(sizes, exchanges)]
    for given in plans:
        cases = list(product(map(str, find_plans((given,))), range(options.seed, options.seed + starts)))
        units = {
            f"{Path(plan).stem} {seed} {size} {exchange}": (plan, size, exchange, max_steps, seed)
            for (size, exchange), (plan, seed) in product(teams, cases)
        }
        done = list(run_units(explore, units, out, workers=options.workers).values())
        curves = {team: done[i * len(cases) : (i + 1) * len(cases)] for i, team in enumerate(teams)}
        table = Path(given).stem
        _add_rows(results, table, curves, [plan for plan, _ in cases])
        results.figures[f"team_coverage_{table}"] = _figure(curves)
    return options.finish("team_coverage", results)


def explore(plan: str, size: int, exchange: ExchangeName, max_steps: int, seed: int) -> dict[str, Any]:
    """Coverage over time of robots that explore; of a team also overlap and contacts at the end, and kilometres."""
    building = make_building(read_plan(plan))
    config = EpisodeConfig(
        goal="explore",
        max_steps=max_steps,
        seed=seed,
        simulator=SimulatorConfig(physics="kinematic"),
        team=TeamConfig(robots=str(size), exchange=exchange),
    )
    places = reach(building, *config.simulator.robot.hull_m)
    task = make_task(places, np.random.default_rng(seed))
    with patch.object(TeamLog, "add_seen", _add_seen):
        log = run_team(building, make_entrants(building, places, task, config), _on_step)
    result = log.result()
    return {
        "coverage": log.coverage or log.first.coverage,
        "overlap": result.get("overlap", 0.0),
        "contacts": result.get("contacts_between_robots", 0),
        "km": result.get("path_length_all_m", 0.0) / 1000,
    }


_add_to_log = TeamLog.add_seen


def _add_seen(log: TeamLog, coverages: Sequence[Coverage]) -> None:
    """Add what a team has seen, and end its episode if that is enough."""
    _add_to_log(log, coverages)
    if log.coverage[-1] >= SHARE:
        raise_signal(SIGTERM)


def _on_step(log: EpisodeLog, step: Step) -> None:
    """End the episode of a robot that has seen enough."""
    if log.coverage[-1] >= SHARE:
        raise_signal(SIGTERM)


def _add_rows(
    results: Results,
    table: str,
    curves: Mapping[tuple[int, ExchangeName], list[dict[str, Any]]],
    plans: list[str],
) -> None:
    """Add a row of each team."""
    alone = decisions(next(iter(curves.values())))
    overlap = {team: np.mean([curve["overlap"] for curve in cases]) for team, cases in curves.items()}
    for (size, exchange), cases in curves.items():
        row = f"{size} robots, {exchange}" if size > 1 else "1 robot"
        took, reached = decisions(cases), np.mean([curve["coverage"][-1] >= SHARE for curve in cases])
        results.add(table, row, f"saw {SHARE:.0%}", 100 * reached, "% of starts", digits=0, cases=len(cases))
        results.add(table, row, "decisions", took.mean(), digits=0)
        if size == 1:
            continue
        bar = BARS.get(size) if exchange != "none" else None
        results.add_ratio(table, row, "over one", took / alone, plans, bar)
        results.add(table, row, "overlap", 100 * overlap[size, exchange], "%", digits=0)
        if exchange != "none" and overlap.get((size, "none")):
            ratio = overlap[size, exchange] / overlap[size, "none"]
            results.add(table, row, "overlap over none", ratio, digits=2, bar=OVERLAP)
        results.add(table, row, "driven", sum(curve["km"] for curve in cases), "km", digits=2)
        results.add(table, row, "contacts", sum(curve["contacts"] for curve in cases), digits=0)


def decisions(curves: list[dict[str, Any]]) -> np.ndarray:
    """Decisions that each start took."""
    return np.array([len(curve["coverage"]) - 1.0 for curve in curves])


def _figure(curves: Mapping[tuple[int, ExchangeName], list[dict[str, Any]]]) -> Figure:
    """Mean coverage over time, where one robot needs 1 for each start."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    alone, time = decisions(next(iter(curves.values()))), np.linspace(0, 1, 201)
    sizes = list(dict.fromkeys(size for size, _ in curves))
    for (size, exchange), cases in curves.items():
        seen = [
            np.interp(time * steps, np.arange(len(curve["coverage"])), curve["coverage"])
            for steps, curve in zip(alone, cases, strict=True)
        ]
        label = "1 robot" if size == 1 else f"{size} robots, {exchange}"
        style = "-" if size == 1 else _STYLES[exchange]
        axes.plot(time, 100 * np.mean(seen, axis=0), style, color=f"C{sizes.index(size)}", label=label)
    axes.axhline(100 * SHARE, color="0.8", zorder=0)
    axes.set(xlabel="decisions over those of one robot", ylabel="floor seen together [%]", ylim=(0, 100))
    axes.legend(loc="lower right", fontsize="small")
    return figure
