"""What an evaluation leaves to be read: tables, pictures, and the page that shows them.

All of it is made anew from the kept episodes at the end of every run. `episodes.parquet` is the same for the same
seed, byte for byte; `timing.parquet` is not.
"""

import io
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from robosim.episode import EpisodeConfig
from robosim.evaluation.charts import arrival_chart, spl_chart, time_chart
from robosim.evaluation.comparison import Compared, compared, subject_of
from robosim.evaluation.episodes import Job
from robosim.evaluation.report import Page, TaskEpisode, TaskPage, write_report
from robosim.evaluation.rows import read_job_episode
from robosim.evaluation.scores import Summary
from robosim.evaluation.sweep import Failure
from robosim.evaluation.ways import ways_figure
from robosim.support.assets import shipped_plans
from robosim.support.figures import save_figure
from robosim.support.files import plain, whole_file, write_json, write_whole
from robosim.support.progress import told_units
from robosim.support.workers import Workers
from wireless.support.counting import counted

#: Tasks that the page shows with a picture, the worst first; all are listed.
_PICTURES = 60
#: Pictures that a process draws at once.
_AT_ONCE = 5
_IDENTITY = ("plan", "task", "policy", "repeat", "seed")


@dataclass(frozen=True)
class Evaluation:
    """What an evaluation came to; jobs, rows and timing go together."""

    jobs: list[Job]
    rows: list[dict[str, Any]]
    """One an episode, scored."""
    timing: list[dict[str, Any]]
    """Seconds of each episode by stage."""
    summaries: list[Summary]
    errors: list[Failure]
    """Episodes that raised an error instead of ending."""
    foreign: int
    """Episodes that other code or other versions of packages have run."""

    @property
    def warnings(self) -> list[str]:
        """What a reader must know before trusting the numbers."""
        lines = [f"{f.job.name} failed and is left out: {f.error}" for f in self.errors]
        if self.foreign:
            lines.append(
                f"{self.foreign} of {len(self.rows)} episodes were run by other code or other versions of packages. "
                "Delete the folder `episodes` to run all of them anew."
            )
        return lines


def replay_command(job: Job, options: str) -> str:
    """What to type to run an episode again, with its video."""
    plan = next((name for name, file in shipped_plans().items() if file == job.plan_file), str(job.plan_file))
    start, target = (",".join(f"{v!r}" for v in place) for place in (job.task.start, job.task.target))
    words = f"--start {start} --target {target} --goal {job.policy} --seed {job.config.seed} {options}"
    reader = "" if job.reader == "auto" else f" --reader {job.reader}"
    return f"robosim episode {shlex.quote(plan)} {words}".strip() + reader


def write_results(
    result: Evaluation, out: Path, *, config: EpisodeConfig, options: str, workers: int, console: Console
) -> None:
    """Write tables, pictures and the page.

    Args:
        result: What to write.
        out: Folder of the evaluation.
        config: How episodes ran, but for policy and seed.
        options: What is typed after `robosim episode` for the same configuration.
        workers: Processes that draw.
        console: Where progress is shown.
    """
    write_parquet(result.rows, out / "episodes.parquet")
    timing = [
        {**{k: row[k] for k in _IDENTITY}, **seconds}
        for row, seconds in zip(result.rows, result.timing, strict=True)
    ]
    write_parquet(timing, out / "timing.parquet")
    write_json(out / "summary.json", {"summary": [_finite(vars(summary)) for summary in result.summaries]})
    charts = [
        ("arrival", arrival_chart(result.summaries), "Arrival rates by difficulty."),
        (
            "relative_time",
            time_chart(result.rows),
            "Episodes that have arrived by a time; a curve that ends below 100 % never gets higher.",
        ),
        ("spl", spl_chart(result.summaries), "Mean success weighted by path length."),
    ]
    if any(row["policy"] == "shortest" for row in result.rows):
        about = "The same relative to a robot that knows building and pose: the physical limit."
        charts.insert(2, ("limit_time", time_chart(result.rows, "shortest"), about))
    for name, figure, _ in charts:
        save_figure(figure, out / f"{name}.png")
    pictures = [(out / f"{name}.png", caption) for name, _, caption in charts]
    tasks = compared(result.rows)
    drawn = _draw_tasks(result, tasks, out, workers, console)
    pages = [_task_page(result, task, options, drawn.get(task), out) for task in tasks]
    write_report(_page(result, config, pictures, pages), out / "report.html")


