"""The whole episode, speed against error: what each part of the simulation costs, and whether it may be left out.

The same searches are run as they are by default and with one thing changed at a time: camera, physics, mapper, radio,
outline of the walls. What a change costs or saves is decisions per second; what it spoils is the arrival time, in
steps relative to those of the default on the same task: their geometric mean, since any change makes some ways longer
and others shorter, with an interval of 95 % from drawing the tasks anew (bootstrap). Who never arrives counts with all
the steps allowed. Times are of the processor, those that the process spent working, so that what else the machine does
counts little; one episode at a time, each task in all settings in turn. Speed relative to the default's on the same
task is told beside rates. Each episode is kept, and a run that was stopped goes on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.table import Table

from robosim.building.building import BuildingConfig
from robosim.episode import EpisodeConfig
from robosim.evaluation.episode_file import Head, read_head
from robosim.evaluation.episodes import Job, make_jobs, run_job
from robosim.evaluation.evaluate import find_suite
from robosim.evaluation.manifest import code_digest, settings_of
from robosim.evaluation.scores import Estimate, bootstrap
from robosim.radio.link import RadioLinkConfig
from robosim.support.figures import save_figure
from robosim.support.files import write_json, write_whole
from robosim.support.parts import Part
from robosim.support.progress import tracked
from robosim.support.run_folder import run_folder
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch

#: The settings that all others are compared with.
DEFAULT = "default"
#: Stages of a decision that are told by name, with those that belong to them; the rest is told as one.
_STAGES = {
    "physics": ("physics",), "camera": ("camera",), "mapper": ("mapper",), "radio": ("radio", "link state"),
    "goal": ("goal",), "planner": ("planner",),
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One setting over all tasks."""

    setting: str
    episodes: int
    arrived: int
    decisions_per_s: float
    """Median over tasks, by CPU time."""
    relative_speed: float
    """Median over tasks of decisions per second divided by the default's."""
    steps: float
    """Mean."""
    relative_steps: Estimate
    """Geometric mean over tasks of steps divided by the default's."""
    stages_ms: dict[str, float]
    """CPU time of a decision by stage [ms]."""


def variations(base: EpisodeConfig) -> dict[str, EpisodeConfig]:
    """The default, and it with one thing changed at a time."""
    simulator = base.simulator
    found = {
        DEFAULT: base,
        "camera embree": replace(base, simulator=replace(simulator, camera="embree")),
        "physics kinematic": replace(base, simulator=replace(simulator, physics="kinematic")),
        "mapper classical": replace(base, mapper="classical"),
        "radio cached": replace(base, simulator=replace(simulator, radio=RadioLinkConfig(engine="cached"))),
    }
    for tolerance_m in (0.02, 0.05, 0.1):
        outline = BuildingConfig(tolerance_m=tolerance_m)
        found[f"outline {tolerance_m:.2f} m"] = replace(base, building=outline)
    return found


def run(
    plans: Sequence[str],
    *,
    goal: Part,
    targets: int,
    seed: int,
    max_steps: int,
    out: Path,
    console: Console,
) -> Table:
    """Run the episodes that are missing, write `episode.json` and `episode.png`, and return the table.

    Args:
        plans: Files of floor plans, folders of them, or names of shipped ones.
        goal: Who chooses the goals.
        targets: Tasks of each plan.
        seed: Seed of tasks and noise.
        max_steps: Actions before an episode is given up.
        out: Folder for the files, and to go on from.
        console: Where progress is shown.

    Raises:
        ValueError: If the folder holds episodes of other settings.
        MapError: If a task cannot be done in a building with straightened walls.
    """
    base = EpisodeConfig(goal=goal, max_steps=max_steps)
    suite = find_suite(plans, base, targets=targets, seed=seed, workers=1, console=console)
    variants = variations(base)
    jobs = {
        setting: make_jobs(suite, config, (goal,), 1, code_digest()) for setting, config in variants.items()
    }
    settings = settings_of(suite, base)
    with run_folder(out, "bench episode", {**settings, "goal": goal}, grows=("plans", "tasks")):
        found = _run_missing(jobs, out, console)
        rows = compare(
            {setting: [_told(head, max_steps) for head in heads] for setting, heads in found.items()}
        )
        asked = {"goal": goal, "targets": targets, "seed": seed, "max_steps": max_steps}
        write_json(out / "episode.json", {**asked, "rows": [_plain(row) for row in rows]})
        plot(out / "episode.png", rows)
    return table(rows)


def _folder(out: Path, setting: str) -> Path:
    return out / setting.replace(" ", "-")


