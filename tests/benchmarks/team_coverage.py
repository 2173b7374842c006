"""Teams that explore: floor that the robots have seen together over time, by their number and by what they exchange.

Robots start next to each other. The floor of a plan is that which the robots reach; overlap is the part of the
seen floor that several robots have seen when the team has seen `SHARE` of it, where it stops.
"""

from collections.abc import Sequence
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
_STYLES = {"perfect": "-", "radio": "--", "none": ":"}


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    sizes: tuple[int, ...] = (1, 2, 4, 8),
    exchanges: tuple[ExchangeName, ...] = ("perfect", "radio", "none"),
    max_steps: int = 6000,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Decisions until teams have seen 90 % of a floor over those of one robot, overlap, contacts; curves.

    Args:
        plans: Floor plans by file or name.
        sizes: Numbers of robots; one robot is always measured.
        exchanges: What the robots exchange.
        max_steps: Decisions before exploring is given up.
        options: Of every benchmark.
    """
    results = Results()
    units = {
        f"{path.stem} {size} {exchange}": (str(path), size, exchange, max_steps, options.seed)
        for path in find_plans(plans)
        for size in dict.fromkeys((1, *sizes))
        for exchange in (exchanges if size > 1 else ("none",))
    }
    curves = run_units(explore, units, options.folder("team_coverage"), workers=options.workers)
    for path in find_plans(plans):
        alone = curves[f"{path.stem} 1 none"]
        for name, (plan, size, exchange, *_) in units.items():
            if plan == str(path):
                row = "1 robot" if size == 1 else f"{size} robots, {exchange}"
                _add(results, path.stem, row, curves[name], alone)
        results.figures[f"team_coverage_{path.stem}"] = _figure(
            {
                (size, exchange): curves[name]
                for name, (plan, size, exchange, *_) in units.items()
                if plan == str(path)
            }
        )
    return options.finish("team_coverage", results)


def explore(plan: str, size: int, exchange: ExchangeName, max_steps: int, seed: int) -> dict[str, Any]:
    """Curves of coverage and overlap of a team that explores, its contacts and kilometres."""
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
        "overlap": log.overlap,
        "contacts": result.get("contacts_between_robots", 0),
        "km": result.get("path_length_all_m", result["path_length_m"]) / 1000,
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


def until(curve: dict[str, Any]) -> int | None:
    """Decisions until `SHARE` of the floor is seen; None if it is not."""
    seen = np.asarray(curve["coverage"]) >= SHARE
    return int(seen.argmax()) if seen.any() else None


def _add(results: Results, table: str, row: str, curve: dict[str, Any], alone: dict[str, Any]) -> None:
    steps, reference = until(curve), until(alone)
    results.add(table, row, "seen", 100 * curve["coverage"][-1], "%", digits=0)
    if steps is not None:
        results.add(table, row, "decisions", steps, digits=0)
        if reference:
            results.add(table, row, "over one robot", steps / reference, digits=2)
        if curve["overlap"]:
            results.add(table, row, "overlap", 100 * curve["overlap"][steps], "%", digits=0)
    if curve["overlap"]:
        results.add(table, row, "contacts", curve["contacts"], digits=0)
        results.add(table, row, "driven", curve["km"], "km", digits=2)


def _figure(curves: dict[tuple[int, str], dict[str, Any]]) -> Figure:
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    sizes = list(dict.fromkeys(size for size, _ in curves))
    for (size, exchange), curve in curves.items():
        colour, label = f"C{sizes.index(size)}", "1 robot" if size == 1 else f"{size} robots, {exchange}"
        style = "-" if size == 1 else _STYLES[exchange]
        axes.plot(100 * np.asarray(curve["coverage"]), style, color=colour, label=label)
    axes.axhline(100 * SHARE, color="0.8", zorder=0)
    reached = [steps for curve in curves.values() if (steps := until(curve)) is not None]
    if reached:
        axes.set_xlim(0, 1.5 * max(reached) + 1)
    axes.set(xlabel="decisions", ylabel="floor seen together [%]", ylim=(0, 100))
    axes.legend(loc="lower right", fontsize="small")
    return figure