def _page(
    result: Evaluation,
    config: EpisodeConfig,
    pictures: list[tuple[Path, str]],
    tasks: list[TaskPage],
) -> Page:
    policies = list(dict.fromkeys(row["policy"] for row in result.rows))
    own = {p: [i for i, row in enumerate(result.rows) if row["policy"] == p] for p in policies}
    plans, count = (
        {row["plan"] for row in result.rows},
        len({(row["plan"], row["task"]) for row in result.rows}),
    )
    lead = (
        f"{counted(count, 'task')} in {counted(len(plans), 'floor plan')}, {counted(len(result.rows), 'episode')}. "
        f"Physics {config.simulator.physics}, camera {config.simulator.camera}, noise level "
        f"{config.simulator.noise.level:g}, at most {counted(config.max_steps, 'step')}."
    )
    seconds = {p: _means([result.timing[i] for i in own[p]]) for p in policies}
    rates = {p: stages.pop("decisions_per_s", 0.0) for p, stages in seconds.items()}
    subject = subject_of(policies)
    order = (
        f"Tasks that {subject} failed stand first, then those where it lost most to the best of the other policies. "
        f"The first {min(len(tasks), _PICTURES)} have a picture: the ways of both on one map, with the true walls, "
        "and below it the link state as told and what the goal was at each decision."
    )
    return Page(
        title=f"Evaluation of {', '.join(policies)}",
        lead=[lead],
        warnings=result.warnings,
        summaries=result.summaries,
        pictures=pictures,
        means={p: _means([result.rows[i] for i in own[p]]) for p in policies},
        seconds=seconds,
        decisions_per_s=rates,
        order=order,
        tasks=tasks,
    )


def write_parquet(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write rows; a column that one row lacks is null there."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.Table.from_pylist([{name: row.get(name) for name in names} for row in map(plain, rows)])
    with whole_file(path) as partial:
        pq.write_table(table, partial)


def _draw_tasks(
    result: Evaluation, tasks: list[Compared], out: Path, workers: int, console: Console
) -> dict[Compared, Path]:
    """Pictures of the first tasks."""
    shown = tasks[:_PICTURES]
    files = [
        [result.jobs[i].file(out) for i in (task.subject, task.rival) if i is not None] for task in shown
    ]
    calls = [(files[first : first + _AT_ONCE],) for first in range(0, len(files), _AT_ONCE)]
    drawn: dict[Compared, Path] = {}
    with (
        Workers(min(workers, len(calls) or 1), what="pictures") as pool,
        told_units(console, "pictures of tasks", len(calls)) as tell,
    ):
        for number, pictures in pool.run(_draw, calls):
            for task, content in zip(shown[number * _AT_ONCE :], pictures, strict=False):
                path = out / "tasks" / f"{task.plan}-{task.task:03d}-{task.repeat}.png"
                write_whole(path, content)
                drawn[task] = path
            tell("")
    return drawn


def _draw(files: list[list[Path]]) -> list[bytes]:
    """Pictures of some tasks, each from the files of its one or two episodes."""
    return [_small(ways_figure([read_job_episode(file) for file in some])) for some in files]


def _task_page(result: Evaluation, task: Compared, options: str, picture: Path | None, out: Path) -> TaskPage:
    rows = result.rows
    difficulty = rows[task.episodes[0]]["difficulty"]
    again = f", repetition {task.repeat}" if task.repeat else ""
    told = [_in_short(rows[i]) for i in (task.subject, task.rival) if i is not None]
    times = f": {task.loss:.2f} times as many" if np.isfinite(task.loss) and task.loss > 0 else ""
    return TaskPage(
        title=f"{task.plan}, task {task.task}{again} ({difficulty})",
        what=f"{', '.join(told)}{times}",
        episodes=[
            TaskEpisode(
                cells=_cells(rows[i]),
                arrived=rows[i]["arrived"],
                goals=_goals(result.jobs[i].file(out)),
                command=replay_command(result.jobs[i], options),
            )
            for i in task.episodes
        ],
        picture=picture,
    )


def _in_short(row: Mapping[str, Any]) -> str:
    if row["arrived"]:
        return f"{row['policy']} arrives after {row['arrived_at_step']} actions"
    return f"{row['policy']} {row['ended']} after {row['steps']}, {row['final_distance_m']:.1f} m away"


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Of `TASK_HEADS`."""
    time = row["relative_time"]
    return (
        row["policy"],
        "yes" if row["arrived"] else "no",
        str(row["arrived_at_step"] if row["arrived"] else row["steps"]),
        f"{time:.2f}" if np.isfinite(time) else "-" if np.isnan(time) else "never",
        f"{row['path_length_m']:.1f}",
        f"{row['shortest_m']:.1f}",
        f"{row['spl']:.2f}",
        f"{100 * row['coverage']:.0f}",
        str(row["collisions"]),
    )


def _goals(file: Path) -> str:
    """What the goals of an episode were, the most frequent first."""
    counts = Counter(reason.kind.value for reason in read_job_episode(file).reasons)
    return ", ".join(f"{kind} {count}" for kind, count in counts.most_common()) or "no decision"


def _small(figure: Figure) -> bytes:
    """A picture in few colours, since a page may hold many."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=85)
    plt.close(figure)
    few = Image.open(drawn).convert("RGB").quantize(192, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(small, format="png", optimize=True)
    return small.getvalue()


def _means(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Means of the columns that hold numbers, over the rows that have one."""
    means = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row[name] for row in rows if isinstance(row.get(name), (bool, int, float))]
        finite = [float(value) for value in values if np.isfinite(value)]
        if finite and name not in _IDENTITY:
            means[name] = float(np.mean(finite))
    return means


def _finite(value: Any) -> Any:
    """Estimates as dictionaries, infinite as null: never."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if hasattr(value, "_asdict"):
        return _finite(value._asdict())
    return None if isinstance(value, float) and not np.isfinite(value) else value