def _run_missing(jobs: Mapping[str, Sequence[Job]], out: Path, console: Console) -> dict[str, list[Head]]:
    """Run what is not kept yet, task by task, and read all heads, by setting."""
    files = {setting: [job.file(_folder(out, setting)) for job in own] for setting, own in jobs.items()}
    for setting, own in jobs.items():
        if not all(file.is_file() for file in files[setting]):
            # What is compiled or read once, at the first use, is no part of a decision.
            run_job(replace(own[0], config=replace(own[0].config, max_steps=2)))
    turns = [(setting, i) for i in range(len(jobs[DEFAULT])) for setting in jobs]
    with tracked(turns, "episodes", console) as shown:
        for setting, i in shown:
            if not files[setting][i].is_file():
                write_whole(files[setting][i], run_job(jobs[setting][i], Stopwatch(process_time)))
    return {setting: [read_head(file) for file in own] for setting, own in files.items()}


def _told(head: Head, max_steps: int) -> dict[str, Any]:
    """What is compared of an episode."""
    steps = head.row["arrived_at_step"] if head.row["arrived"] else max_steps
    decisions = max(head.row["steps"], 1)
    own = {
        name: 1000 * sum(head.timing.get(stage, 0.0) for stage in stages) / decisions
        for name, stages in _STAGES.items()
    }
    all_ms = 1000 * sum(head.timing.get(stage, 0.0) for stage in LOOP_STAGES) / decisions
    return {
        "arrived": head.row["arrived"],
        "steps": steps,
        "all_ms": all_ms,
        "stages_ms": {**own, "rest": all_ms - sum(own.values())},
    }


def compare(found: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[Row]:
    """One row a setting.

    Args:
        found: By setting, of each task whether it `arrived`, its `steps`, its `all_ms` and `stages_ms` a decision.
    """
    usual, usual_ms = _steps(found[DEFAULT]), _ms(found[DEFAULT])
    rows = []
    for setting, episodes in found.items():
        names = episodes[0]["stages_ms"]
        rows.append(
            Row(
                setting=setting,
                episodes=len(episodes),
                arrived=sum(bool(e["arrived"]) for e in episodes),
                decisions_per_s=float(np.median(1000 / _ms(episodes))),
                relative_speed=float(np.median(usual_ms / _ms(episodes))),
                steps=float(_steps(episodes).mean()),
                relative_steps=_geometric_mean(_steps(episodes) / usual),
                stages_ms={n: float(np.median([e["stages_ms"][n] for e in episodes])) for n in names},
            )
        )
    return rows


def _geometric_mean(ratios: Float[np.ndarray, " n"]) -> Estimate:
    return Estimate(*np.exp(bootstrap(np.log(ratios)[:, None], None)).tolist())


def _steps(episodes: Sequence[Mapping[str, Any]]) -> Float[np.ndarray, " n"]:
    return np.maximum([float(e["steps"]) for e in episodes], 1.0)


def _ms(episodes: Sequence[Mapping[str, Any]]) -> Float[np.ndarray, " n"]:
    return np.array([float(e["all_ms"]) for e in episodes])


def table(rows: Sequence[Row]) -> Table:
    """One row a setting."""
    grid = Table(
        title="Episodes: speed against arrival time",
        caption="speed and steps relative to the default's; medians of CPU time a decision by stage [ms]",
    )
    grid.add_column("setting")
    for name in ("arrived", "decisions/CPU-s", "speed", "steps", "relative steps", *rows[0].stages_ms):
        grid.add_column(name, justify="right", no_wrap=name == "relative steps")
    for row in rows:
        value, low, high = row.relative_steps
        grid.add_row(
            row.setting,
            f"{row.arrived} of {row.episodes}",
            f"{row.decisions_per_s:.0f}",
            f"{row.relative_speed:.2f}",
            f"{row.steps:.0f}",
            "1" if row.setting == DEFAULT else f"{value:.2f} [{low:.2f}, {high:.2f}]",
            *(f"{ms:.1f}" for ms in row.stages_ms.values()),
        )
    return grid


def plot(path: Path, rows: Sequence[Row]) -> None:
    """Draw arrival times against decisions per second, both relative to the default's."""
    figure, axes = plt.subplots(figsize=(7.5, 4.6), layout="constrained")
    for row in rows:
        value, low, high = row.relative_steps
        spread = np.maximum([[value - low], [high - value]], 0)
        shape = "s" if row.setting == DEFAULT else "o"
        axes.errorbar(row.relative_speed, value, spread, fmt=shape, capsize=3, lw=1, label=row.setting)
    axes.axhline(1, color="0.6", lw=0.8, ls=":")
    axes.set(xlabel="decisions per CPU second / default's", ylabel="arrival time / default's")
    axes.set_title("Whiskers: 95 % intervals; right and low is good", fontsize=9)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    save_figure(figure, path)


def _plain(row: Row) -> dict[str, Any]:
    return {**vars(row), "relative_steps": row.relative_steps._asdict()}
