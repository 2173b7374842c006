"""A whole evaluation: the suite, its episodes, their scores, and the files of results.

The folder holds `suite.yaml` (the tasks), `settings.json`, `episodes/`, and from these `episodes.parquet` (one row per
episode), `timing.parquet` (seconds by stage; all else is the same for the same seed), `summary.json`, `report.html` and
its pictures.

Episodes depend on the plans, the tasks and the configuration. A run that differs in any of these from the folder is
rejected (`robosim.support.run_folder`); a run that adds policies, repetitions, tasks or plans resumes. Code and
versions of packages are stored with each episode: a mixture is reported, not rejected, since most changes of code
change no result.
"""

import hashlib
import importlib.metadata
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from robosim.agent import check_weights
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.episodes import draw_plan, make_jobs, read_job_head, run_jobs
from robosim.evaluation.report import Evaluation, summary_rows, write_results
from robosim.evaluation.search_scores import Summary, score, summarise
from robosim.evaluation.suite import Suite, is_suite, name_plans, read_suite, write_suite
from robosim.parts import GOAL
from robosim.plans.files import find_plans, read_plan
from robosim.policies.goals import SEEKERS
from robosim.support.files import plain
from robosim.support.installation import assets_dir, package_version
from robosim.support.parts import to_dict
from robosim.support.progress import unit_progress
from robosim.support.reading import PACKAGES, read_bytes
from robosim.support.run_folder import run_folder
from robosim.support.workers import Workers

#: Packages whose versions results depend on.
_PACKAGES = (
    "robosim",
    "mujoco",
    "numpy",
    "scipy",
    "onnxruntime",
    "embreex",
    "pyrender",
    "opencv-contrib-python-headless",
)


def settings_of(suite: Suite, config: EpisodeConfig) -> dict[str, Any]:
    """Return the settings that the episodes of a folder depend on."""
    episode = plain(to_dict(config))
    for varied in ("goal", "seed"):
        episode.pop(varied)
    if config.team.models:  # files of robots may change
        robots = map(to_dict, config.robots)
        episode["robots content"] = plain(dict(zip(config.team.models, robots, strict=True)))
    for name, value in _flat(episode).items():
        if isinstance(value, str) and value.endswith(".safetensors"):
            content = read_bytes(value, "weights of a network")
            episode[f"{name} content"] = hashlib.sha256(content).hexdigest()[:16]
    return {
        "seed": suite.seed,
        "plans": {name: read_plan(file, reader=suite.reader).digest() for name, file in suite.plans.items()},
        "tasks": {f"{t.plan}/{t.number}": [*t.start, *t.target] for t in suite.tasks},
        "episode": episode,
    }


