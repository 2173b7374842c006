"""Whole searches, speed against arrival time, with one part of the simulation changed at a time.

The same searches run as they are by default and with another camera, physics, mapper, radio or outline of the walls, or
among people. Speed is decisions per second of processor time, one episode at a time, each task in all settings in turn.
Arrival time is in steps relative to those of the default on the same task: the geometric mean, with a 95 % interval by
bootstrap over tasks. A robot that never arrives counts with all the steps allowed.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any, Literal

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import BuildingConfig
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.episodes import Job, make_jobs, read_job_head, run_job
from robosim.evaluation.evaluate import find_suite
from robosim.evaluation.search_scores import bootstrap
from robosim.movers.movers import MoversConfig
from robosim.radio.link import RadioLinkConfig
from robosim.support.stopwatch import LOOP_STAGES, Stopwatch
from tests.benchmarks.harness import DEFAULT, Options, console, quartiles, run_units
from tests.benchmarks.results import Results

#: The setting that all others are compared with.
USUAL = "default"
#: Stages of a decision that are reported by name, with those that belong to them; the rest is one.
STAGES = {
    "physics": ("physics",), "camera": ("camera",), "mapper": ("mapper",), "radio": ("radio", "link state"),
    "goal": ("goal",), "planner": ("planner",),
}  # fmt: skip


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    goal: Literal["oracle", "visual", "snr", "los", "los-or-first", "fused"] = "fused",
    targets: int = 3,
    max_steps: int = 1000,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Whole searches: decisions per second against arrival time, with one part changed at a time.

    Goes on after a kill if it is given the same folder.

    Args:
        plans: Floor plans, or folders of them.
        goal: Goal policy.
        targets: Tasks of each plan.
        max_steps: Decisions before giving up.
        options: Of every benchmark.
    """
    base = EpisodeConfig(goal=goal, max_steps=max_steps)
    suite = find_suite(plans, base, targets=targets, seed=options.seed, workers=1, console=console)
    jobs = {
        setting: make_jobs(suite, config, (goal,), 1, setting) for setting, config in variations(base).items()
    }
    for first, *_ in jobs.values():  # what is compiled or read at first use is no part of a decision
        run_job(replace(first, config=replace(first.config, max_steps=2)))
    turns = [(setting, number) for number in range(len(jobs[USUAL])) for setting in jobs]
    units = {
        f"{jobs[setting][number].name}, {setting}": (jobs[setting][number],) for setting, number in turns
    }
    found = dict(zip(turns, run_units(search, units, options.folder("episode")).values(), strict=True))
    by_setting = {setting: [row for (own, _), row in found.items() if own == setting] for setting in jobs}
    return options.finish("episode", compare(by_setting))


def variations(base: EpisodeConfig) -> dict[str, EpisodeConfig]:
    """The default, and it with one thing changed at a time."""
    simulator = base.simulator
    found = {
        USUAL: base,
        "Embree's camera": replace(base, simulator=replace(simulator, camera="embree")),
        "kinematic physics": replace(base, simulator=replace(simulator, physics="kinematic")),
        "classical mapper": replace(base, mapper="classical"),
        "cached radio": replace(base, simulator=replace(simulator, radio=RadioLinkConfig(engine="cached"))),
    }
    for people in (5, 10):
        found[f"{people} people"] = replace(
            base, simulator=replace(simulator, movers=MoversConfig(people=people))
        )
    for tolerance_m in (0.02, 0.05, 0.1):
        outline = BuildingConfig(tolerance_m=tolerance_m)
        found[f"outline of {tolerance_m:.2f} m"] = replace(base, building=outline)
    return found


def search(job: Job) -> dict[str, Any]:
    """Whether a search arrived, its steps, and processor time of a decision in all and by stage [ms]."""
    with tempfile.TemporaryDirectory() as folder:
        path = job.file(Path(folder))
        path.parent.mkdir(parents=True)
        path.write_bytes(run_job(job, Stopwatch(process_time)))
        head = read_job_head(path)
    decisions = max(head.row["steps"], 1)
    stages = {
        name: 1000 * sum(head.timing.get(stage, 0.0) for stage in parts) / decisions
        for name, parts in STAGES.items()
    }
    whole = 1000 * sum(head.timing.get(stage, 0.0) for stage in LOOP_STAGES) / decisions
    return {
        "arrived": head.row["arrived"],
        "steps": head.row["arrived_at_step"] if head.row["arrived"] else job.config.max_steps,
        "ms": whole,
        "stages": {**stages, "rest": whole - sum(stages.values())},
    }


def compare(found: Mapping[str, Sequence[Mapping[str, Any]]]) -> Results:
    """Each setting against the default.

    Args:
        found: By setting, of each task what `search` returns.
    """
    results = Results()
    usual_ms, usual_steps = (_column(found[USUAL], key) for key in ("ms", "steps"))
    for setting, searches in found.items():
        ms, steps, cases = _column(searches, "ms"), _column(searches, "steps"), len(searches)
        arrived = 100 * np.mean([bool(one["arrived"]) for one in searches])
        results.add("searches", setting, "arrived", arrived, "%", digits=0, cases=cases)
        middle, spread = quartiles(1000 / ms)
        results.add(
            "searches", setting, "decisions a CPU second", middle, digits=0, spread=spread, cases=cases
        )
        results.add("searches", setting, "relative speed", np.median(usual_ms / ms), digits=2)
        value, low, high = np.exp(bootstrap(np.log(steps / usual_steps)[:, None], None))
        results.add("searches", setting, "relative steps", value, digits=2, spread=(low, high), cases=cases)
        for stage in searches[0]["stages"]:
            own = np.median([one["stages"][stage] for one in searches])
            results.add("stages", setting, stage, own, "ms", digits=1)
    return results


def _column(searches: Sequence[Mapping[str, Any]], key: str) -> np.ndarray:
    return np.maximum([float(one[key]) for one in searches], 1e-9)
