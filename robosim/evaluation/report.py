"""Files of an evaluation: tables, pictures of tasks, and one HTML page that needs no other file.

All of them are written from the recorded episodes at the end of every run. `episodes.parquet` is the same for the same
seed, byte for byte; `timing.parquet` is not.
"""

import base64
import io
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from robosim.episode_config import EpisodeConfig
from robosim.evaluation.episodes import Failure, Job, read_job_episode
from robosim.evaluation.search_scores import Compared, Estimate, Summary, compared, subject_of
from robosim.evaluation.task_picture import trajectories_figure
from robosim.support.files import plain, whole_file, write_json, write_whole
from robosim.support.installation import shipped_plans
from robosim.support.progress import unit_progress
from robosim.support.workers import Workers
from wireless.support.counting import counted

#: Tasks that the page shows with a picture, the worst first; all are listed.
_PICTURES = 60
#: Pictures that a process draws at once.
_AT_ONCE = 5


_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1080px; margin: 2em auto; padding: 0 1em }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px }
td, th { padding: .2em .8em; text-align: right; border-bottom: 1px solid #eee; white-space: nowrap }
th { border-bottom: 1px solid #999; font-weight: 600 }
td:first-child, th:first-child, .summary td:nth-child(2), .list td, .list th { text-align: left }
tr.first td { border-top: 1px solid #999 }
img { max-width: 100% }
section { border-top: 1px solid #ccc; margin-top: 1.5em } h3 { font-size: 1em } .lost { color: #a33 }
code { font: 12px/1.4 ui-monospace, monospace; background: #f5f5f5; overflow-wrap: anywhere; padding: .1em .3em }
.wide { overflow-x: auto } .warn { color: #a33 } small { color: #777 }
"""
#: Columns of the episodes of a task.
_TASK_HEADS = (
    "policy", "arrived", "actions", "x oracle", "path [m]", "shortest [m]", "SPL", "floor seen [%]", "collisions",
)  # fmt: skip
#: Columns that name an episode.
IDENTITY = ("plan", "task", "policy", "repeat", "seed")


@dataclass(frozen=True)
class Evaluation:
    """Results of an evaluation; jobs, rows and timing have one entry per episode."""

    jobs: list[Job]
    rows: list[dict[str, Any]]
    """Identity and scores."""
    timing: list[dict[str, Any]]
    """Seconds by stage."""
    summaries: list[Summary]
    errors: list[Failure]
    """Episodes that raised an error."""
    foreign: int
    """Episodes that other code or other versions of packages have run."""

    @property
    def warnings(self) -> list[str]:
        """Warnings for readers of the numbers."""
        lines = [f"{f.job.name} failed and is left out: {f.error}" for f in self.errors]
        if self.foreign:
            lines.append(
                f"{self.foreign} of {len(self.rows)} episodes were run by other code or other versions of packages. "
                "Delete the folder `episodes` to run all of them again."
            )
        return lines


def write_results(
    result: Evaluation, out: Path, *, config: EpisodeConfig, options: str, workers: int, console: Console
) -> None:
    """Write tables, pictures and the page; `options` are those of `robosim episode` for `config`."""
    write_parquet(result.rows, out / "episodes.parquet")
    identities = [{name: row[name] for name in IDENTITY} for row in result.rows]
    timing = [{**identity, **seconds} for identity, seconds in zip(identities, result.timing, strict=True)]
    write_parquet(timing, out / "timing.parquet")
    write_json(out / "summary.json", {"summary": [_finite(vars(summary)) for summary in result.summaries]})
    tasks = compared(result.rows)
    pictures = _draw_tasks(result, tasks[:_PICTURES], out, workers, console)
    write_report(result, out, config=config, options=options, tasks=tasks, pictures=pictures)


def write_parquet(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write rows; a column that one row lacks is null there."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.Table.from_pylist([{name: row.get(name) for name in names} for row in map(plain, rows)])
    with whole_file(path) as partial:
        pq.write_table(table, partial)


def _draw_tasks(
    result: Evaluation, tasks: list[Compared], out: Path, workers: int, console: Console
) -> dict[Compared, Path]:
    """Pictures of tasks, each of the one or two episodes that are compared."""
    files = [
        [result.jobs[i].file(out) for i in (task.subject, task.rival) if i is not None] for task in tasks
    ]
    calls = [(files[first : first + _AT_ONCE],) for first in range(0, len(files), _AT_ONCE)]
    drawn: dict[Compared, Path] = {}
    with (
        Workers(min(workers, len(calls) or 1), what="pictures") as pool,
        unit_progress(console, "pictures of tasks", len(calls)) as advance,
    ):
        for number, pictures in pool.run(_draw, calls):
            for task, content in zip(tasks[number * _AT_ONCE :], pictures, strict=False):
                path = out / "tasks" / f"{task.plan}-{task.task:03d}-{task.repeat}.png"
                write_whole(path, content)
                drawn[task] = path
            advance("")
    return drawn


def _draw(files: list[list[Path]]) -> list[bytes]:
    return [
        _small(trajectories_figure([read_job_episode(file) for file in episode_files]))
        for episode_files in files
    ]


def _small(figure: Figure) -> bytes:
    """A picture in few colours, since a page may hold many."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=85)
    plt.close(figure)
    few = Image.open(drawn).convert("RGB").quantize(192, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(small, format="png", optimize=True)
    return small.getvalue()


def _finite(value: Any) -> Any:
    """Estimates as dictionaries; infinite, which is never, and NaN, of too few tasks, as null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if hasattr(value, "_asdict"):
        return _finite(value._asdict())
    return None if isinstance(value, float) and not np.isfinite(value) else value


def write_report(
    result: Evaluation,
    out: Path,
    *,
    config: EpisodeConfig,
    options: str,
    tasks: Sequence[Compared],
    pictures: Mapping[Compared, Path],
) -> None:
    """Write `report.html` with its pictures inside; `tasks` are listed in their order, and some have `pictures`."""
    policies = list(dict.fromkeys(row["policy"] for row in result.rows))
    plans, count = {row["plan"] for row in result.rows}, len({(r["plan"], r["task"]) for r in result.rows})
    title = f"Evaluation of {', '.join(policies)}"
    lead = (
        f"{counted(count, 'task')} in {counted(len(plans), 'floor plan')}, {counted(len(result.rows), 'episode')}. "
        f"Physics {config.simulator.physics}, camera {config.simulator.renderer}, noise level "
        f"{config.simulator.robot.noise.level:g}, at most {counted(config.max_steps, 'step')}."
    )
    order = (
        f"Tasks that {subject_of(policies)} failed come first, then those where it lost most to the best of the other "
        f"policies. The first {len(pictures)} have a picture: both trajectories on one map, with the true walls, and "
        "below it the estimated link state and what the goal was at each decision."
    )
    list_rows = [
        [f'<a href="#task-{i}">{escape(_title(result, task))}</a>', escape(_outcome(result, task))]
        for i, task in enumerate(tasks)
    ]
    heads, lines = summary_rows(result.summaries)
    first = [i for i in range(1, len(lines)) if lines[i][0] != lines[i - 1][0]]
    body = [
        f"<h1>{escape(title)}</h1><p>{escape(lead)}</p>",
        *(f'<p class="warn">{escape(line)}</p>' for line in result.warnings),
        "<h2>Summary</h2>",
        _table(heads, [map(escape, line) for line in lines], "summary", dict.fromkeys(first, "first")),
        "<p><small>Brackets are 95 % intervals: Wilson's for arrival, bootstrap over plans (of fewer than five, over "
        "tasks) for the rest. Times are steps relative to the oracle's on the same task, and x shortest the median "
        "relative to a robot that knows the building, where that was run; never: fewer episodes than that arrive."
        "</small></p>",
        f"<h2>Task by task</h2><p>{escape(order)}</p>",
        _table(("task", "in short"), list_rows, "list"),
        *(_section(result, i, task, options, out, pictures.get(task)) for i, task in enumerate(tasks)),
    ]
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    page = f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{chr(10).join(body)}\n</body></html>\n'
    write_whole(out / "report.html", page.encode())


def summary_rows(summaries: Sequence[Summary]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Heads and lines of the summary table; with times relative to `shortest` where that was run."""
    limit = any(not np.isnan(summary.limit_median.value) for summary in summaries)
    heads = (
        "policy", "tasks are", "tasks", "arrived %", "rel. time, median", "rel. time, 80 %",
        *(["x shortest, median"] if limit else []), "mean SPL",
    )  # fmt: skip
    lines = [
        (
            s.policy, s.difficulty, str(s.tasks),
            "{:.1f} [{:.1f}, {:.1f}]".format(*(100 * value for value in s.arrival_rate)),
            _interval(s.time_median), _interval(s.time_p80), *([_interval(s.limit_median)] if limit else []),
            _interval(s.spl, 3),
        )
        for s in summaries
    ]  # fmt: skip
    return heads, lines


def replay_command(job: Job, options: str) -> str:
    """The command that runs an episode again, with its video."""
    plan = next((name for name, file in shipped_plans().items() if file == job.plan_file), str(job.plan_file))
    start, target = (",".join(f"{v!r}" for v in place) for place in (job.task.start, job.task.target))
    words = f"--start {start} --target {target} --goal {job.policy} --seed {job.config.seed} {options}"
    reader = "" if job.reader == "auto" else f" --reader {job.reader}"
    return f"robosim episode {shlex.quote(plan)} {words}".strip() + reader


def _interval(estimate: Estimate, digits: int = 2) -> str:
    value, low, high = (
        "-" if np.isnan(v) else "never" if np.isinf(v) else f"{v:.{digits}f}" for v in estimate
    )
    return f"{value} [{low}, {high}]"


def _title(result: Evaluation, task: Compared) -> str:
    again = f", repetition {task.repeat}" if task.repeat else ""
    return f"{task.plan}, task {task.task}{again} ({result.rows[task.episodes[0]]['difficulty']})"


def _outcome(result: Evaluation, task: Compared) -> str:
    """Summarise in a line how the two compared policies ended."""
    words = []
    for row in (result.rows[i] for i in (task.subject, task.rival) if i is not None):
        if row["arrived"]:
            words.append(f"{row['policy']} arrives after {row['arrived_at_step']} actions")
        else:
            end = f"{row['ended']} after {row['steps']}, {row['final_distance_m']:.1f} m away"
            words.append(f"{row['policy']} {end}")
    times = f": {task.loss:.2f} times as many" if np.isfinite(task.loss) and task.loss > 0 else ""
    return f"{', '.join(words)}{times}"


def _section(
    result: Evaluation, number: int, task: Compared, options: str, out: Path, picture: Path | None
) -> str:
    """A task: its picture, all its episodes, and how to run each again."""
    rows, title = [result.rows[i] for i in task.episodes], _title(result, task)
    items = []
    for i in task.episodes:
        job = result.jobs[i]
        kinds = Counter(reason.kind.value for reason in read_job_episode(job.file(out)).reasons)
        goals = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common()) or "no decision"
        command = f"<code>{escape(replay_command(job, options))}</code>"
        items.append(f"<li><b>{escape(job.policy)}</b>: {escape(goals)}<br>{command}</li>")
    lost = {i: "lost" for i, row in enumerate(rows) if not row["arrived"]}
    return (
        f'<section id="task-{number}"><h3>{escape(title)}</h3><p>{escape(_outcome(result, task))}</p>'
        f"{_image(picture, title) if picture else ''}{_table(_TASK_HEADS, map(_cells, rows), rows_of=lost)}"
        f"<details><summary>Goals, and how to run each again</summary><ul>{''.join(items)}</ul></details></section>"
    )


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Cells of the columns `_TASK_HEADS`."""
    time = row["relative_time"]
    return (
        escape(row["policy"]),
        "yes" if row["arrived"] else "no",
        str(row["arrived_at_step"] if row["arrived"] else row["steps"]),
        f"{time:.2f}" if np.isfinite(time) else "-" if np.isnan(time) else "never",
        f"{row['path_length_m']:.1f}",
        f"{row['shortest_m']:.1f}",
        f"{row['spl']:.2f}",
        f"{100 * row['coverage']:.0f}",
        str(row["collisions"]),
    )


def _table(
    heads: Sequence[str],
    rows: Iterable[Iterable[str]],
    kind: str = "",
    rows_of: Mapping[int, str] | None = None,
) -> str:
    """A table of cells of HTML, of a class; `rows_of` are classes of rows by number."""
    classes = rows_of or {}
    lines = [
        f'<tr class="{classes.get(i, "")}">' + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>"
        for i, row in enumerate(rows)
    ]
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    return f'<div class="wide {kind}"><table><tr>{head}</tr>\n{chr(10).join(lines)}</table></div>'


def _image(path: Path, text: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{data}">'