def code_digest(policies: Iterable[str] = ()) -> str:
    """A text that changes with code and weights of the three packages, their libraries, and policies that are files."""
    digest = hashlib.sha256(json.dumps(versions()).encode())
    for policy in policies:
        if policy.endswith(".safetensors"):
            digest.update(policy.encode() + read_bytes(policy, "weights of a goal policy"))
    for file in sorted((assets_dir() / "weights").glob("*")):
        digest.update(file.name.encode() + file.read_bytes())
    for package in PACKAGES:
        folder = Path(str(sys.modules[package].__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(f"{package}/{file.relative_to(folder)}".encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions of the packages that results depend on."""
    return {name: package_version(name) for name in _PACKAGES if _installed(name)}


def _installed(name: str) -> bool:
    try:
        package_version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    """Nested dictionaries as one, keys joined by dots; lists whole."""
    if not isinstance(value, Mapping):
        return {name: value}
    items: Iterable[tuple[str, Any]] = (
        pair for key, item in value.items() for pair in _flat(item, f"{name}.{key}" if name else key).items()
    )
    return dict(items)


def check_policies(names: Sequence[str]) -> tuple[str, ...]:
    """Policies by name, in the order of tables; if none is given all that search for the target."""
    for name in names:
        GOAL.check("policies", name)
    return tuple(sorted(set(names or SEEKERS), key=place_of))


def place_of(policy: str) -> tuple[int, str]:
    """Sort key of a policy in tables: shipped policies in the order of their list, others by name."""
    names = GOAL.names
    return (names.index(policy) if policy in names else len(names)), policy


def find_suite(
    plans: Sequence[str],
    config: EpisodeConfig,
    *,
    targets: int | None,
    seed: int | None,
    reader: str = "auto",
    workers: int,
    cluster: str | None = None,
    console: Console,
) -> Suite:
    """The suite of a file, or tasks drawn in plan files, folders of them and shipped plans.

    By default 10 `targets` per plan are drawn from seed 0.

    Raises:
        ValueError: If a suite is given together with plans, targets or a seed, or two plans have one name.
        MapError: If a plan cannot be read or has no room for the robot.
    """
    if any(is_suite(plan) for plan in plans):
        if len(plans) > 1 or targets is not None or seed is not None or reader != "auto":
            raise ValueError(
                "A suite file lists its plans, tasks, seed and reader: give it alone, without plans, --targets, --seed "
                "and --reader."
            )
        return read_suite(plans[0])
    count, seed = 10 if targets is None else targets, 0 if seed is None else seed
    files = name_plans(list(dict.fromkeys(find_plans(plans, reader))))
    hull_m = config.robots[0].hull_m
    calls = [(name, file, reader, count, seed, config.building, hull_m) for name, file in files.items()]
    drawn = {}
    with (
        Workers(min(workers, len(calls) or 1), cluster, what="plans") as pool,
        unit_progress(console, "plans", len(calls)) as advance,
    ):
        for _, tasks in pool.run(draw_plan, calls):
            drawn[tasks[0].plan] = tasks
            advance(tasks[0].plan)
    return Suite(
        plans=files, tasks=tuple(task for name in files for task in drawn[name]), seed=seed, reader=reader
    )


def evaluate(
    suite: Suite,
    out: Path,
    *,
    config: EpisodeConfig,
    policies: Sequence[str],
    repeats: int,
    workers: int,
    console: Console,
    cluster: str | None = None,
    options: str = "",
) -> Evaluation:
    """Run every task by the oracle and every policy, score the episodes, and write all results.

    Episodes that `out` holds are not run again. `config` applies but for policy and seed; `options` are those of
    `robosim episode` for it. The results do not depend on the number of workers.

    Raises:
        FolderError: If the folder holds episodes of another configuration, or another process is at work in it.
        WorkerLost: If a process was killed, when the others are done.
        MapError: If a plan cannot be read.
        ValueError: If weights cannot be read, or a task lies outside of its plan.
    """
    for policy in policies:
        check_weights(replace(config, goal=policy))
    suite.check_places()
    names = ("oracle", *(name for name in dict.fromkeys(policies) if name != "oracle"))
    made_by = code_digest(names)
    jobs = make_jobs(suite, config, names, repeats, made_by)
    with run_folder(out, "evaluate", settings_of(suite, config), grows=("plans", "tasks")):
        write_suite(suite, out / "suite.yaml")
        errors = run_jobs(jobs, out, workers=workers, console=console, cluster=cluster)
        done = [(job, read_job_head(job.file(out))) for job in jobs if job.file(out).is_file()]
        # Without the oracle's episode a task has no difficulty and no relative times.
        rated = {(job.task.plan, job.task.number) for job, _ in done if job.policy == "oracle"}
        done = [(job, head) for job, head in done if (job.task.plan, job.task.number) in rated]
        rows = score([head.row for _, head in done])
        result = Evaluation(
            jobs=[job for job, _ in done],
            rows=rows,
            timing=[head.timing for _, head in done],
            summaries=summarise(rows),
            errors=errors,
            foreign=sum(head.made_by != made_by for _, head in done),
        )
        if rows:
            write_results(result, out, config=config, options=options, workers=workers, console=console)
    return result


def summary_table(summaries: Sequence[Summary]) -> Table:
    """The summary for a terminal."""
    table = Table(caption="95 % intervals in brackets; times in steps relative to the oracle's")
    heads, lines = summary_rows(summaries)
    for place, name in enumerate(heads):
        table.add_column(name, justify="left" if place < 2 else "right", no_wrap=True)
    before = None
    for cells in lines:
        if before is not None and before != cells[0]:
            table.add_section()
        before = cells[0]
        table.add_row(*map(Text, cells))
    return table
